#!/bin/sh
# PyBullet 3.2.7: `changeDynamics(body, -1, mass=...)` replaces the inertia of a body by that of its
# collision shape, even where the mass stays as it is and the body was loaded with
# URDF_USE_INERTIA_FROM_FILE. A body without a collision shape keeps nearly no inertia. With
# localInertiaDiagonal in the same call, that is taken.
# Seen for 1.3 kg and 0.01, 0.02, 0.025 kg m^2 of a file, after mass=1.3: with a box of 0.2 x 0.2 x
# 0.1 m 0.00542, 0.00542, 0.00867; without a shape 8.7e-7 each; with localInertiaDiagonal as in the
# file. A torque about x turns the body by the new number.
# It matters where worlds are made by varying the mass of an identified vehicle, or a payload is
# added: the identified inertia is lost at the first call, and every world has the inertia of a box.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pybullet==3.2.7 numpy==2.1.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
import pybullet

FILE = """<robot name="drone"><link name="base"><inertial><origin xyz="0 0 0" rpy="0 0 0"/>
<mass value="1.3"/><inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>{}
</link></robot>"""
BOX = '<collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision>'
MOMENTS = (0.01, 0.02, 0.025)
STEP = 1.0 / 240.0
for name, shape in (("box.urdf", BOX), ("bare.urdf", "")):
    with open(name, "w") as file:
        file.write(FILE.format(shape))
pybullet.connect(pybullet.DIRECT)
pybullet.setTimeStep(STEP)


def moments(name, **change):
    """Return the moments of inertia that PyBullet tells, and Ixx by the turn after a torque."""
    body = pybullet.loadURDF(name, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    if change:
        pybullet.changeDynamics(body, -1, **change)
    pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0)
    mass, _, told = pybullet.getDynamicsInfo(body, -1)[:3]
    assert mass == 1.3
    pybullet.applyExternalTorque(body, -1, [1e-5, 0, 0], pybullet.LINK_FRAME)
    pybullet.stepSimulation()
    turn = pybullet.getBaseVelocity(body)[1][0]
    pybullet.removeBody(body)
    return [float(f"{x:.3g}") for x in (*told, 1e-5 * STEP / turn)]


loaded = moments("box.urdf")
boxed = moments("box.urdf", mass=1.3)
bare = moments("bare.urdf", mass=1.3)
both = moments("box.urdf", mass=1.3, localInertiaDiagonal=MOMENTS)
print("Ixx, Iyy, Izz, Ixx by a torque, loaded:", loaded)
print("after mass=1.3:", boxed, "without a shape:", bare, "with localInertiaDiagonal:", both)
assert np.allclose(loaded, [*MOMENTS, 0.01], rtol=1e-9, atol=0.0)
assert np.allclose(both, loaded, rtol=1e-9, atol=0.0)
assert np.allclose(boxed, [0.00542, 0.00542, 0.00867, 0.00542], rtol=1e-9, atol=0.0)
assert np.allclose(bare, 8.67e-7, rtol=1e-9, atol=0.0)
PY
