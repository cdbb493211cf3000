#!/bin/sh
# PySINDy 2.1.0: with `normalize_columns=True` the `threshold` of STLSQ is one for coefficients times the norm of
# their column, a sum over all samples. The documentation calls it the least magnitude of a coefficient in the
# weight vector, and the normalisation a division by the L2 norm; that both together depend on the length of
# the log is not said. The coefficients that are returned are in the units of the data again.
# Seen for a rate w with w' = -2 w + 5 u and noise, all six terms of second order, w and u of size 1: threshold
# 100 keeps of 100 samples nothing, of 1000 u alone, of 10000 w and u; threshold 0.1 keeps of 10000 all six,
# the least of them 0.001. Without normalisation 0.1 keeps w and u of all three.
# It matters where drag or couplings are sought by SINDy: a longer log of the same flying has more terms, and a
# threshold found on one log is another on the next.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pysindy==2.1.0
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
import pysindy

COUNTS = (100, 1000, 10000)


def kept(count, normalised, threshold):
    """Return the terms that are kept, with their coefficients."""
    random = np.random.default_rng(0)
    rate, command, noise = random.normal(size=(3, count, 1))
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=threshold, alpha=0.0, normalize_columns=normalised),
        feature_library=pysindy.PolynomialLibrary(degree=2),
    )
    change = -2.0 * rate + 5.0 * command + 0.3 * noise
    model.fit(rate, t=0.01, x_dot=change, u=command, feature_names=["w", "u"])
    pairs = zip(model.get_feature_names(), model.coefficients()[0].tolist())
    return {name: round(value, 4) for name, value in pairs if value != 0.0}


plain = [kept(count, False, 0.1) for count in COUNTS]
high = [kept(count, True, 100.0) for count in COUNTS]
low = [kept(count, True, 0.1) for count in COUNTS]
print("plain, threshold 0.1:", plain)
print("normalised, threshold 100:", high)
print("normalised, threshold 0.1:", low)
assert all(set(found) == {"w", "u"} for found in plain)
assert [set(found) for found in high] == [set(), {"u"}, {"w", "u"}]
assert all(len(found) >= 4 for found in low)
assert min(abs(value) for value in low[2].values()) < 0.01
PY
