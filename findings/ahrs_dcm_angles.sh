#!/bin/sh
# AHRS 0.4.0 (Python): `DCM(rpy=...)` takes yaw, pitch and roll, in this order, where `Quaternion(rpy=...)`
# takes roll, pitch and yaw; and `to_rpy` gives the angles of the transposed matrix (the turn from world to
# body) as if it were the turn from body to world. A matrix does not come back from its own angles: the
# signs are others, and with a heading roll and pitch are mixed. The documentation of `DCM` has the order in
# a note, but calls the argument "roll->pitch->yaw".
# Seen for a roll of 20 and a yaw of 90 degrees: `to_rpy` of its matrix says 0, -20, -90, and
# `Quaternion(dcm=...).to_angles()` 20, 0, 90. With rpy = (20, 0, 90): the quaternion has roll 20 and yaw 90,
# and the matrix roll 90 and yaw 20.
# It matters where attitudes pass through matrices, as those of motion capture and of tf do: at the heading
# 0 only the signs are wrong, and at 90 degrees a roll is a pitch.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ahrs==0.4.0 scipy==1.17.1
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from ahrs import DCM, Quaternion
from scipy.spatial.transform import Rotation

ROLL_PITCH_YAW = [20.0, 0.0, 90.0]
TRUTH = Rotation.from_euler("ZYX", ROLL_PITCH_YAW[::-1], degrees=True)


def degrees(angles):
    return [round(float(angle)) + 0 for angle in np.degrees(angles)]


def of_matrix(matrix):
    """Return roll, pitch and yaw of a matrix from body to world, as SciPy has them."""
    return degrees(Rotation.from_matrix(np.array(matrix)).as_euler("ZYX")[::-1])


def of_quaternion(quaternion):
    return degrees(Rotation.from_quat(np.array(quaternion), scalar_first=True).as_euler("ZYX")[::-1])


matrix = TRUTH.as_matrix()
read, other = degrees(DCM(matrix).to_rpy()), degrees(Quaternion(dcm=matrix).to_angles())
print("roll, pitch, yaw [degrees]", ROLL_PITCH_YAW, "DCM.to_rpy", read, "Quaternion.to_angles", other)
made = of_matrix(DCM(rpy=np.radians(ROLL_PITCH_YAW)))
made_other = of_quaternion(Quaternion(rpy=np.radians(ROLL_PITCH_YAW)))
print("made by rpy=(20, 0, 90): DCM", made, "Quaternion", made_other)
assert read == [0, -20, -90] and other == [20, 0, 90]
assert made == [90, 0, 20] and made_other == [20, 0, 90]
PY
