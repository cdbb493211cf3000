#!/bin/sh
# multirotor 0.5.0 (PyPI): with `use_thrust_constant=False` the air that flows through the propellers is worked out from
# the position of the vehicle in place of its velocity, and from the velocity in place of its rates. And the diameter
# of `PropellerParams` becomes the radius in its thrust. The documentation has this as the thrust by the geometry of the
# propeller, the state as position, velocity, attitude and rates, and the diameter as that of the maker.
# Seen for four propellers 10x4.5 at 400 rad/s: 68.3 N at rest on the ground, 92.2 N at rest at a height of 10 m,
# 75.2 N at rest 5 m to the front of the start; a climb of 3 m/s, which costs a propeller thrust, adds 0.06 N. The
# radius is 0.254 m, which is 10 inches; with half of it, as is right, the thrust at rest is 6.7 N.
# It matters where a controller is trained or a thrust curve compared in this simulation: thrust is by the height, the
# damping of climbs by the rotors has the wrong sign, and an identified k_t is not that of the propeller.
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

SPEEDS = np.full(4, 400.0)  # rad/s


def vehicle():
    """Return a quadrotor with propellers of 10 x 4.5 inches."""
    propellers = [
        PropellerParams(
            moment_of_inertia=1e-5,
            diameter=10,
            pitch=4.5,
            use_thrust_constant=False,
            k_thrust=1e-5,  # for the allocation of control alone
            k_drag=1e-7,
        )
        for _ in range(4)
    ]
    airframe = VehicleParams(
        mass=1.0,
        inertia_matrix=np.diag([0.01, 0.01, 0.02]),
        propellers=propellers,
        angles=np.radians([45.0, 135.0, 225.0, 315.0]),
        distances=np.full(4, 0.2),
    )
    return Multirotor(airframe, SimulationParams())


def thrust(drone, position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    """Return the thrust [N] at a position and a velocity, level and without a turn."""
    state = np.concatenate([position, velocity, np.zeros(6)])
    return float(drone.get_forces_torques(SPEEDS, state)[0][2])


drone = vehicle()
start, high = thrust(drone), thrust(drone, position=(0.0, 0.0, 10.0))
front, climb = thrust(drone, position=(5.0, 0.0, 0.0)), thrust(drone, velocity=(0.0, 0.0, 3.0))
radius = drone.propellers[0].params.R
for propeller in drone.propellers:
    propeller.params.R, propeller.params.A = radius / 2.0, propeller.params.A / 4.0
halved = thrust(drone)
print(f"at rest {start:.2f} N, 10 m high {high:.2f} N, 5 m to the front {front:.2f} N,", end=" ")
print(f"in a climb of 3 m/s {climb:.2f} N")
print(f"radius of a propeller of 10 inches {radius:.4f} m; with half of it {halved:.2f} N at rest")
assert high / start > 1.3 and front / start > 1.05
assert 0.0 < climb - start < 0.1
assert np.isclose(radius, 10 * 0.0254) and start / halved > 4.0
PY
