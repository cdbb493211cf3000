#!/bin/sh
# PyBullet 3.2.7: a URDF link with products of inertia has its base frame turned to the principal
# axes. Loaded at the identity, the body's attitude is not the identity.
# Seen: roll 1.08, pitch 5.14, yaw -13.85 degrees; without products 0, 0, 0.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pybullet==3.2.7 numpy==2.1.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import math
import pybullet

LINK = """<robot name="body"><link name="base"><inertial><origin xyz="0 0 0" rpy="0 0 0"/>
<mass value="1.285"/><inertia ixx="0.0182" iyy="0.0196" izz="0.0288"
ixy="{}" ixz="{}" iyz="{}"/></inertial></link></robot>"""
pybullet.connect(pybullet.DIRECT)


def attitude_deg(name, products):
    with open(name, "w") as file:
        file.write(LINK.format(*products))
    body = pybullet.loadURDF(name, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    _, quaternion = pybullet.getBasePositionAndOrientation(body)
    return [math.degrees(angle) for angle in pybullet.getEulerFromQuaternion(quaternion)]


without = attitude_deg("without.urdf", (0, 0, 0))
with_products = attitude_deg("with.urdf", (0.00035, 0.0009, -0.0004))
print("without products", without, "with products", with_products)
assert max(map(abs, without)) < 1e-6
assert all(abs(a - b) < 0.01 for a, b in zip(with_products, (1.08, 5.14, -13.85)))
PY
