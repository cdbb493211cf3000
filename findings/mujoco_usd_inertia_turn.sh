#!/bin/sh
# mujoco-usd-converter 0.8.0 (with MuJoCo 3.16.0): the turn of `<inertial>` is lost where an MJCF gives it as
# `euler`, `axisangle`, `xyaxes` or `zaxis`: the principal moments go to USD about the body's own axes.
# `quat` and `fullinertia` arrive right, and so does the `euler` of a body. Nothing is said of it; the list of
# features promises complete mass properties.
# Seen for principal moments .01, .02, .025 kg m^2 turned by 30 degrees about z: Ixy 0 in USD for each of
# euler, axisangle and xyaxes, and -.00433 in MuJoCo; Ixx .01 and .0125. With quat -.00433 in both.
# It matters where a model of MuJoCo is taken to Newton, Isaac Sim or another reader of USD: mass and
# moments look right, and a torque about one axis turns the vehicle about another one.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco-usd-converter==0.8.0 mujoco==3.16.0 usd-exchange==3.0.1
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import mujoco
import mujoco_usd_converter
import numpy as np
from pxr import Usd, UsdPhysics

DRONE = """<mujoco model="drone"><worldbody><body name="base"><freejoint/>
<inertial pos="0 0 0" mass="1" {}/></body></worldbody></mujoco>"""
MOMENTS = 'diaginertia="0.01 0.02 0.025" '
TURNS = {
    "euler": MOMENTS + 'euler="0 0 30"',
    "axisangle": MOMENTS + 'axisangle="0 0 1 30"',
    "xyaxes": MOMENTS + 'xyaxes="0.8660254 0.5 0 -0.5 0.8660254 0"',
    "quat": MOMENTS + 'quat="0.9659258 0 0 0.2588190"',
    "fullinertia": 'fullinertia="0.0125 0.0175 0.025 -0.004330127 0 0"',
}


def tensor(quaternion, moments):
    """Return Ixx and Ixy about the body's axes."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.array(quaternion, dtype=float))
    turn = turn.reshape(3, 3)
    inertia = turn @ np.diag(moments) @ turn.T
    return [round(float(inertia[0, column]), 5) + 0.0 for column in (0, 1)]


def read_usd(folder):
    """Return Ixx and Ixy of the drone in USD."""
    stage = Usd.Stage.Open(mujoco_usd_converter.Converter().convert("drone.xml", folder).path)
    (body,) = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    mass = UsdPhysics.MassAPI(body)
    axes = mass.GetPrincipalAxesAttr().Get()
    return tensor((axes.GetReal(), *axes.GetImaginary()), mass.GetDiagonalInertiaAttr().Get())


for name, turn in TURNS.items():
    with open("drone.xml", "w") as file:
        file.write(DRONE.format(turn))
    model = mujoco.MjModel.from_xml_path("drone.xml")
    there, here = read_usd("usd_" + name), tensor(model.body_iquat[1], model.body_inertia[1])
    print(name, "Ixx and Ixy [kg m^2] in USD", there, "in MuJoCo", here)
    assert here == [0.0125, -0.00433]
    assert there == (here if name in ("quat", "fullinertia") else [0.01, 0.0])
PY
