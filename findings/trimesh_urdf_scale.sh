#!/bin/sh
# trimesh 5.2.0: `export_urdf` writes an <inertial> that does not fit its mesh. `scale` goes to the mesh alone: the
# inertia stays in the unit of the mesh (squared, times mass). The centre of mass is not written: the
# <origin> is 0, while the inertia is about the centre of mass. Both have three digits. The
# documentation says nothing of it.
# Seen for an arm of 100 x 20 x 20 mm and 0.04 kg, 150 mm from the origin, scale 0.001: Iyy 34.7 in place of
# 3.47e-5 kg m^2, a million times too much, its centre of mass at 0 in place of 0.15 m.
# It matters where the inertia of a vehicle is taken from CAD, whose meshes are in mm and have the
# vehicle's origin.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q trimesh==5.2.0 lxml scipy networkx vhacdx==0.1.1
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import xml.etree.ElementTree as ElementTree

import numpy as np
import trimesh
from trimesh.exchange.urdf import export_urdf

SIZE, PLACE = np.array([100.0, 20.0, 20.0]), np.array([150.0, 0.0, 0.0])  # mm


def exported(unit):
    """Return mass, place and Iyy of the file of an arm in the unit [m]."""
    arm = trimesh.creation.box(1e-3 * SIZE / unit)
    arm.apply_translation(1e-3 * PLACE / unit)
    arm.density = 0.04 / arm.volume
    export_urdf(arm, "arm", scale=unit)
    root = ElementTree.parse("arm/arm.urdf").getroot()
    assert len(root.findall("link")) == 1
    inertial = root.find("link/inertial")
    mesh_scale = float(root.find("link/visual/geometry/mesh").get("scale").split()[0])
    assert mesh_scale == unit
    return (
        float(inertial.find("mass").get("value")),
        float(inertial.find("origin").get("xyz").split()[0]),
        float(inertial.find("inertia").get("iyy")),
    )


truth = 0.04 / 12 * float(SIZE[0] ** 2 + SIZE[2] ** 2) * 1e-6
metres, millimetres = exported(1.0), exported(0.001)
print(f"truth: 0.04 kg, 0.15 m, Iyy {truth:.3e} kg m^2")
print("mesh in m:", metres, "mesh in mm, scale .001:", millimetres)
assert np.allclose(metres, [0.04, 0.0, truth], rtol=0.005)
assert np.allclose(millimetres, [0.04, 0.0, truth * 1e6], rtol=0.005)
PY
