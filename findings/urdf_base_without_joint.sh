#!/bin/sh
# MuJoCo 4.0.0 and pinocchio 4.1.0: a URDF of one free body, as exporters write it, is welded to the
# world, since a URDF cannot say that its base is free. MuJoCo drops the mass as well; pinocchio has a
# second argument (JointModelFreeFlyer) for it, MuJoCo needs a free joint written by hand.
# (PyBullet 3.2.7 takes such a file as a free body: see pybullet_damping.sh.)
# Seen: MuJoCo 0 degrees of freedom, mass 0; pinocchio 0 and 0, with the free flyer 6 and 1.3.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0 pin==4.1.0
"$folder/venv/bin/python" - <<'PY'
import mujoco
import pinocchio

URDF = """<robot name="drone"><link name="base"><inertial><origin xyz="0 0 0" rpy="0 0 0"/>
<mass value="1.3"/><inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/>
</inertial></link></robot>"""
by_mujoco = mujoco.MjModel.from_xml_string(URDF)
fixed = pinocchio.buildModelFromXML(URDF)
free = pinocchio.buildModelFromXML(URDF, pinocchio.JointModelFreeFlyer())
seen = {
    "mujoco": (by_mujoco.nv, float(by_mujoco.body_mass.sum())),
    "pinocchio": (fixed.nv, pinocchio.computeTotalMass(fixed)),
    "pinocchio, free flyer": (free.nv, pinocchio.computeTotalMass(free)),
}
print(seen)
assert seen["mujoco"] == (0, 0.0) and seen["pinocchio"] == (0, 0.0)
assert seen["pinocchio, free flyer"] == (6, 1.3)
PY
