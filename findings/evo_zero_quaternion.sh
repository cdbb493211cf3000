#!/bin/sh
# evo 1.38.1: a pose with a quaternion of zeros, as recorders write where tracking is lost, is read
# as the attitude "level" and goes into the rotation errors; a quaternion of length 2 passes too.
# Neither reading nor APE calls PoseTrajectory3D.check(), which would object.
# Seen: the reference turned by 90 degrees about z, the estimate equal to it but for one lost pose of
# three: rotation errors 0, 90, 0 degrees.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q evo==1.38.1
cd "$folder"
export HOME="$folder"
"$folder/venv/bin/python" - <<'PY'
from evo.core import metrics
from evo.tools import file_interface

TURNED = "0 0 0.7071067811865476 0.7071067811865476"  # x y z w
LOST = "0 0 0 0"


def read(name, attitudes):
    with open(name, "w") as file:
        file.writelines(f"{k} 0 0 0 {words}\n" for k, words in enumerate(attitudes))
    return file_interface.read_tum_trajectory_file(name)


truth = read("truth.tum", [TURNED, TURNED, TURNED])
estimate = read("estimate.tum", [TURNED, LOST, TURNED])
ape = metrics.APE(metrics.PoseRelation.rotation_angle_deg)
ape.process_data((truth, estimate))
print("rotation errors", ape.error, "check:", estimate.check()[0])
assert abs(ape.error[1] - 90.0) < 1e-6 and max(ape.error[[0, 2]]) < 1e-6
assert not estimate.check()[0]
PY
