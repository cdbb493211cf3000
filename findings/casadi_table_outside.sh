#!/bin/sh
# CasADi 3.8.2: outside its grid, a table by `interpolant` goes on along its last piece with the
# plugin "linear" and is zero with the plugin "bspline", without a warning. A motor's table from
# command to thrust, made for 0 to 1 and asked at 1.2, gives no thrust at all.
# Seen: thrust at command 1.0 and 1.2: linear 8.0, 9.6; bspline 8.0, 0.0.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q casadi==3.8.2
"$folder/venv/bin/python" - <<'PY'
import casadi

command = [0.0, 0.25, 0.5, 0.75, 1.0]
thrust = [8.0 * u for u in command]
seen = {}
for plugin in ("linear", "bspline"):
    table = casadi.interpolant("table", plugin, [command], thrust)
    seen[plugin] = [round(float(table(u)), 9) for u in (1.0, 1.2)]
print(seen)
assert seen == {"linear": [8.0, 9.6], "bspline": [8.0, 0.0]}
PY
