#!/bin/sh
# l2f 2.0.18 (the Learning to Fly simulator): the JSON of a vehicle holds the inertia twice, as J
# and as J_inv, and nothing holds one against the other. Torques turn the body by J_inv alone; J is
# only in the gyroscopic torque. `parameters_to_json` writes six decimals, so that J of its own
# default vehicle, a Crazyflie, comes back with one or two digits.
# Seen for it: 1/J_inv is 9.42e-6, 9.64e-6, 1.746e-5 kg m^2, J in the JSON 9e-6, 1e-5, 1.7e-5. Ten
# times J in the JSON: the same pitch rate of -3.33 rad/s after 10 ms of the same thrusts; a tenth
# of J_inv: -0.333 rad/s. Turning at 3 rad/s about each axis, its yaw rate changes by -0.0012 rad/s
# in 10 ms, and by -0.0052 after its own JSON is read back.
# It matters where an identified inertia is put into that JSON: as J alone it leaves the response to
# commands that of the Crazyflie, and for small vehicles six decimals are too few for J.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q l2f==2.0.18 numpy==2.1.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import json

import l2f
import numpy as np

device, rng, world = l2f.Device(), l2f.Rng(), l2f.Environment()
l2f.initialize_rng(device, rng, 0)
l2f.initialize_environment(device, world)


def crazyflie():
    vehicle = l2f.Parameters()
    l2f.initial_parameters(device, world, vehicle)
    return vehicle


def edited(**factors):
    """Return the vehicle of its own JSON, with elements multiplied by factors."""
    text = json.loads(l2f.parameters_to_json(device, world, crazyflie()))
    for name, factor in factors.items():
        text["dynamics"][name] = (factor * np.array(text["dynamics"][name])).tolist()
    vehicle = crazyflie()
    l2f.parameters_from_json(device, world, json.dumps(text), vehicle)
    return vehicle


def turned(vehicle, rates, speeds):
    """Return the change of the rates [rad/s] in one step of 10 ms; speeds over the full one."""
    state, after = l2f.State(), l2f.State()
    l2f.initial_state(device, world, vehicle, state)
    state.angular_velocity, state.rpm = np.array(rates), np.array(speeds)
    step = l2f.step(device, world, vehicle, state, [2.0 * speed - 1.0 for speed in speeds], after, rng)
    assert abs(step - 0.01) < 1e-6
    return np.array(after.angular_velocity) - rates


def pitch_rate(**factors):
    return float(turned(edited(**factors), (0.0, 0.0, 0.0), (0.9, 0.5, 0.5, 0.9))[1])


def yaw_change(vehicle):
    return float(turned(vehicle, (3.0, 3.0, 3.0), (0.5, 0.5, 0.5, 0.5))[2])


dynamics = json.loads(l2f.parameters_to_json(device, world, crazyflie()))["dynamics"]
moments, inverse = (np.diag(dynamics[name]) for name in ("J", "J_inv"))
print("J", moments, "1/J_inv", 1.0 / inverse)
assert moments.tolist() == [9e-6, 1e-5, 1.7e-5]
assert np.allclose(1.0 / inverse, [9.4166e-6, 9.6441e-6, 1.74595e-5], rtol=1e-4)
usual, by_moments, by_inverse = pitch_rate(), pitch_rate(J=10.0), pitch_rate(J_inv=0.1)
print("pitch rate [rad/s]", usual, "ten times J:", by_moments, "a tenth of J_inv:", by_inverse)
assert abs(usual + 3.3329) < 1e-3 and abs(by_moments - usual) < 1e-6
assert abs(by_inverse - 0.1 * usual) < 1e-5
at_first, read_back = yaw_change(crazyflie()), yaw_change(edited())
print("change of yaw rate while turning [rad/s]", at_first, "after its own JSON:", read_back)
assert abs(at_first + 0.0012) < 1e-4 and abs(read_back + 0.0052) < 1e-4
PY
