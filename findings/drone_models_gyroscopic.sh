#!/bin/sh
# drone-models 0.1.0: `first_principles.dynamics` (and `symbolic_dynamics`, by its text) gives the
# rotors' gyroscopic torque as (-q S, -p S) prop_inertia, with S the sum of the third row of
# `mixing_matrix` times the speeds. -omega x H is (q S, -p S): the torque about x has the wrong sign,
# so that it does work, which no gyroscopic torque does. It vanishes where the speeds balance, and
# matters while the vehicle yaws, or one rotor is lost.
# Seen, cf2x_L250 (prop_inertia 3.452e-8), rotors 1 and 3 at 22000 RPM, 2 and 4 at 14000, p = 3 and
# q = 2 rad/s: torque (1.157e-4, 1.735e-4) N m where (-1.157e-4, 1.735e-4) is right; its power is
# 6.9e-4 W where zero is right.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q drone-models==0.1.0
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import drone_models  # before scipy: it sets a variable that scipy reads
import numpy as np
from drone_models.first_principles import dynamics

model = drone_models.parametrize(dynamics, "cf2x_L250")
speeds = np.array([22000.0, 14000.0, 22000.0, 14000.0])  # commanded and actual: constant
omega = np.array([3.0, 2.0, 0.0])


def rise(inertia):
    rates = model(
        np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), omega, speeds, speeds,
        prop_inertia=inertia,
    )
    assert not np.any(rates[4])
    return rates[3]


inertia = model.keywords["prop_inertia"]
torque = model.keywords["J"] @ (rise(inertia) - rise(0.0))
# The reaction of a rotor's drag is against its turn: its spin about z is minus the mixing's sign.
spins = -model.keywords["mixing_matrix"][2]
momentum = np.array([0.0, 0.0, inertia * (spins @ speeds) * 2.0 * np.pi / 60.0])
right = -np.cross(omega, momentum)
print("torque [N m]", torque, "right", right)
print("power [W]", torque @ omega, "right", right @ omega)
assert np.allclose(torque, right * [-1.0, 1.0, 1.0], rtol=1e-6, atol=1e-12)
assert abs(torque @ omega) > 1e-5 and abs(right @ omega) < 1e-12
PY
