#!/bin/sh
# pinocchio 4.1.0, buildModelFromMJCF: an MJCF with the conventions of ROS becomes another vehicle than in
# MuJoCo 4.0.0. First, `eulerseq` in capitals, angles about fixed axes as in roll, pitch, yaw of a URDF, is
# read as if in small letters, about axes that move along. Second, the mass of a geom is ignored
# where it stands in a default class: the geom weighs 1000 kg/m^3. (Density in a class, mass at the geom
# and <inertial> are read right.) Nothing is said of either.
# Seen: a rotor at "20 30 40" degrees, eulerseq "XYZ": 26.1 degrees off, with "xyz" 0. A body of one box of
# .2 x .4 x .1 m, its mass .3 kg in the default class: 8.0 kg, and at the geom .3 kg.
# It matters where a file of MuJoCo is used for control or planning in pinocchio: canted rotors and arms
# point elsewhere, and mass and inertia are those of solid blocks.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0 pin==4.1.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import mujoco
import numpy as np
import pinocchio

CANTED = """<mujoco model="drone"><compiler eulerseq="{}"/><worldbody><body name="base"><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.025"/>
<body name="rotor" euler="20 30 40"><joint type="hinge" axis="0 0 1"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.002 0.0025"/></body></body></worldbody></mujoco>"""
BOX = """<mujoco model="drone"><default><geom {}/></default><worldbody><body name="base"><freejoint/>
<geom type="box" size="0.1 0.2 0.05" {}/></body></worldbody></mujoco>"""


def read(text):
    with open("drone.xml", "w") as file:
        file.write(text)
    return mujoco.MjModel.from_xml_path("drone.xml"), pinocchio.buildModelFromMJCF("drone.xml")


def angle_deg(sequence):
    """Return the angle between the rotor in MuJoCo and in pinocchio."""
    model, other = read(CANTED.format(sequence))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    between = data.body("rotor").xmat.reshape(3, 3).T @ other.jointPlacements[2].rotation
    return round(float(np.degrees(np.linalg.norm(pinocchio.log3(between)))), 3)


def masses(in_class, at_geom):
    model, other = read(BOX.format(in_class, at_geom))
    return [round(float(mass), 6) for mass in (model.body("base").mass[0], other.inertias[1].mass)]


fixed, moving = angle_deg("XYZ"), angle_deg("xyz")
print("rotor off by [degrees], eulerseq XYZ", fixed, "xyz", moving)
by_class, by_geom = masses('mass="0.3"', ""), masses("", 'mass="0.3"')
by_density = masses('density="37.5"', "")
print("mass in MuJoCo and pinocchio [kg], in the class", by_class, "at the geom", by_geom)
print("by the density in the class", by_density)
assert abs(fixed - 26.097) < 0.01 and moving < 0.001
assert by_class == [0.3, 8.0] and by_geom == by_density == [0.3, 0.3]
PY
