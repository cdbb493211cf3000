#!/bin/sh
# MuJoCo 4.0.0: the activation dynamics "filterexact" is exact under the integrators Euler and
# implicitfast, and inexact under RK4, the integrator of higher order.
# Seen for a unit step, time constant 35 ms, time step 2 ms, after one time step: relative error 0
# (Euler), 0 (implicitfast), -2.80 % (RK4).
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0
"$folder/venv/bin/python" - <<'PY'
import math
import mujoco

XML = """<mujoco><option timestep="0.002" integrator="{}"/><worldbody><body><freejoint/>
<geom size=".1" mass="1"/><site name="s"/></body></worldbody><actuator>
<general site="s" gear="0 0 1 0 0 0" dyntype="filterexact" dynprm="0.035"/></actuator></mujoco>"""
error = {}
for integrator in ("Euler", "implicitfast", "RK4"):
    model = mujoco.MjModel.from_xml_string(XML.format(integrator))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data)
    error[integrator] = data.act[0] / (1.0 - math.exp(-0.002 / 0.035)) - 1.0
print(error)
assert abs(error["Euler"]) < 1e-12 and abs(error["implicitfast"]) < 1e-12
assert abs(error["RK4"] + 0.0280) < 0.0005
PY
