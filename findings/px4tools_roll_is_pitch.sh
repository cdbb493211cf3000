#!/bin/sh
# px4tools 0.9.6: the roll and pitch that it makes from the quaternion of `vehicle_attitude` of PX4 are those
# of turns about axes fixed in the world: first yaw about z, then pitch about y, then roll about x. PX4 means
# yaw, pitch and roll about axes that move along, as aviation does. transforms3d, whose angles px4tools takes,
# documents the order; px4tools does not (a change has been proposed to it, pull request 45).
# Seen for a roll of 20 degrees and no pitch: roll 20 and pitch 0 at the heading 0, roll 14.4 and pitch 14
# at 45, roll 0 and pitch 20 at 90, and roll -20 at 180 degrees.
# It matters for every plot, error and fit of attitude from `compute_data`: the vehicle seems to roll and
# pitch with the north, and near the heading 0, where a stand or a short hop is tried, all looks right.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q px4tools==0.9.6 transforms3d==0.4.2 pandas==3.1.1 scipy==1.17.1
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
import pandas as pd
from px4tools import ulog
from scipy.spatial.transform import Rotation

ROLL, HEADINGS = 20.0, [0.0, 45.0, 90.0, 180.0]
ATTITUDE = "t_vehicle_attitude_0__f_"

turns = Rotation.from_euler("ZYX", [[heading, 0.0, ROLL] for heading in HEADINGS], degrees=True)
quaternions = turns.as_quat(scalar_first=True)
log = pd.DataFrame({f"{ATTITUDE}q_{part}_": quaternions[:, part] for part in range(4)})
told = ulog.compute_data(log)
found = {}
for row, heading in enumerate(HEADINGS):
    angles = np.degrees([told[ATTITUDE + name].iloc[row] for name in ("roll", "pitch")])
    found[heading] = [round(float(angle), 1) + 0.0 for angle in angles]
    print("heading", heading, "roll 20, pitch 0 [degrees] become", found[heading])
assert found[0.0] == [20.0, 0.0] and found[45.0] == [14.4, 14.0]
assert found[90.0] == [0.0, 20.0] and found[180.0] == [-20.0, 0.0]
PY
