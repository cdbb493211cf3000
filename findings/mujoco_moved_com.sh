#!/bin/sh
# MuJoCo 4.0.0, MJX 3.17.0 and MuJoCo Warp 4.0.0: a centre of mass moved in a compiled model
# (`body_ipos`) does not move if the file had it at the body's origin, with the body's axes as
# principal axes. MuJoCo flies on as if nothing had changed. MJX and Warp move the point at which
# gravity pulls, but keep the mass matrix diagonal: a body without any thrust tumbles in free fall.
# No step says so. Only MuJoCo's `mj_setConst` objects, if it is called; it wants simple="false" for
# the body in the file, which cures MJX and Warp, and MuJoCo together with `mj_setConst`. Of such a
# body, MuJoCo takes a new `body_mass` for its weight, but not for its inertia.
# Seen for 1 kg, Iyy 0.02 kg m^2, the centre of mass 2 cm ahead of the thrust, 10 m/s^2: pitch
# acceleration in hover and in free fall 10, 0 rad/s^2 with the 2 cm in the file; moved in the model
# 0, 0 in MuJoCo, and 9.8, 9.8 in MJX and Warp; with simple="false" 10, 0 in MJX and Warp, and in
# MuJoCo 0, 0 before `mj_setConst` and 10, 0 after it. With body_mass twice that of the file it
# falls at 20 m/s^2 in MuJoCo; at 10 m/s^2 if the file has the 2 cm.
# It matters where the vehicles of an identified spread are written into one model, which is quicker
# than compiling each: if that model was balanced, the offset of the centre of mass is lost, or
# flown wrongly.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0 mujoco-mjx==3.17.0 mujoco-warp==4.0.0 \
    warp-lang==1.19.0 jax==0.10.2 jaxlib==0.10.2
WARP_CACHE_PATH="$folder/cache" "$folder/venv/bin/python" - <<'PY' 2>/dev/null
import jax
import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco import mjx

warp.config.log_level = warp.LOG_ERROR
XML = """<mujoco><option gravity="0 0 -10"/><worldbody><body {}><freejoint/>
<inertial pos="{} 0 0" mass="1" diaginertia="0.01 0.02 0.025"/><site name="s"/></body></worldbody>
<actuator><general site="s" gear="0 0 1 0 0 0"/></actuator></mujoco>"""
AHEAD = 0.02
forward = jax.jit(mjx.forward)
THRUSTS = {"hover": 10.0, "free fall": 0.0}


def pitches(x, moved, simple="", renewed=False):
    """Return the pitch acceleration in hover and in free fall, in MuJoCo, MJX and MuJoCo Warp."""
    rows = []
    for thrust in THRUSTS.values():
        model = mujoco.MjModel.from_xml_string(XML.format(simple, x))
        data = mujoco.MjData(model)
        data.ctrl[0] = thrust
        there, by_mjx = mjx.put_model(model), mjx.put_data(model, data)
        on_warp, by_warp = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data)
        if moved:
            model.body_ipos[1, 0] = AHEAD
            there = there.replace(body_ipos=there.body_ipos.at[1, 0].set(AHEAD))
            on_warp.body_ipos = warp.array(model.body_ipos[None], dtype=warp.vec3)
        if renewed:
            mujoco.mj_setConst(model, data)
        mujoco.mj_forward(model, data)
        by_mjx = forward(there, by_mjx)
        mujoco_warp.forward(on_warp, by_warp)
        found = (data.qacc, by_mjx.qacc, by_warp.qacc.numpy()[0])
        rows.append([round(float(each[4]), 2) + 0.0 for each in found])
    return [list(pair) for pair in zip(*rows)]


compiled = pitches(AHEAD, moved=False)
moved = pitches(0.0, moved=True)
general = pitches(0.0, moved=True, simple='simple="false"')
renewed = pitches(0.0, moved=True, simple='simple="false"', renewed=True)
print("pitch acceleration in", " and ".join(THRUSTS), "[rad/s^2], in MuJoCo, MJX and Warp")
for label, found in (("in the file", compiled), ("moved", moved), ("moved, not simple", general)):
    print(label + ":", *found)
print("moved, not simple, mj_setConst:", *renewed)
right, ignored, mixed = [10.0, 0.0], [0.0, 0.0], [9.8, 9.8]
assert compiled == renewed == [right] * 3
assert moved == [ignored, mixed, mixed]
assert general == [ignored, right, right]

falls = []
for x in (0.0, AHEAD):
    model = mujoco.MjModel.from_xml_string(XML.format("", x))
    data = mujoco.MjData(model)
    model.body_mass[1] = 2.0
    mujoco.mj_forward(model, data)
    falls.append(round(float(data.qacc[2]), 6))
print("fall with twice the mass [m/s^2], the centre of mass at the origin and ahead:", *falls)
assert falls == [-20.0, -10.0]

model = mujoco.MjModel.from_xml_string(XML.format("", 0))
model.body_ipos[1, 0] = AHEAD
try:
    mujoco.mj_setConst(model, mujoco.MjData(model))
except mujoco.FatalError as error:
    print("mj_setConst:", error)
else:
    raise AssertionError("mj_setConst takes the moved centre of mass")
PY
