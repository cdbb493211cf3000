#!/bin/sh
# JSBSim 1.3.3: <ixy>, <ixz> and <iyz> are the elements of the tensor in structural axes (x aft, y
# right, z up), and the integrals of xy, xz and yz in these axes with negated_crossproduct_inertia=
# "false". So neither setting takes both conventions of the body axes (x forward, y right, z down):
# the textbooks' positive Ixz, the integral, needs "false", and the tensor's Ixy and Iyz need the other
# sign than in the body's tensor, but its Ixz the same.
# Seen for <ixy> 0.1, <ixz> 0.2, <iyz> 0.3: the body turns as a tensor with Ixy -0.1, Ixz +0.2,
# Iyz -0.3, and with "false" as +0.1, -0.2, +0.3 [kg m^2]. inertia/ixy-slugs_ft2, ixz and iyz read back
# the tensor in structural axes: 0.1, 0.2, 0.3, and with "false" -0.1, -0.2, -0.3.
# It matters where an identified tensor is flown in JSBSim: a wrong sign couples roll, pitch and yaw
# the wrong way, and nothing says so.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q jsbsim==1.3.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import os

import jsbsim
import numpy as np

MODEL = """<?xml version="1.0"?>
<fdm_config name="body" version="2.0" release="ALPHA">
<fileheader><author>-</author><filecreationdate>2026-01-01</filecreationdate>
<version>1</version><description>-</description></fileheader>
<metrics><wingarea unit="M2">1</wingarea><wingspan unit="M">1</wingspan><chord unit="M">1</chord>
<htailarea unit="M2">0</htailarea><htailarm unit="M">0</htailarm><vtailarea unit="M2">0</vtailarea>
<vtailarm unit="M">0</vtailarm>
<location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location></metrics>
<mass_balance {setting}><ixx unit="KG*M2">1</ixx><iyy unit="KG*M2">2</iyy><izz unit="KG*M2">2.5</izz>
<ixy unit="KG*M2">0.1</ixy><ixz unit="KG*M2">0.2</ixz><iyz unit="KG*M2">0.3</iyz>
<emptywt unit="KG">10</emptywt>
<location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>
<ground_reactions/><propulsion/><flight_control name="none"/>
<aerodynamics>
<axis name="ROLL"><function name="moment/x"><property>in/x</property></function></axis>
<axis name="PITCH"><function name="moment/y"><property>in/y</property></function></axis>
<axis name="YAW"><function name="moment/z"><property>in/z</property></function></axis>
</aerodynamics></fdm_config>"""
KG_M2 = 1.3558179483314004  # one slug ft^2
os.makedirs("aircraft/body")


def flown(setting):
    """Return the tensor by which moments turn the body, and the properties, in kg m^2."""
    with open("aircraft/body/body.xml", "w") as file:
        file.write(MODEL.format(setting=setting))
    columns = []
    for axis in "xyz":
        world = jsbsim.FGFDMExec(".")
        world.set_debug_level(0)
        for other in "xyz":
            world[f"in/{other}"] = 0.0
        world.load_model("body")
        world["ic/h-sl-ft"] = 5000.0
        world.run_ic()
        world[f"in/{axis}"] = 1.0  # lbf ft
        world.run()
        columns.append([world[f"accelerations/{rate}dot-rad_sec2"] for rate in "pqr"])
    tensor = KG_M2 * np.linalg.inv(np.array(columns).T)
    read = [KG_M2 * world[f"inertia/{pair}-slugs_ft2"] for pair in ("ixy", "ixz", "iyz")]
    return np.round([*tensor[0, 1:], tensor[1, 2]], 3) + 0.0, np.round(read, 3)


usual, usual_read = flown("")
other, other_read = flown('negated_crossproduct_inertia="false"')
print("tensor's Ixy, Ixz, Iyz:", usual, "properties:", usual_read)
print('with "false":', other, "properties:", other_read)
assert np.allclose(usual, [-0.1, 0.2, -0.3]) and np.allclose(usual_read, [0.1, 0.2, 0.3])
assert np.allclose(other, [0.1, -0.2, 0.3]) and np.allclose(other_read, [-0.1, -0.2, -0.3])
PY
