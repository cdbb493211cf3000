#!/bin/sh
# python-control 0.10.2: `eigensys_realization` gives a direct term D that is 1/dt times too large. With a `dt`
# it takes impulse responses of unit area, as `impulse_response` and `markov` of python-control give them
# (the first value is D/dt), and multiplies B with dt, but takes the first value for D as it is.
# Its documentation names the unit-area impulse, and not D.
# Seen for a motor with D = 0.5 sampled at 100 Hz: A, C B right, D = 50 both from `impulse_response` and from
# `markov`; the gain at rest is 52 in place of 2.5. With dt = True, or D = 0, it is right.
# It matters where the output follows the input within the sample: thrust or acceleration from commands,
# or delays that are taken off before the fit.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q control==0.10.2
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import control
import numpy as np


def realised(direct, step):
    """Return D and the gain at rest from the impulse response, and D from input and output."""
    motor = control.ss([[0.9]], [[0.2]], [[1.0]], [[direct]], step)
    times = np.arange(400) * (1 if step is True else step)
    response = control.impulse_response(motor, T=times[:40])
    found, _ = control.eigensys_realization(response, 1, dt=step)
    assert np.allclose([found.A, found.C @ found.B], [motor.A, motor.C @ motor.B])
    commands = np.random.default_rng(0).normal(size=times.size)
    flight = control.forced_response(motor, T=times, inputs=commands)
    from_flight, _ = control.eigensys_realization(control.markov(flight, m=100), 1, dt=step)
    gain = float(np.real(control.dcgain(found)))
    return [round(float(x), 2) + 0.0 for x in (found.D[0, 0], gain, from_flight.D[0, 0])]


usual, counted, none = realised(0.5, 0.01), realised(0.5, True), realised(0.0, 0.01)
print("D 0.5, dt .01: D, gain at rest, D by markov", usual)
print("D 0.5, dt True", counted, "D 0, dt .01", none)
assert np.allclose(usual, [50.0, 52.0, 50.0], atol=0.1)
assert np.allclose(counted, [0.5, 2.5, 0.5], atol=0.01)
assert np.allclose(none, [0.0, 2.0, 0.0], atol=0.1)
PY
