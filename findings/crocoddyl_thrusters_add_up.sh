#!/bin/sh
# crocoddyl 3.2.1: `ActuationModelFloatingBaseThrusters` adds thrusters that are set later to those before. Its
# setter (`thrusters` in Python, `set_thrusters` in C++) writes the forces and torques of the new ones on top of
# the matrix `Wthrust`, which nothing sets to zero. `thrusters` reads back the new ones alone. It is documented as
# to modify the vector of thrusters, and wants as many as before.
# Seen for four rotors 0.1 m to the front or back and to a side, 1 N each: 4 N of lift; the same rotors set again:
# 8 N; then rotors with arms of 0.2 m and twice the drag torque: Wthrust is 3, 0.4 and 0.04 where 1, 0.2 and 0.02
# is right. A new model of these rotors is right.
# It matters where identified arms and torques are put into a model that is there already, or are varied in a
# loop: with each step the optimal control problem is that of a stronger vehicle, and its hover takes less thrust.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q crocoddyl==3.2.1 pin==4.1.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import crocoddyl
import numpy as np
import pinocchio

CW, CCW = crocoddyl.ThrusterType.CW, crocoddyl.ThrusterType.CCW
still = pinocchio.SE3.Identity()
body = pinocchio.Model()
body.addJoint(0, pinocchio.JointModelFreeFlyer(), still, "root_joint")
body.appendBodyToJoint(1, pinocchio.Inertia(1.0, np.zeros(3), np.diag([0.01, 0.01, 0.02])), still)
state = crocoddyl.StateMultibody(body)


def rotors(arm, drag_torque):
    seats = ((arm, -arm, CCW), (-arm, arm, CCW), (arm, arm, CW), (-arm, -arm, CW))
    return [
        crocoddyl.Thruster(pinocchio.SE3(np.eye(3), np.array([x, y, 0.0])), drag_torque, spin)
        for x, y, spin in seats
    ]


def lift(actuation):
    """Return the force [N] along z of 1 N at each rotor."""
    data = actuation.createData()
    actuation.calc(data, state.zero(), np.ones(4))
    return float(data.tau[2])


def largest(actuation):
    """Return the largest lift, roll torque and yaw torque of a newton at one rotor."""
    return np.abs(actuation.Wthrust[[2, 3, 5]]).max(axis=1).round(9).tolist()


actuation = crocoddyl.ActuationModelFloatingBaseThrusters(state, rotors(0.1, 0.01))
first = lift(actuation), largest(actuation)
actuation.thrusters = rotors(0.1, 0.01)
again = lift(actuation), largest(actuation)
actuation.thrusters = rotors(0.2, 0.02)
other = lift(actuation), largest(actuation)
new = crocoddyl.ActuationModelFloatingBaseThrusters(state, rotors(0.2, 0.02))
print("lift [N] and largest of Wthrust: as made", first, "the same set again", again)
print("other rotors set", other, "a new model of them", (lift(new), largest(new)))
assert first == (4.0, [1.0, 0.1, 0.01]) and again == (8.0, [2.0, 0.2, 0.02])
assert other == (12.0, [3.0, 0.4, 0.04])
assert (lift(new), largest(new)) == (4.0, [1.0, 0.2, 0.02])
assert [thruster.ctorque for thruster in actuation.thrusters] == [0.02] * 4
PY
