#!/bin/sh
# MuJoCo 4.0.0, mujoco.sysid: `SignalTransform.bias` and `gain` change, unless told otherwise, the measured
# signal and the simulated one alike. The bias drops out of their difference, and the gain where the
# difference is divided by the size of the measured signal. The README names `transform.bias("*_vel",
# params["bias"])` and `transform.gain("*_torque", params["scale"])` as the way to identify a sensor's bias
# and gain; only with target="predicted" or "measured" are they. A bias runs to its bound instead,
# since the measured signal, by which the difference is divided, is larger with it.
# Seen on a stand with one axis, Ixx .01 kg m^2, a gyro with a bias of .1 rad/s and bounds of +-1: Ixx .00945
# and bias 1, and with target="predicted" .01 and .1. From a gain of .5 to one of 2 the residual, divided
# by the signal's size, does not change at all, and with target="predicted" by up to .08.
# It matters where gyro or accelerometer have a bias, as all have: it stays in the data, and inertia or
# thrust take it up, while the bias that is told is the end of its range.
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
STATE = sysid.create_initial_state(MODEL, np.zeros(1))
CONTROL = sysid.TimeSeries.from_control_names(TIMES, TORQUE, MODEL)
FLIGHT = sysid.sysid_rollout(MODEL, mujoco.MjData(MODEL), CONTROL, STATE)[0].sensordata


def set_inertia(spec, parameter):
    spec.body("drone").inertia[0] = parameter.value[0]


def residual_of(measured, kind, target):
    """Return the function of the residual, with a bias or a gain of the gyro."""
    rates = sysid.TimeSeries.from_names(FLIGHT.times, measured, MODEL)
    log = sysid.ModelSequences("stand", SPEC, "log", STATE, CONTROL, rates)
    transform = sysid.SignalTransform()
    getattr(transform, kind)("gyro", sysid.Parameter(kind, 0.0, -1.0, 2.0), **target)
    return sysid.build_residual_fn(
        models_sequences=[log], modify_residual=transform.apply, n_threads=1
    )


def fit_bias(**target):
    """Return Ixx and the gyro's bias, .1 rad/s in truth."""
    inertia = sysid.Parameter("Ixx", 0.012, 0.006, 0.03, modifier=set_inertia)
    bias = sysid.Parameter("bias", 0.02, -1.0, 1.0)
    guess = sysid.ParameterDict({"Ixx": inertia, "bias": bias})
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(guess, residual_of(FLIGHT.data + 0.1, "bias", target))
    return [round(float(found[name].value[0]), 5) for name in ("Ixx", "bias")]


def gain_matters(**target):
    """Return the largest change of the residual from a gain of .5 to one of 2."""
    residual = residual_of(FLIGHT.data * 1.1, "gain", target)
    guess = sysid.ParameterDict({"gain": sysid.Parameter("gain", 1.0, 0.5, 2.0)})
    low, high = (residual(np.array([gain]), guess)[0][0] for gain in (0.5, 2.0))
    return float(np.abs(high - low).max())


usual, told = fit_bias(), fit_bias(target="predicted")
print("Ixx [kg m^2] and bias [rad/s]", usual, 'with target="predicted"', told)
same, changed = gain_matters(), gain_matters(target="predicted")
print("change of the residual by the gain", same, 'with target="predicted"', round(changed, 4))
assert abs(usual[0] - 0.00945) < 1e-4 and usual[1] == 1.0
assert abs(told[0] - 0.01) < 1e-5 and abs(told[1] - 0.1) < 1e-4
assert same < 1e-12 and changed > 0.01
PY
