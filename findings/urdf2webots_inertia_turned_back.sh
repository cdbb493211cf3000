#!/bin/sh
# urdf2webots 2025.0.0, Cyberbotics' converter of URDF for Webots: an <inertial> with `rpy` has its tensor turned
# the wrong way, by R' I R where the tensor in the link's axes is R I R' (R turns vectors from the axes of
# <inertial> to those of the link). The moments along axes that are not turned stay, the products get another
# sign: the principal axes lean to the other side. Nothing is said of it. Centre of mass and mass are right. With
# rpy 0 and the products in <inertia> the tensor is right.
# Seen for principal moments .012, .022, .03 kg m^2, pitched by 10 degrees (rpy="0 0.1745 0"): the `inertiaMatrix`
# has Ixz -.00308 in place of +.00308, and turned about all axes also Ixx .0149 in place of .0147; pinocchio 4.1.0
# reads the same URDF rightly. Webots documents the field as the tensor about the centre of mass, which ODE gets
# unchanged; its axes are those of the solid.
# It matters where CAD or an identification gives the principal axes: a vehicle with a camera below its nose flies
# in Webots as if it had it below its tail.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q urdf2webots==2025.0.0 pin==4.1.0 scipy
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import contextlib
import io
import re

import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation
from urdf2webots.importer import convertUrdfContent

MOMENTS = np.diag([0.012, 0.022, 0.03])


def urdf(tensor, angles):
    ixx, ixy, ixz, _, iyy, iyz, _, _, izz = np.ravel(tensor)
    return f"""<robot name="drone"><link name="base"><inertial>
      <origin xyz="0.01 0.0 0.02" rpy="{angles[0]} {angles[1]} {angles[2]}"/><mass value="1.3"/>
      <inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/>
    </inertial></link></robot>"""


def in_webots(tensor, angles):
    """Return the moments Ixx, Iyy, Izz and the products Ixy, Ixz, Iyz of the Webots file."""
    with contextlib.redirect_stdout(io.StringIO()):
        text = convertUrdfContent(urdf(tensor, angles), robotName="drone")
    numbers = re.search(r"inertiaMatrix \[([^\]]*)\]", text).group(1)
    return np.array(numbers.split(), dtype=float)


def in_pinocchio(tensor, angles):
    free = pinocchio.JointModelFreeFlyer()
    model = pinocchio.buildModelFromXML(urdf(tensor, angles), free)
    return as_numbers(model.inertias[1].inertia)


def as_numbers(tensor):
    return np.array([tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])


for angles in ((0.0, np.radians(10.0), 0.0), (0.1, -0.2, 0.5)):
    turn = Rotation.from_euler("xyz", angles).as_matrix()
    right, back = turn @ MOMENTS @ turn.T, turn.T @ MOMENTS @ turn
    converted, read = in_webots(MOMENTS, angles), in_pinocchio(MOMENTS, angles)
    written_out = in_webots(right, (0.0, 0.0, 0.0))
    print("rpy", np.round(angles, 4).tolist(), "Ixx Iyy Izz Ixy Ixz Iyz [kg m^2]")
    print("  right      ", as_numbers(right).round(5).tolist())
    print("  urdf2webots", converted.round(5).tolist())
    print("  pinocchio  ", read.round(5).tolist())
    assert np.allclose(converted, as_numbers(back), atol=1e-7)
    assert np.abs(converted - as_numbers(right)).max() > 5e-3
    assert np.allclose(read, as_numbers(right), atol=1e-7)
    assert np.allclose(written_out, as_numbers(right), atol=1e-7)
PY
