#!/bin/sh
# simdkalman 1.0.4: without `initial_covariance` the covariance of the first state is 25 times the trace of the
# observation matrix H. If H's first state is not the measured one, that is zero: the first state counts as exact, at
# 0 unless `initial_value` is given; with a minus in H it is negative. The documentation has the argument as the
# initial uncertainty, without its default.
# Seen for a constant rate of 0.5 rad/s and 200 samples of a gyro with 0.1 rad/s of noise: with the rate as second
# state, after the angle, the filter ends at 0 with a standard deviation of 0; with the rate as first state, or with a
# covariance given, at 0.5015 +- 0.0071. Where a height is measured as -z, the speed begins with a variance of -25.
# It matters where a constant (a gyro's bias, a thrust coefficient) is a state of a Kalman filter: by the order of the
# states it stays at its first guess, and its interval says that it is exact.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q simdkalman==1.0.4 numpy==2.1.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
import simdkalman

STEP, NOISE, RATE = 0.01, 0.1, 0.5  # s, rad/s, rad/s
gyro = RATE + NOISE * np.random.default_rng(0).normal(size=200)


def filtered(transition, observed, values, **options):
    """Return means and variances of the filtered states at all samples."""
    model = simdkalman.KalmanFilter(
        state_transition=np.array(transition),
        process_noise=np.zeros((len(transition), len(transition))),
        observation_model=np.array([observed]),
        observation_noise=np.array([[NOISE**2]]),
    )
    found = model.compute(values, 0, filtered=True, smoothed=False, **options).filtered.states
    return found.mean, np.array([np.diag(covariance) for covariance in found.cov])


angle_first = [[1.0, STEP], [0.0, 1.0]], [0.0, 1.0]
rate_first = [[1.0, 0.0], [STEP, 1.0]], [1.0, 0.0]
means, variances = filtered(*angle_first, gyro)
hidden = means[-1, 1], variances[-1, 1]
means, variances = filtered(*rate_first, gyro)
shown = means[-1, 0], variances[-1, 0]
means, variances = filtered(*angle_first, gyro, initial_covariance=25.0 * np.eye(2))
told = means[-1, 1], variances[-1, 1]
minus = filtered([[1.0, STEP], [0.0, 1.0]], [-1.0, 0.0], gyro)[1][0, 1]
for name, (mean, variance) in (
    ("second state", hidden),
    ("first state", shown),
    ("second state, covariance given", told),
):
    print(f"rate as {name}: {mean:.4f} +- {np.sqrt(variance):.4f} rad/s, right {RATE}")
print(f"first variance of the speed where -z is measured: {minus:.1f}")
assert hidden == (0.0, 0.0)
for mean, variance in (shown, told):
    assert abs(mean - RATE) < 0.03 and abs(np.sqrt(variance) - NOISE / np.sqrt(200.0)) < 1e-3
assert np.isclose(minus, -25.0)
PY
