#!/bin/sh
# ezc3d 1.7.2 and py-c3d 0.6.0 (C3D files of motion capture): the same missing marker is NaN in ezc3d
# and the origin of the room in py-c3d, where only the residual of -1 in column 3 tells it from a
# marker that is there. ezc3d's own residuals of that file are 0 for the missing marker, too.
# Seen: marker at 1.5, 1.5, 1.5, missing in the third frame: ezc3d nan nan nan, residual 0; py-c3d 0 0 0,
# residual -1.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ezc3d==1.7.2 c3d==0.6.0
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import c3d
import ezc3d
import numpy as np

made = ezc3d.c3d()
made["parameters"]["POINT"]["RATE"]["value"] = [100]
made["parameters"]["POINT"]["LABELS"]["value"] = ("marker",)
points = np.full((4, 1, 5), 1.5)
points[:3, 0, 2] = np.nan
made["data"]["points"] = points
made.write("take.c3d")

by_ezc3d = ezc3d.c3d("take.c3d")["data"]
with open("take.c3d", "rb") as file:
    by_c3d = [frame[0] for _, frame, _ in c3d.Reader(file).read_frames()]
third = by_ezc3d["points"][:3, 0, 2]
residual = float(by_ezc3d["meta_points"]["residuals"].ravel()[2])
print("ezc3d", third, "residual", residual, "py-c3d", by_c3d[2][:4])
assert np.isnan(third).all() and residual == 0.0
assert by_c3d[2][:4].tolist() == [0.0, 0.0, 0.0, -1.0]
assert by_c3d[1][:4].tolist() == [1.5, 1.5, 1.5, 0.0]
PY
