#!/bin/sh
# MuJoCo 4.0.0, mujoco.sysid: the simulated flight starts at the time in the initial state, which
# `create_initial_state` leaves at 0, and not at the first time of the log. Commands are applied from
# the first row on, but measurements are compared at equal times. A log that starts at 1 s is so
# compared with a flight that is 1 s ahead of it, and the rest of the log is left out. Nothing is
# said as long as the times overlap. The README asks for "timestamps" and names no start.
# Seen on a stand with one axis, Ixx 0.01 kg m^2, 4 s at 500 Hz: a log from 0 s on gives 0.010; the
# same log from 0.1 s on 0.01023 +- 0.00006, from 1 s on 0.0133 +- 0.0006. With the start written into
# the initial state (its first number) it gives 0.010 again.
# It matters where a log is cut, or has the clock of the autopilot: inertia, lags and their intervals are
# wrong.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q "mujoco[sysid]==4.0.0"
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import contextlib
import io

import mujoco
import numpy as np
from mujoco import sysid

STAND = """<mujoco><option timestep="0.002"/><worldbody><body name="drone">
<joint name="roll" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.015"/></body></worldbody>
<actuator><motor name="torque" joint="roll"/></actuator>
<sensor><jointvel name="gyro" joint="roll"/></sensor></mujoco>"""
SPEC = mujoco.MjSpec.from_string(STAND)
MODEL = SPEC.compile()
TIMES = 0.002 * np.arange(2000)
TORQUE = 0.02 * (np.sin(2 * np.pi * 0.9 * TIMES) + np.sin(2 * np.pi * 0.31 * TIMES))[:, None]


def flown():
    """Return the rate at each time, of the torque before it."""
    data = mujoco.MjData(MODEL)
    rates = []
    for torque in TORQUE:
        rates.append(data.qvel.copy())
        data.ctrl = torque
        mujoco.mj_step(MODEL, data)
    return np.array(rates)


RATE = flown()


def set_inertia(spec, parameter):
    spec.body("drone").inertia[0] = parameter.value[0]


def fit(start, state_time=0.0):
    """Return Ixx with half its interval, and the rows compared, of the log from `start` on."""
    guess = sysid.Parameter("Ixx", 0.012, 0.006, 0.03, modifier=set_inertia)
    state = sysid.create_initial_state(MODEL, np.zeros(1))
    assert state[0] == 0.0
    state[0] = state_time
    log = sysid.ModelSequences(
        "stand", SPEC, "log", state,
        sysid.TimeSeries.from_control_names(start + TIMES, TORQUE, MODEL),
        sysid.TimeSeries.from_names(start + TIMES, RATE, MODEL),
    )
    residual = sysid.build_residual_fn(models_sequences=[log], n_threads=1)
    with contextlib.redirect_stdout(io.StringIO()):
        found, result = sysid.optimize(sysid.ParameterDict({"Ixx": guess}), residual)
    left = residual(result.x, found)[0]
    _, half = sysid.calculate_intervals(left, result.jac)
    return float(result.x[0]), float(half[0]), left[0].size


right, little, late, told = fit(0.0), fit(0.1), fit(1.0), fit(1.0, state_time=1.0)
print("Ixx, half its interval [kg m^2], rows; from 0 s on", right, "from 0.1 s on", little)
print("from 1 s on", late, "with that time in the initial state", told)
assert abs(right[0] - 0.01) < 1e-5 and abs(told[0] - 0.01) < 1e-5
assert abs(little[0] - 0.01023) < 3e-5 and abs(late[0] - 0.01334) < 3e-4
assert late[0] - late[1] > 0.012 and late[2] == 1499
PY
