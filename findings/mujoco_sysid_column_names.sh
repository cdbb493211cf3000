#!/bin/sh
# MuJoCo 4.0.0, mujoco.sysid: names of columns are taken and kept, and not heeded. `from_names` and
# `from_control_names` say: if the data are in another order than the model's, pass explicit names. But the
# rollout gives the first column to the first actuator, and the residual compares the first column with the
# first sensor, whatever their names. Only the number of columns is checked.
# Seen, a quadrotor whose model has its motors clockwise from the front right, and whose log has them as 1
# front right, 2 rear left, 3 front left, 4 rear right, each by its name: .1 N more on the rear left motor
# turns the model to the left (-.099 rad/s after .1 s), and to the right (+.099) in the model's order. With
# the accelerometer before the gyro, both named, the true model misses its own flight by 9.9 (the
# accelerometer's 9.9 m/s^2 beside a rate), and by 0 in the model's order.
# It matters where motors and sensors of a log are given by name, as the documentation asks: the
# parameters that are then fitted are those of another vehicle.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q "mujoco[sysid]==4.0.0"
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import mujoco
import numpy as np
from mujoco import sysid

PLACES = {  # clockwise from above, x forward and y left [m], with the sign of the torque about z
    "front_right": (0.1, -0.1, 1), "rear_right": (-0.1, -0.1, -1),
    "rear_left": (-0.1, 0.1, 1), "front_left": (0.1, 0.1, -1),
}
AUTOPILOT = ["front_right", "rear_left", "front_left", "rear_right"]
SITES = "".join(f'<site name="{k}" pos="{x} {y} 0"/>' for k, (x, y, _) in PLACES.items())
MOTORS = "".join(
    f'<motor name="{k}" site="{k}" gear="0 0 1 0 0 {0.01 * s}"/>' for k, (_, _, s) in PLACES.items()
)
DRONE = f"""<mujoco><option timestep="0.001"/><worldbody><body name="drone"><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.02"/><site name="imu"/>{SITES}</body></worldbody>
<actuator>{MOTORS}</actuator>
<sensor><gyro name="gyro" site="imu"/><accelerometer name="accel" site="imu"/></sensor></mujoco>"""
SPEC = mujoco.MjSpec.from_string(DRONE)
MODEL = SPEC.compile()
TIMES = 0.001 * np.arange(101)
STATE = sysid.create_initial_state(MODEL, np.array([0, 0, 0, 1.0, 0, 0, 0]))
THRUST = {name: np.full(101, 9.81 / 4) for name in PLACES}
THRUST["rear_left"] = THRUST["rear_left"] + 0.1


def control(names):
    rows = np.column_stack([THRUST[name] for name in names])
    given = sysid.TimeSeries.from_control_names(TIMES, rows, MODEL, names)
    for column, name in enumerate(names):
        assert given.signal_mapping[f"{name}_ctrl"][1].tolist() == [column]
    return given


def flown(names):
    return sysid.sysid_rollout(MODEL, mujoco.MjData(MODEL), control(names), STATE)[0].sensordata


def misfit(names):
    """Return the largest difference between the model and its own flight, its sensors given in this order."""
    flight = flown(list(PLACES))
    rows = np.hstack([flight.data[:, flight.signal_mapping[name][1]] for name in names])
    given = sysid.TimeSeries.from_names(flight.times, rows, MODEL, names)
    log = sysid.ModelSequences("drone", SPEC, "log", STATE, control(list(PLACES)), given)
    residual = sysid.build_residual_fn(models_sequences=[log], n_threads=1)
    mass = sysid.Parameter("mass", 1.0, 0.5, 2.0)
    _, predicted, measured = residual(np.ones(1), sysid.ParameterDict({"mass": mass}))
    return float(np.abs(predicted[0][0].data - measured[0][0].data).max())


def rates(names):
    flight = flown(names)
    return flight.data[-1, flight.signal_mapping["gyro"][1]].round(4)


right, wrong = rates(list(PLACES)), rates(AUTOPILOT)
print("rates [rad/s], motors in the model's order", right, "the same named, in another", wrong)
same, other = misfit(["gyro", "accel"]), misfit(["accel", "gyro"])
print("largest misfit, sensors in the model's order", round(same, 3), "in another", round(other, 3))
assert np.allclose(right[:2], [0.1, 0.1], atol=0.003)
assert np.allclose(wrong[:2], [-0.1, 0.1], atol=0.003)
assert same < 1e-9 and abs(other - 9.91) < 0.02
PY
