#!/bin/sh
# rod 0.5.0, which reads SDF for JaxSim and writes it as URDF: collisions and visuals of one name in
# several links are all placed as if they were in the last of these links. SDF wants such names to
# be unique in their link only. Nothing is said; links, joints and inertia are right.
# Seen: two arms at x = 0.2 and -0.2 m, each with a box 2 cm above its own origin: in the URDF the
# box of the first is at x = 0.4 m of its arm, 0.6 m from the vehicle's middle; with the names
# "left" and "right" both are at x = 0.
# It matters where an SDF model goes on as URDF: its feet and guards then touch the world in the
# wrong places.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q rod==0.5.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import xml.etree.ElementTree as ET

import rod
from rod.urdf.exporter import UrdfExporter

INERTIAL = """<inertial><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia>
</inertial>"""
ARM = """<link name="arm_{0}"><pose>{1} 0 0 0 0 0</pose>{2}<collision name="{3}"><pose>0 0 0.02 0 0 0</pose>
<geometry><box><size>0.1 0.1 0.01</size></box></geometry></collision></link>
<joint name="joint_{0}" type="fixed"><parent>base</parent><child>arm_{0}</child></joint>"""


def places(*names):
    """Return the place of each arm's joint in the base, and of its box in the arm, in the URDF."""
    arms = [ARM.format(i, x, INERTIAL, name) for i, (x, name) in enumerate(zip((0.2, -0.2), names))]
    model = f'<link name="base">{INERTIAL}</link>' + "".join(arms)
    sdf = rod.Sdf.load(f'<sdf version="1.9"><model name="drone">{model}</model></sdf>')
    urdf = ET.fromstring(UrdfExporter().to_urdf_string(sdf))
    found = [*urdf.iterfind("joint/origin"), *urdf.iterfind("link/collision/origin")]
    return [[round(float(x), 9) for x in origin.get("xyz").split()] for origin in found]


JOINTS = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]]
own, same = places("left", "right"), places("collision", "collision")
print("joints", own[:2], "boxes:", own[2:], "of one name:", same[2:])
assert own == [*JOINTS, [0.0, 0.0, 0.02], [0.0, 0.0, 0.02]]
assert same == [*JOINTS, [0.4, 0.0, 0.02], [0.0, 0.0, 0.02]]
PY
