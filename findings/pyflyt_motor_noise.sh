#!/bin/sh
# PyFlyt 0.29.0: the noise of the motors is a push upwards. `Motors` and `Boosters` draw it as
# `normal(*throttle.shape)`, which is one number about a mean of as many as there are motors, and not one about 0
# for each: in each physics step every throttle grows by noise_ratio times about 4 in a quadrotor. It is
# documented as the ratio of noise fluctuation in each motor.
# Seen for its own model cf2x (noise_ratio 0.02) at a PWM of 0.5: throttles of .607 and 1.47 times the thrust of
# 0.5; with physics at 480 Hz .773 and 2.39 times. `Motors` alone: without noise 1.00, four motors 1.47, eight
# 2.23 times. All motors have the same noise at each step, so that it turns nothing.
# It matters where commands, hover throttle or thrust coefficients of PyFlyt are compared with those of
# its own file, a flight or another simulator: they are those of another motor, for each rate of the physics.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pyflyt==0.29.0
cd "$folder"
export MPLCONFIGDIR="$folder" NUMBA_CACHE_DIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import types

import numpy as np
from PyFlyt.core import Aviary
from PyFlyt.core.abstractions.motors import Motors

COMMAND = 0.5
IDLE = types.SimpleNamespace(  # a client to which the forces go unheeded
    LINK_FRAME=1, applyExternalForce=lambda *_: None, applyExternalTorque=lambda *_: None
)


def in_flight(physics_hz):
    """Return the throttles of the model cf2x while all its PWM are at the command."""
    place, level = np.array([[0.0, 0.0, 100.0]]), np.zeros((1, 3))
    aviary = Aviary(place, level, drone_type="quadx", physics_hz=physics_hz, seed=1)
    aviary.set_mode(-1)
    aviary.set_setpoint(0, np.full(4, COMMAND))
    rows = []
    for _ in range(360):
        aviary.step()
        rows.append(aviary.drones[0].aux_state.copy())
    aviary.disconnect()
    return np.array(rows)[60:]


def alone(count, ratio):
    full = np.full(count, 1.0)
    axis = np.tile([0.0, 0.0, 1.0], (count, 1))
    names = list(range(count))
    generator = np.random.default_rng(0)
    motors = Motors(
        IDLE, 1 / 240, generator, 0, names, 0.01 * full, full, full, full, axis, ratio * full
    )
    motors.reset()
    rows = []
    for _ in range(2000):
        motors.physics_update(COMMAND * full)
        rows.append(motors.get_states())
    return np.array(rows)[100:]


def thrust_ratio(throttles):
    return float(np.mean(throttles**2) / COMMAND**2)


flights = {rate: in_flight(rate) for rate in (240, 480)}
for rate, rows in flights.items():
    print(f"cf2x, {rate} Hz: throttle {rows.mean():.3f}, thrust {thrust_ratio(rows):.2f} times")
clean, four, eight = (thrust_ratio(alone(n, r)) for n, r in ((4, 0.0), (4, 0.02), (8, 0.02)))
spread = max(float(np.ptp(rows, axis=1).max()) for rows in flights.values())
print(f"thrust without noise {clean:.3f}, of 4 motors {four:.2f}, of 8 {eight:.2f} times")
print("largest difference between motors", round(spread, 9))
assert abs(clean - 1.0) < 1e-6
assert abs(thrust_ratio(flights[240]) - 1.48) < 0.05 and abs(thrust_ratio(flights[480]) - 2.4) < 0.15
assert abs(four - 1.48) < 0.05 and abs(eight - 2.23) < 0.1
assert spread < 1e-9
PY
