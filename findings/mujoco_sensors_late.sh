#!/bin/sh
# MuJoCo 4.0.0: after mj_step, gyro and accelerometer are those of the state before the step, while
# qpos and qvel are those after it. Both written as one row of a log put the sensors one step late.
# Seen: a body turned by a constant torque (1 rad/s^2, steps of 10 ms): gyro 0, .01, .02 rad/s beside
# qvel .01, .02, .03 rad/s.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0
"$folder/venv/bin/python" - <<'PY'
import mujoco

XML = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><site name="imu"/></body></worldbody>
<actuator><motor site="imu" gear="0 0 0 0 0 1"/></actuator>
<sensor><gyro site="imu"/></sensor></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = 0.1
rows = []
for _ in range(3):
    mujoco.mj_step(model, data)
    rows.append((round(float(data.sensordata[2]), 9), round(float(data.qvel[5]), 9)))
print("gyro and qvel after each step:", rows)
assert rows == [(0.0, 0.01), (0.01, 0.02), (0.02, 0.03)]
PY
