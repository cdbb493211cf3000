#!/bin/sh
# spatialmath-python 1.1.18: `angdist` of two `UnitQuaternion` is half of the angle between the attitudes, and that of
# the same two as `SO3` is the whole. Each has a metric of its own by default: 3, the angle between the
# quaternions as vectors, and 6, that of the rotation. The documentation calls both the geodesic distance and an
# "angle in radians"; that they differ is to be seen from the ranges alone, up to pi/2 and up to pi.
# Seen for attitudes that are 10, 60 and 170 degrees apart: 5, 30, 85 as UnitQuaternion, 10, 60, 170 as SO3, and
# with metric=4 as UnitQuaternion.
# It matters where an estimate of attitude is compared with motion capture: its error is shown half as large, or
# twice as large as another's.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q spatialmath-python==1.1.18
cd "$folder"
export MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from spatialmath import SO3, UnitQuaternion

APART = (10.0, 60.0, 170.0)  # degrees


def distances(kind, **options):
    """Return the distances [degrees] of attitudes that are so far apart about one axis."""
    first = kind.RPY([20, -30, 40], unit="deg")
    found = []
    for angle in APART:
        second = first * kind.AngVec(np.radians(angle), [0.6, 0.0, 0.8])
        found.append(round(float(np.degrees(first.angdist(second, **options))), 3))
    return found


as_quaternion, as_matrix = distances(UnitQuaternion), distances(SO3)
other_metric = distances(UnitQuaternion, metric=4)
print("apart [degrees]", APART, "UnitQuaternion", as_quaternion, "SO3", as_matrix)
print("UnitQuaternion, metric 4", other_metric)
assert np.allclose(as_quaternion, np.array(APART) / 2, atol=0.01)
assert np.allclose(as_matrix, APART, atol=0.01) and np.allclose(other_metric, APART, atol=0.01)
PY
