#!/bin/sh
# urchin 0.0.30, the successor of urdfpy: a link without <inertial> weighs 1 kg and has 1 kg m^2 about each axis,
# as soon as the URDF is read, and in the file that `save` writes. In URDF such a link has neither, and is
# how frames of IMU, camera or markers are written. Nothing is said of it.
# Seen for a drone of 0.8 kg with the frames of an IMU and a camera, read and saved: in MuJoCo 4.0.0 2.8 kg, and
# 2.006 kg m^2 about x in place of 0.006. yourdfpy 0.0.60 leaves the frames without <inertial>.
# It matters where a URDF is changed by a script (names, meshes, a mass) before it is simulated.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q urchin==0.0.30 yourdfpy==0.0.60 mujoco==4.0.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import urchin
import yourdfpy

FRAME = """<link name="{0}"/><joint name="{0}_mount" type="fixed"><parent link="body"/><child link="{0}"/>
<origin xyz="{1} 0 0"/></joint>"""
DRONE = f"""<robot name="drone"><link name="world"/><joint name="free" type="floating"><parent link="world"/>
<child link="body"/></joint><link name="body"><inertial><mass value="0.8"/>
<inertia ixx="0.006" iyy="0.007" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
{FRAME.format("imu", 0.0)}{FRAME.format("camera", 0.1)}</robot>"""


def weighed(name):
    """Return how many links have an <inertial>, and mass and inertia about x in MuJoCo."""
    links = ElementTree.parse(name).findall("link")
    count = sum(link.find("inertial") is not None for link in links)
    model = mujoco.MjModel.from_xml_path(name)
    body = model.body("body").id
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    about_x = turn[:3] ** 2 @ model.body_inertia[body]
    return count, round(float(model.body_mass[body]), 6), round(float(about_x), 6)


with open("drone.urdf", "w") as file:
    file.write(DRONE)
robot = urchin.URDF.load("drone.urdf")
robot.save("urchin.urdf")
yourdfpy.URDF.load("drone.urdf").write_xml_file("yourdfpy.urdf")
read = {link.name: (link.inertial.mass, float(link.inertial.inertia[0, 0])) for link in robot.links}
found = {name: weighed(f"{name}.urdf") for name in ("drone", "yourdfpy", "urchin")}
print("urchin reads [kg, kg m^2]", read)
print("links with <inertial>, mass [kg] and Ixx [kg m^2]", found)
assert read["imu"] == read["camera"] == (1.0, 1.0) and read["body"] == (0.8, 0.006)
assert found["drone"] == found["yourdfpy"] == (1, 0.8, 0.006)
assert found["urchin"] == (4, 2.8, 2.006)
PY
