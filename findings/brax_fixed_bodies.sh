#!/bin/sh
# Brax 0.14.2: `mjcf.load` and `mjcf.loads` lay a body without a joint into its parent, and lose its turn on the
# way: always if it has no `pos` of its own, and unless it is a `quat` otherwise. A vehicle with an arm as a body
# turned four times has its four arms on top of each other. An <inertial> of such a body becomes that of the whole
# vehicle. Nothing is said of it; the documentation says that such bodies are fused. MuJoCo takes all of it as
# written. (Brax warns that it is no longer maintained.)
# Seen for a box of 0.5 kg with four arms of 50 g at 45, 135, 225, 315 degrees: centre of mass 31 mm off, Ixx
# .0005 and Iyy .0028 where both are .0020, by `quat` and `euler` alike; one arm turned to the left, with a `pos`:
# right by `quat`, ahead by `euler`; a box of 0.5 kg with a battery of 0.2 kg that has an <inertial>: 0.2 kg in
# all.
# It matters where a controller is trained in Brax for a vehicle that is put together of parts. One <inertial> for
# the whole vehicle, in its one body, arrives right.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q brax==0.14.2 mujoco==4.0.0 mujoco-mjx==3.17.0
cd "$folder"
export JAX_PLATFORMS=cpu
"$folder/venv/bin/python" -W ignore - 2> errors.txt <<'PY' || { cat errors.txt; exit 1; }
import mujoco
import numpy as np
from brax import math
from brax.io import mjcf

BOX = '<geom type="box" size="0.05 0.05 0.02" mass="0.5"/>'
ARM = '<geom type="capsule" fromto="0.02 0 0 0.2 0 0" size="0.01" mass="0.05"/>'
BATTERY = '<inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>'


def vehicle(parts, fused="false"):
    return f"""<mujoco><compiler fusestatic="{fused}"/><worldbody>
      <body name="drone" pos="0 0 1"><freejoint/>{parts}</body></worldbody></mujoco>"""


def by_quaternion(angle):
    half = np.radians(angle) / 2.0
    return f'quat="{np.cos(half)} 0 0 {np.sin(half)}"'


def by_euler(angle):
    return f'euler="0 0 {angle}"'


def with_arms(turn):
    return BOX + "".join(f"<body {turn(angle)}>{ARM}</body>" for angle in (45, 135, 225, 315))


def shown(mass, centre, quaternion, moments):
    """Return mass [kg], centre of mass [m] and moments of inertia along x, y, z [kg m^2]."""
    turn = np.array(math.quat_to_3x3(quaternion))
    tensor = turn @ moments @ turn.T
    return round(float(mass), 6), np.round(centre, 5) + 0.0, np.diag(tensor).round(6)


def in_mujoco(parts):
    body = mujoco.MjModel.from_xml_string(vehicle(parts, fused="true")).body("drone")
    return shown(body.mass[0], body.ipos, body.iquat, np.diag(body.inertia))


def in_brax(parts):
    link = mjcf.loads(vehicle(parts)).link.inertia
    return shown(link.mass[0], link.transform.pos[0], link.transform.rot[0], np.array(link.i[0]))


def with_arm(turn):
    return BOX + f'<body pos="0.01 0 0" {turn(90)}>{ARM}</body>'


battery = BOX + f'<body pos="0.05 0 0">{BATTERY}</body>'
whole = BOX + '<inertial pos="0.01 0 0" mass="0.7" diaginertia="0.0018 0.0018 0.0031"/>'
cases = {"quat": with_arms(by_quaternion), "euler": with_arms(by_euler)}
others = {
    "one arm, pos and quat": with_arm(by_quaternion),
    "one arm, pos and euler": with_arm(by_euler),
    "battery": battery,
    "whole": whole,
}
for name, parts in {**cases, **others}.items():
    print(name)
    for program, (mass, centre, moments) in (("MuJoCo", in_mujoco(parts)), ("Brax", in_brax(parts))):
        print(f"  {program}: {mass} kg, centre {centre} m, Ixx Iyy Izz {moments} kg m^2")
for parts in cases.values():
    right, found = in_mujoco(parts), in_brax(parts)
    assert right[0] == found[0] == 0.7
    assert np.allclose(right[1], 0.0) and np.allclose(found[1], [0.03143, 0.0, 0.0])
    assert np.isclose(right[2][0], right[2][1]) and found[2][1] > 5.0 * found[2][0]
centres = [in_mujoco(with_arm(by_euler))[1]]
centres += [in_brax(with_arm(turn))[1] for turn in (by_quaternion, by_euler)]
assert np.allclose(centres, [[0.00091, 0.01, 0], [0.00091, 0.01, 0], [0.01091, 0, 0]], atol=1e-5)
assert in_mujoco(battery)[0] == 0.7 and in_brax(battery)[0] == 0.2
assert np.allclose(in_mujoco(battery)[1], [0.01429, 0.0, 0.0])
assert np.allclose(in_brax(battery)[1], 0.0)
for right, found in zip(in_mujoco(whole), in_brax(whole)):
    assert np.allclose(right, found)
PY
