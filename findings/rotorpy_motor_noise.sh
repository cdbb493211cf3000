#!/bin/sh
# RotorPy 3.0.0: `motor_noise_std` is documented as a density (rad/s / sqrt(Hz)) and its comment
# speaks of a measurement, but its full value is added to the rotors' true speed at every step,
# whatever the step. The same vehicle is noisier the finer it is simulated.
# Seen: noise 10, motor lag 72 ms, steps of 10, 5 and 2.5 ms: the speed scatters by 19, 27 and 37 rad/s.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q rotorpy==3.0.0
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor


def scatter(step, seconds=10.0):
    np.random.seed(0)
    noisy = {**quad_params, "motor_noise_std": 10.0}
    vehicle = Multirotor(noisy, control_abstraction="cmd_motor_speeds")
    state = vehicle.initial_state
    speed = np.full(4, 1788.0)
    control = {"cmd_motor_speeds": speed}
    seen = []
    for _ in range(int(seconds / step)):
        state = vehicle.step(state, control, step)
        seen.append(state["rotor_speeds"] - speed)
    return float(np.std(seen[len(seen) // 5 :]))


found = [scatter(step) for step in (0.01, 0.005, 0.0025)]
lag = quad_params["tau_m"]
expected = [10.0 / np.sqrt(1.0 - np.exp(-2.0 * step / lag)) for step in (0.01, 0.005, 0.0025)]
print("scatter [rad/s]", np.round(found, 1), "of full noise at every step", np.round(expected, 1))
assert np.allclose(found, expected, rtol=0.1)
PY
