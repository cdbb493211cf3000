#!/bin/sh
# urdf2mjcf 0.2.39: the root link of a URDF, which is the whole vehicle for a multirotor, loses its mass and
# inertia on the way to MJCF. With its usual setting, a floating base, it takes `<inertial>` off the root
# body again, and MuJoCo (4.0.0) takes every shape, the visual ones too, for solid of 1000 kg/m^3. Nothing is
# said of it. With `floating_base` false in the metadata `<inertial>` stays. Products of inertia are left out
# of every link; of these it warns from 1e-6 kg m^2 on. A change that keeps the root's `<inertial>` has been
# proposed to the project (pull request 81).
# Seen for a link of 1.3 kg and principal moments .012, .022, .03 kg m^2 with one visual box of .2 x .2 x .1 m:
# 4 kg and .0167, .0167, .0267 kg m^2; with floating_base false 1.3 kg and the moments of the file.
# It matters for any vehicle taken to MuJoCo, MJX or a learning task this way: it hovers at another speed of
# the rotors and turns otherwise, and no line of the file looks wrong.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q urdf2mjcf==0.2.39 mujoco==4.0.0
cd "$folder"
cat > drone.urdf <<'URDF'
<robot name="drone"><link name="base">
<inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="1.3"/>
<inertia ixx="0.012" iyy="0.022" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link></robot>
URDF
"$folder/venv/bin/urdf2mjcf" drone.urdf --output usual.xml
"$folder/venv/bin/urdf2mjcf" drone.urdf --output fixed.xml --metadata '{"floating_base": false}'
"$folder/venv/bin/python" - <<'PY'
import mujoco


def base_of(path):
    """Return the mass and the principal moments of the root body, the smallest first."""
    body = mujoco.MjModel.from_xml_path(path).body("base")
    return [round(float(value), 4) for value in (body.mass[0], *sorted(body.inertia))]


usual, fixed = base_of("usual.xml"), base_of("fixed.xml")
print("mass [kg] and principal moments [kg m^2] in MuJoCo, as usual", usual)
print("with floating_base false", fixed)
assert usual == [4.0, 0.0167, 0.0167, 0.0267]
assert fixed == [1.3, 0.012, 0.022, 0.03]
PY
