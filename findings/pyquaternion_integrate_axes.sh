#!/bin/sh
# pyquaternion 0.9.9: `integrate` and `derivative` call their rates those "about the global x, y and z axes", and take
# them as those about the axes of the body, as a gyro gives them. `rotate` and `rotation_matrix` turn vectors of the
# body to the world.
# Seen for a heading of 90 degrees and a roll of 20 degrees about the body's x: with the rates of the body a roll of
# 20 degrees, with those of the world, as documented, a pitch of 20 degrees. In ten seconds of flight with turns
# about all axes the gyro's rates give the attitude to 0.01 degrees; turned to the world they end up to 180 degrees
# off.
# It matters where attitudes are integrated from a log's gyro: who turns the rates to the world first, as the
# documentation asks, has another attitude, and gravity goes into drag and forces.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pyquaternion==0.9.9 numpy==2.1.3 scipy==1.14.1
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation

STEP = 0.001


def roll_and_pitch(attitude):
    """Return roll and pitch [degrees] of an attitude."""
    yaw, pitch, roll = Rotation.from_matrix(attitude.rotation_matrix).as_euler("ZYX", degrees=True)
    return [round(float(angle), 3) + 0.0 for angle in (roll, pitch)]


gyro = np.array([1.0, 0.0, 0.0])  # rad/s about the body's x
by_body, by_world = (Quaternion(axis=[0, 0, 1], degrees=90) for _ in range(2))
by_body.integrate(gyro, np.radians(20.0))
by_world.integrate(by_world.rotate(gyro), np.radians(20.0))
print("roll and pitch at a heading of 90 degrees, by rates of the body:", roll_and_pitch(by_body))
print("and by rates of the world, as documented:", roll_and_pitch(by_world))
assert np.allclose(roll_and_pitch(by_body), [20.0, 0.0], atol=0.01)
assert np.allclose(np.abs(roll_and_pitch(by_world)), [0.0, 20.0], atol=0.01)
heading = Quaternion(axis=[0, 0, 1], degrees=90)
slope = heading.derivative(gyro)
assert np.allclose((slope - 0.5 * heading * Quaternion(vector=gyro)).elements, 0.0)

time = STEP * (np.arange(10000) + 0.5)
rates = np.stack([np.sin(3.0 * time), 0.8 * np.cos(2.0 * time), 0.5 + 0.3 * np.sin(time)], axis=1)
right = Rotation.identity()
by_body, by_world = Quaternion(), Quaternion()
worst = np.zeros(2)
for rate in rates:
    rate_in_world = right.apply(rate)
    right = right * Rotation.from_rotvec(STEP * rate)
    by_body.integrate(rate, STEP)
    by_world.integrate(rate_in_world, STEP)
    errors = [
        (right.inv() * Rotation.from_matrix(found.rotation_matrix)).magnitude()
        for found in (by_body, by_world)
    ]
    worst = np.maximum(worst, np.degrees(errors))
print("largest error in ten seconds [degrees], rates of the body, of the world:", worst.round(2).tolist())
assert worst[0] < 0.01 and worst[1] > 90.0
PY
