#!/bin/sh
# python-control 0.10.2: `pade(T, n)` has a numerator of the same degree as its denominator, so that
# the delay it stands for answers a step at once: by -1 of the step for an odd n, by +1 for an even
# one. Only pade(T, n, numdeg=n - 1) begins at 0, as a delay does.
# Seen: the first value of the step response of a delay of .1 s: -1 (n = 1), +1 (2), -1 (3); with
# numdeg = n - 1: 0.
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


def first_value(*arguments):
    delay = control.tf(*control.pade(0.1, *arguments))
    return float(control.step_response(delay, T=np.linspace(0.0, 0.5, 6))[1][0])


usual = [round(first_value(n), 9) for n in (1, 2, 3)]
strict = [round(first_value(n, n - 1), 9) for n in (1, 2, 3)]
print("pade(T, n):", usual, "pade(T, n, n - 1):", strict)
assert usual == [-1.0, 1.0, -1.0] and np.allclose(strict, 0.0)
PY
