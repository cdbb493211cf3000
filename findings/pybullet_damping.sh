#!/bin/sh
# PyBullet 3.2.7: every body is damped, in fall and in turn, though neither its file nor the world has
# any air. Drag that a controller is tuned against is then not the vehicle's. Only
# changeDynamics(body, -1, linearDamping=0, angularDamping=0) switches it off.
# Seen after 1 s of free fall at 10 m/s^2, turning at 1 rad/s: fallen 4.65 m at 8.70 m/s, turning at
# 0.925 rad/s; without damping 5.00 m, 10.00 m/s and 1.000 rad/s.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pybullet==3.2.7 numpy==2.1.3
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import pybullet

with open("drone.urdf", "w") as file:
    file.write("""<robot name="drone"><link name="base"><inertial><origin xyz="0 0 0" rpy="0 0 0"/>
<mass value="1.3"/><inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/>
</inertial></link></robot>""")
pybullet.connect(pybullet.DIRECT)


def after_a_second(**damping):
    pybullet.resetSimulation()
    pybullet.setGravity(0, 0, -10)
    pybullet.setTimeStep(0.001)
    body = pybullet.loadURDF("drone.urdf")
    if damping:
        pybullet.changeDynamics(body, -1, **damping)
    pybullet.resetBaseVelocity(body, [0, 0, 0], [0, 0, 1])
    for _ in range(1000):
        pybullet.stepSimulation()
    place, _ = pybullet.getBasePositionAndOrientation(body)
    velocity, turn = pybullet.getBaseVelocity(body)
    return [-place[2], -velocity[2], turn[2]]


usual = after_a_second()
free = after_a_second(linearDamping=0, angularDamping=0)
print("fallen [m], speed [m/s], turn [rad/s]:", usual, "without damping:", free)
assert all(abs(a - b) < 0.01 for a, b in zip(usual, (4.65, 8.70, 0.925)))
assert all(abs(a - b) < 0.01 for a, b in zip(free, (5.0, 10.0, 1.0)))
PY
