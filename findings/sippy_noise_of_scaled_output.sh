#!/bin/sh
# SIPPY 1.0.1 (sippy_unipi): the subspace methods N4SID, MOESP and CVA divide inputs and outputs by their standard
# deviations, and scale A, B, C, D and the gain K back, but not the covariances: R, S and Vn are those of an
# output with a standard deviation of 1, beside a C in the units of the data. The code calls them covariances, and
# Vn the variance of the residuals; that they have no unit is not said. The Vn of ARX is half of the mean square
# besides.
# Seen for a rate with noise of 0.05 rad/s in each step and of 0.1 rad/s in the gyro, so that its innovations have
# a variance of 0.0153: R = 0.413, and 0.413 too for the same flight in deg/s, where 50.3 is right; times the
# variance of the output it is 0.0152 and 50.0. C K is 0.30 (right: 0.31); of a Kalman filter made of A, C, Q, R
# and S it is 0.06 in rad/s and 1.32 in deg/s.
# It matters where an identified model goes on to a Kalman filter, or its residuals to an interval: the noise is
# wrong by the variance of the output, which is that of the manoeuvres.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q sippy_unipi==1.0.1 scipy
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
import sippy_unipi
from scipy.linalg import solve_discrete_are

STEP_NOISE, GYRO_NOISE = 0.05, 0.1  # rad/s
DEGREES = 180.0 / np.pi
random = np.random.default_rng(0)
command = random.normal(size=20000)
rate = np.zeros(len(command))
for k in range(1, len(command)):
    rate[k] = 0.9 * rate[k - 1] + 0.05 * command[k - 1] + STEP_NOISE * random.normal()
measured = rate + GYRO_NOISE * random.normal(size=len(rate))


def kalman(a, c, q, r, s):
    """Return the variance of the innovations and C times the gain of the Kalman filter."""
    spread = solve_discrete_are(a.T, c.T, q, r, s=s)
    innovation = c @ spread @ c.T + r
    gain = (a @ spread @ c.T + s) @ np.linalg.inv(innovation)
    return float(innovation[0, 0]), float((c @ gain)[0, 0])


one = np.eye(1)
variance, gain = kalman(0.9 * one, one, STEP_NOISE**2 * one, GYRO_NOISE**2 * one, 0.0 * one)
print("right: variance of the innovations", round(variance, 4), "C K", round(gain, 3))
found = {}
for method in ("N4SID", "MOESP", "CVA"):
    for name, unit in (("rad/s", 1.0), ("deg/s", DEGREES)):
        output = unit * measured
        model = sippy_unipi.system_identification(
            output.copy(), command.copy(), method, SS_fixed_order=1
        )
        noise = float(model.R[0, 0])
        own = float((model.C @ model.K)[0, 0])
        of_covariances = kalman(model.A, model.C, model.Q, model.R, model.S)[1]
        print(f"{method} in {name}: R {noise:.3f}, right {unit**2 * variance:.4g},", end=" ")
        print(f"R times variance {noise * output.var():.4g},", end=" ")
        print(f"C K {own:.2f}, of Q, R and S {of_covariances:.2f}")
        found[method, name] = noise, of_covariances
        assert abs(noise * output.var() / (unit**2 * variance) - 1.0) < 0.05
        assert abs(own / gain - 1.0) < 0.1
    assert np.isclose(found[method, "rad/s"][0], found[method, "deg/s"][0], rtol=1e-3)
    assert found[method, "rad/s"][1] < 0.1 and found[method, "deg/s"][1] > 1.0
model = sippy_unipi.system_identification(
    measured.copy(), command.copy(), "ARX", ARX_orders=[1, 1, 0]
)
square = float(np.mean((measured - model.Yid[0])[1:] ** 2))
print(f"ARX: Vn {model.Vn:.3f}, mean square {square:.4f}, over twice the variance of the output", end="")
print(f" {square / (2.0 * measured.var()):.3f}")
assert np.isclose(model.Vn, square / (2.0 * measured.var()), rtol=0.01)
PY
