#!/bin/sh
# RotorPy 3.0.0: away from the centre of mass the accelerometer of `Imu` is right only while the
# body's axes are those of the world. `measurement` turns the lever arm to world axes and crosses it
# with `w`, which is in body axes, and with `wdot`, which it documents as in world axes and
# `Multirotor.statedot` returns in body axes. A level vehicle that only yaws does not show it.
# Seen, IMU 0.1 m to the left (+y), in body axes: turning at 10 rad/s about the body's z, no thrust:
# y, z = -10, 0 level (right at any roll), -5, 5 rolled by 45 degrees, 0, 0 by 90 degrees. At rest with
# statedot's wdot of 38.9 rad/s^2 about z: x = -3.89 level (right at any roll), -2.75 and 0.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy scipy
"$folder/venv/bin/pip" install -q --no-deps rotorpy==3.0.0
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
from rotorpy.sensors.imu import Imu
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from scipy.spatial.transform import Rotation

ROLLS = (0, 45, 90)
LEFT, ABOVE = np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, 0.1])
FALL = {"vdot": np.array([0.0, 0.0, -9.81]), "wdot": np.zeros(3)}
VEHICLE = Multirotor(quad_params, control_abstraction="cmd_motor_speeds")
SPEEDS = np.array([1900.0, 1700.0, 1900.0, 1700.0])  # the torque of these is about z alone


def at(roll, rate):
    turn = Rotation.from_euler("x", roll, degrees=True).as_quat()
    return {"q": turn, "w": np.array([0.0, 0.0, rate])}


def accelerometer(place, state, rates):
    return Imu(p_BS=place).measurement(state, rates, with_noise=False)["accel"]


def turning(place):
    return np.array([accelerometer(place, at(roll, 10.0), FALL) for roll in ROLLS])


def started(roll):
    """Give what the arm adds where the rotors turn the vehicle from rest, and the rate's rise."""
    state = {**VEHICLE.initial_state, **at(roll, 0.0), "rotor_speeds": SPEEDS}
    rates = VEHICLE.statedot(state, {"cmd_motor_speeds": SPEEDS}, 0.01)
    arm = accelerometer(LEFT, state, rates) - accelerometer(np.zeros(3), state, rates)
    return arm, rates["wdot"]


left, above = turning(LEFT), turning(ABOVE)
arms, rises = map(np.array, zip(*map(started, ROLLS)))
print("turning, IMU at left, y and z [m/s^2]", (left[:, 1:].round(2) + 0.0).tolist())
print("turning, IMU above, y and z [m/s^2]", (above[:, 1:].round(2) + 0.0).tolist())
print("wdot of statedot [rad/s^2]", rises.round(2).tolist())
print("from rest, IMU at left, x [m/s^2]", (arms[:, 0].round(2) + 0.0).tolist())
assert np.allclose(left, [[0, -10, 0], [0, -5, 5], [0, 0, 0]])  # each is [0, -10, 0] in truth
assert np.allclose(above, [[0, 0, 0], [0, 5, -5], [0, 0, -10]])  # each is zero in truth
assert np.allclose(rises, rises[0])  # body axes: the same at any roll
rise = rises[0, 2]
assert np.allclose(arms[:, 0], -0.1 * rise * np.cos(np.radians(ROLLS)))  # -0.1 rise in truth
PY
