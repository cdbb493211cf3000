#!/bin/sh
# multirotor 0.5.0 (PyPI): `step_speeds` and `step_dynamics` round the state to four decimals after each step, so that
# accelerations, rates and velocities under 0.05 per second are lost at the default step of 1 ms: the vehicle does not
# move. The documentation has the steps as those of an integration; the rounding is not in it.
# Seen after 1 s of constant forces at steps of 10 and 1 ms: 0.03 m/s^2 give a velocity of 0.03 and 0 m/s, 0.04
# rad/s^2 a rate of 0.04 and 0 rad/s, and 0.07 rad/s^2 of 0.07 and 0.1. A velocity of 0.04 m/s moves the vehicle by
# 0.04 and 0 m.
# It matters where small torques, drag or a shifted centre of mass are to be seen in simulated flights: what is
# identified has steps of 0.1 rad/s^2, and a shorter step, meant to be more exact, makes it worse.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q multirotor==0.5.0 numpy==1.26.4 scipy==1.14.1 numba==0.60.0 gym==0.26.2 setuptools
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
from multirotor.simulation import Multirotor
from multirotor.vehicle import PropellerParams, SimulationParams, VehicleParams

WEIGHT, INERTIA = 9.81, 0.01  # N, kg m^2


def fly(step, force=0.0, torque=0.0, velocity=0.0):
    """Return height, climb and roll rate after 1 s of a force [N] and a torque [N m] beside the weight."""
    propellers = [
        PropellerParams(moment_of_inertia=1e-5, k_thrust=1e-5, k_drag=1e-7) for _ in range(4)
    ]
    airframe = VehicleParams(
        mass=1.0,
        inertia_matrix=np.diag([INERTIA, INERTIA, 0.02]),
        propellers=propellers,
        angles=np.radians([45.0, 135.0, 225.0, 315.0]),
        distances=np.full(4, 0.2),
    )
    drone = Multirotor(airframe, SimulationParams(dt=step))
    drone.state[5] = velocity
    for _ in range(round(1.0 / step)):
        drone.step_dynamics(np.array([0.0, 0.0, WEIGHT + force, torque, 0.0, 0.0]))
    return [round(float(drone.state[index]), 3) for index in (2, 5, 9)]


found = {}
assert SimulationParams().dt == 0.001
for step in (0.01, 0.001):
    climb = fly(step, force=0.03)[1]
    slow, fast = (fly(step, torque=INERTIA * turn)[2] for turn in (0.04, 0.07))
    height = fly(step, velocity=0.04)[0]
    found[step] = [climb, slow, fast, height]
    print(f"step {step} s: 0.03 m/s^2 -> {climb} m/s; 0.04 and 0.07 rad/s^2 ->", end=" ")
    print(f"{slow} and {fast} rad/s; 0.04 m/s -> {height} m")
assert np.allclose(found[0.01], [0.03, 0.04, 0.07, 0.04], atol=1e-3)
assert found[0.001][:2] == [0.0, 0.0] and np.isclose(found[0.001][2], 0.1) and found[0.001][3] == 0.0
PY
