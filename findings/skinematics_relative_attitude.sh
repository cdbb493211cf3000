#!/bin/sh
# scikit-kinematics 0.10.4 (0.12.0 has the same line): `imus.analytical` takes the attitude at the start, and turns
# acceleration to space axes by the right attitude, but returns each quaternion times the inverse of the first:
# the turn since the start, about axes in space, in place of the attitude. It is documented as
# "Orientation, expressed as a quaternion vector", and is what an `IMU_Base` of type "analytical" has as `quat`.
# Seen, IMU at rest, rolled by 90 degrees: quaternion 1, 0, 0, 0. Heading 90 degrees, then pitched by 30 about its own
# y: roll, pitch, yaw = -30, 0, 0 in place of 0, 30, 90 degrees. Speed and position are right.
# It matters where the attitude of a log is worked out from the gyro: of a vehicle that starts with another heading
# than 0, a pitch becomes a roll. The attitude is the returned quaternion times the first one.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q scikit-kinematics==0.10.4
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
from scipy.constants import g
from scipy.spatial.transform import Rotation
from skinematics import imus

RATE, COUNT = 100.0, 301
TIMES = np.arange(COUNT) / RATE


def worked_out(start, rate, push):
    """Return the last attitude, the last speed and the true attitude for a push in space axes."""
    attitudes = start * Rotation.from_rotvec(TIMES[:, np.newaxis] * rate)
    force = attitudes.inv().apply(np.array([push, 0.0, g]))
    turning = np.tile(rate, (COUNT, 1))
    if push:
        force[0] = attitudes[0].inv().apply([0.0, 0.0, g])  # it starts at rest
    quaternions, _, speeds = imus.analytical(start.as_matrix(), turning, np.zeros(3), force, RATE)
    found = Rotation.from_quat(quaternions[-1][[1, 2, 3, 0]])
    return found, speeds[-1], attitudes[-1]


def angles(turn):
    """Return roll, pitch and yaw [degrees]."""
    return (turn.as_euler("ZYX", degrees=True)[::-1].round(2) + 0.0).tolist()


rolled = Rotation.from_euler("x", 90, degrees=True)
rest, _, rest_truth = worked_out(rolled, np.zeros(3), 0.0)
heading = Rotation.from_euler("z", 90, degrees=True)
pitch_rate = np.array([0.0, np.radians(30) / TIMES[-1], 0.0])
pitched, speed, pitched_truth = worked_out(heading, pitch_rate, 1.0)
print("at rest: roll, pitch, yaw", angles(rest), "truth", angles(rest_truth))
print("pitched at heading 90:", angles(pitched), "truth", angles(pitched_truth))
print("times the first:", angles(pitched * heading), "speed after 3 s", speed.round(2) + 0.0)
assert np.allclose(angles(rest), 0.0) and np.allclose(angles(rest_truth), [90, 0, 0])
assert np.allclose(angles(pitched), [-30, 0, 0], atol=0.1)
assert np.allclose(angles(pitched_truth), [0, 30, 90], atol=0.01)
assert np.allclose(angles(pitched * heading), [0, 30, 90], atol=0.1)
assert np.allclose(speed, [3.0, 0.0, 0.0], atol=0.03)
PY
