#!/bin/sh
# orangebox 0.5.0: a header that Blackbox writes as the bits of a float ("H gyro_scale:0x3f800000",
# which is 1.0) is returned as the integer of these bits. Gyro counts times this scale are 1e9 times
# too large, and the library has no function that turns the bits into the float.
# Seen: gyro_scale 1065353216 (its bits as a float: 1.0).
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --upgrade pip
"$folder/venv/bin/pip" download -q --no-deps -d "$folder" orangebox==0.5.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import glob
import struct
import sys

sys.path.insert(0, glob.glob("orangebox-*.whl")[0])  # pip refuses an entry point of this wheel
from orangebox import Parser

HEADER = b"""H Product:Blackbox flight data recorder by Nicholas Sherlock
H Data version:2
H I interval:32
H P interval:1
H minthrottle:1070
H motorOutput:48,2047
H vbatref:1600
H Field I name:loopIteration,time
H Field I signed:0,0
H Field I predictor:0,0
H Field I encoding:1,1
H Field P predictor:6,2
H Field P encoding:9,0
H gyro_scale:0x3f800000
"""
with open("log.bbl", "wb") as file:
    file.write(HEADER + b"I\x00\x01E\xffEnd of log\x00")
scale = Parser.load("log.bbl").headers["gyro_scale"]
meant = struct.unpack("<f", struct.pack("<I", 0x3F800000))[0]
print("gyro_scale", scale, "its bits as a float:", meant)
assert scale == 1065353216 and meant == 1.0
PY
