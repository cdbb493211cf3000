#!/bin/sh
# NavPy 1.0: `angle2quat` halves the arrays of angles that it is given, if they are in radians (its default). The
# quaternions are right; yaw, pitch and roll of the caller are half as large afterwards, and each further call
# halves them once more. Its documentation shows numbers and lists, which are copied, and degrees, which are
# converted first; it does not say that the input is written to. `angle2dcm` leaves its input as it is.
# Seen for a roll of 40 and headings of 0, 90 and 180 degrees: after the call roll 20, headings 0, 45, 90; the
# same call again gives the quaternions of these. A matrix made of the same arrays afterwards is that of half the
# angles.
# It matters where attitudes of a log are needed as angles and as quaternions: the accelerometer is then turned by
# half of the tilt, and its gravity goes into drag or into the forces.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q NavPy==1.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import navpy
import numpy as np


def attitudes():
    """Return yaw, pitch and roll [rad] of three samples."""
    return np.radians([0.0, 90.0, 180.0]), np.zeros(3), np.radians([40.0, 40.0, 40.0])


def in_degrees(angles):
    return np.degrees(angles).round(6).tolist()


yaw, pitch, roll = attitudes()
matrices = navpy.angle2dcm(yaw, pitch, roll)
assert in_degrees(yaw) == [0.0, 90.0, 180.0]  # angle2dcm leaves its input as it is
first = navpy.quat2angle(*navpy.angle2quat(yaw, pitch, roll))
after = in_degrees(yaw), in_degrees(roll)
again = navpy.quat2angle(*navpy.angle2quat(yaw, pitch, roll))
print("headings and rolls of the first quaternions", in_degrees(first[0]), in_degrees(first[2]))
print("headings and rolls of the caller afterwards", *after)
print("headings and rolls of the same call again  ", in_degrees(again[0]), in_degrees(again[2]))
print("after it", in_degrees(yaw), in_degrees(roll))
assert np.allclose(np.degrees(first[2]), 40.0) and np.allclose(np.degrees(again[2]), 20.0)
assert after == ([0.0, 45.0, 90.0], [20.0, 20.0, 20.0])
assert np.allclose(np.degrees(again[0]), [0.0, 45.0, 90.0])
assert in_degrees(roll) == [10.0, 10.0, 10.0]
yaw, pitch, roll = attitudes()
navpy.angle2quat(yaw, pitch, roll)
tilt = np.degrees(np.arccos(navpy.angle2dcm(yaw, pitch, roll)[:, 2, 2]))
print("tilt of angle2dcm after angle2quat", tilt.round(6).tolist())
assert np.allclose(tilt, 20.0) and np.allclose(np.degrees(np.arccos(matrices[:, 2, 2])), 40.0)
yaw, pitch, roll = map(np.degrees, attitudes())
navpy.angle2quat(yaw, pitch, roll, input_unit="deg")
assert roll.tolist() == [40.0, 40.0, 40.0]
PY
