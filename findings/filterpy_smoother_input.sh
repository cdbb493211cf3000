#!/bin/sh
# FilterPy 2.0.0: `KalmanFilter.rts_smoother` leaves out the input. `batch_filter` takes inputs (`us`), predicts
# with F x + B u and returns what the smoother's documentation says to pass on; the smoother predicts with F x
# alone, and pulls each state from the right one towards one that had no input. It has no argument for it, and
# says nothing. That of `UnscentedKalmanFilter` calls `fx` without the arguments of `predict`, too (read).
# Seen, height from a barometer, acceleration as input, steady at 9.81 m/s^2, no noise: in the middle of
# the flight the filter is right, the smoother is 2.2 m/s and 1.8 m off. Without acceleration, or with it as
# a third state in place of an input, the smoother is right.
# It matters where speeds are smoothed from positions with accelerometer, gyro or thrust as input: the error is
# in proportion to the input, and the smoothed covariance does not show it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q filterpy==2.0.0 numpy scipy
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from filterpy.kalman import KalmanFilter

STEP, COUNT = 0.1, 100  # s
TIMES = STEP * np.arange(1, COUNT + 1)
MOVE = np.array([[1.0, STEP], [0.0, 1.0]])
PUSH = np.array([[STEP**2 / 2], [STEP]])


def estimates(acceleration, as_state):
    """Return the errors of filter and smoother in height and speed, half way."""
    size = 3 if as_state else 2
    kalman = KalmanFilter(dim_x=size, dim_z=1, dim_u=1)
    kalman.F[:2, :2] = MOVE
    kalman.B = np.vstack([PUSH, np.zeros((size - 2, 1))])
    if as_state:  # the same acceleration as a third, known state
        kalman.F[:2, 2:] = PUSH
    kalman.H = np.eye(1, size)
    kalman.Q = np.diag([1e-4, 1e-3, 1e-12][:size])
    kalman.R *= 0.01
    kalman.P = np.diag([1.0, 1.0, 1e-12][:size])
    kalman.x = np.array([0.0, 0.0, acceleration][:size]).reshape(-1, 1)
    heights = acceleration * TIMES**2 / 2
    inputs = [np.array([[0.0 if as_state else acceleration]])] * COUNT
    means, covariances, _, _ = kalman.batch_filter(list(heights), us=inputs)
    smoothed = kalman.rts_smoother(means, covariances)[0]
    truth = np.column_stack([heights, acceleration * TIMES])[COUNT // 2]
    return [(found[COUNT // 2, :2, 0] - truth).round(2) + 0.0 for found in (means, smoothed)]


for name, acceleration, as_state in (
    ("no acceleration", 0.0, False),
    ("as input", 9.81, False),
    ("as state", 9.81, True),
):
    filtered, smoothed = estimates(acceleration, as_state)
    print(name, "filter off by [m, m/s]", filtered.tolist(), "smoother", smoothed.tolist())
    assert np.allclose(filtered, 0.0, atol=0.01)
    wrong = [-1.84, 2.20] if name == "as input" else [0.0, 0.0]
    assert np.allclose(smoothed, wrong, atol=0.02)
PY
