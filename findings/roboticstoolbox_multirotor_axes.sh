#!/bin/sh
# roboticstoolbox-python 1.5.0 (Peter Corke's toolbox), the block MULTIROTOR: the air at the rotors is that of the
# velocity in world axes, where their thrust and the tilt of their discs are in body axes. Thrust leans back as
# long as the vehicle heads along x of the world; at another heading the drag of the rotors is turned with it. Two
# outputs are not what the documentation says: `trans` has the velocity in body axes ("in the world frame"), the
# same as `vb`, and `w` has the rates of yaw, pitch and roll, in this order ("angular rates in the body frame").
# Seen in flight along x at 5 m/s with hover thrust, level: heading 0 -0.14 m/s^2 along x; heading 90 degrees
# -0.14 along y and none along x; heading 180 +0.14 along x, the rotors drive the vehicle. Velocity in `trans` 5,
# 0, 0 and 0, -5, 0 and -5, 0, 0. Pitched by 30 degrees with rates p, q, r of 1, 2, 3 rad/s: `w` is 3.46, 2, 2.73.
# It matters where drag or an identification is tried on its flights: they agree with each other at one heading
# only.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q roboticstoolbox-python==1.5.0 bdsim==1.4.0
cd "$folder"
export MPLCONFIGDIR="$folder" MPLBACKEND=Agg
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from roboticstoolbox.blocks.quad_model import quadrotor
from roboticstoolbox.blocks.uav import MultiRotor

block = MultiRotor(quadrotor)
per_square = quadrotor["Ct"] * quadrotor["rho"] * quadrotor["A"] * quadrotor["r"] ** 2
hover = np.sqrt(quadrotor["M"] * quadrotor["g"] / (4.0 * per_square))
speeds = hover * np.array([1.0, -1.0, 1.0, -1.0])


def flown(heading=0.0, pitch=0.0, velocity=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)):
    """Return the acceleration [m/s^2] in world axes, and the outputs, 10 m above the ground."""
    angles = np.radians([heading, pitch, 0.0])
    state = np.concatenate([[0.0, 0.0, -10.0], angles, velocity, rates])
    outputs = block.output(0.0, [speeds], state)[0]
    return block.deriv(0.0, [speeds], state)[6:9], outputs


drags, velocities = [], []
for heading in (0.0, 90.0, 180.0):
    acceleration, outputs = flown(heading, velocity=(5.0, 0.0, 0.0))
    drags.append(acceleration[:2])
    velocities.append(outputs["trans"][3:])
    assert np.allclose(outputs["trans"][3:], outputs["vb"])
turned = flown(pitch=30.0, rates=(1.0, 2.0, 3.0))[1]["w"]
print("along x at 5 m/s, acceleration along x and y", (np.round(drags, 3) + 0.0).tolist())
print("velocity in trans", (np.round(velocities, 3) + 0.0).tolist())
print("w for p, q, r = 1, 2, 3 at a pitch of 30 degrees", turned.round(3).tolist())
drag = drags[0][0]
assert -0.15 < drag < -0.13
assert np.allclose(drags, [[drag, 0.0], [0.0, drag], [-drag, 0.0]])  # each [drag, 0] in truth
assert np.allclose(velocities, [[5, 0, 0], [0, -5, 0], [-5, 0, 0]])  # each [5, 0, 0] as documented
yaw_rate = 3.0 / np.cos(np.radians(30.0))
assert np.allclose(turned, [yaw_rate, 2.0, 1.0 + 3.0 * np.tan(np.radians(30.0))])
PY
