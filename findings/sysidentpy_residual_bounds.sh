#!/bin/sh
# SysIdentPy 0.9.0: the bounds that its residual tests compare with are too narrow by the square root of 2.
# `compute_residues_autocorrelation` and `compute_cross_correlation` take 1.96/sqrt(n) with n = 2 N - 1, the
# length of the two-sided correlation, in place of the number of samples N. They return one side of it alone. The
# documentation calls them the bounds of the confidence interval; `plot_residues_correlation` draws them.
# Seen for 1000 samples of white noise as residuals, 500 times: bounds of +-0.0438 where 1.96/sqrt(1000) is
# 0.0620; 16 % of the first 50 lags of the autocorrelation are outside (and of the correlation with a white input
# 15 %) where 5 % should be; of the bounds times the square root of 2 it is 5 %.
# It matters where the order of a model, a lag or a delay is judged by its residuals: eight lags in fifty object
# to a model that is right, and terms are added to it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q sysidentpy==0.9.0
cd "$folder"
export MPLCONFIGDIR="$folder" MPLBACKEND=Agg
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from sysidentpy.residues.residues_correlation import (
    compute_cross_correlation,
    compute_residues_autocorrelation,
)

SAMPLES, LAGS, TRIALS = 1000, 50, 500
random = np.random.default_rng(0)
beyond = {"autocorrelation": [], "cross correlation": []}
wider = {"autocorrelation": [], "cross correlation": []}
bounds = set()
for _ in range(TRIALS):
    residuals, command = random.normal(size=(2, SAMPLES))
    predicted = np.zeros(SAMPLES)
    own, upper, lower = compute_residues_autocorrelation(residuals, predicted)
    cross, upper_cross, _ = compute_cross_correlation(residuals, predicted, command)
    bounds |= {round(upper, 9), round(-lower, 9), round(upper_cross, 9)}
    for name, values in (
        ("autocorrelation", own[1 : LAGS + 1]),
        ("cross correlation", cross[:LAGS]),
    ):
        beyond[name].append(np.mean(np.abs(values) > upper))
        wider[name].append(np.mean(np.abs(values) > np.sqrt(2.0) * upper))
(bound,) = bounds
print("bound", round(bound, 4), "right", round(1.96 / np.sqrt(SAMPLES), 4))
for name in beyond:
    outside, right = np.mean(beyond[name]), np.mean(wider[name])
    print(f"{name}: {outside:.3f} of the lags outside, {right:.3f} of bounds times sqrt(2)")
    assert 0.14 < outside < 0.18 and 0.035 < right < 0.06
assert np.isclose(bound, 1.96 / np.sqrt(2 * SAMPLES - 1))
PY
