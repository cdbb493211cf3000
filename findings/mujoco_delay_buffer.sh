#!/bin/sh
# MuJoCo 4.0.0: an actuator's `delay` is in seconds, but it is no longer than `nsample` time steps.
# A model made for one time step has a shorter delay at a finer one, without a warning. RK4 evaluates
# its last stage at the end of the step, where the next command of the buffer counts already: its
# delay is a sixth of a step too short, and nearly a whole step where the step does not divide it.
# Seen for delay="0.006" nsample="3", steps of 2, 1 and 0.5 ms: 6, 3 and 1.5 ms; for nsample="12" and
# steps of 4 and 2 ms: 8 and 6 ms under Euler and implicitfast, 4.67 and 5.67 ms under RK4.
# It matters where the delay of motors and autopilot is carried into a model: half of it is gone when
# the time step is halved to make the simulation finer.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0
"$folder/venv/bin/python" - <<'PY'
import mujoco

XML = """<mujoco><option timestep="{}" integrator="{}" gravity="0 0 0"/><worldbody><body><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="s"/></body></worldbody><actuator>
<general site="s" gear="0 0 1 0 0 0" delay="0.006" nsample="{}"/></actuator></mujoco>"""


def delay_ms(step, nsample, integrator="Euler"):
    """Return how much later than its command a force of 1 N moved a mass of 1 kg."""
    model = mujoco.MjModel.from_xml_string(XML.format(step, integrator, nsample))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    for _ in range(100):
        mujoco.mj_step(model, data)
    return round(1000 * (data.time - float(data.qvel[2])), 2)


finer = [delay_ms(step, 3) for step in (0.002, 0.001, 0.0005)]
print("delay [ms] of 3 samples at steps of 2, 1, 0.5 ms:", finer)
assert finer == [6.0, 3.0, 1.5]
expected = {"Euler": [8.0, 6.0], "implicitfast": [8.0, 6.0], "RK4": [4.67, 5.67]}
seen = {name: [delay_ms(step, 12, name) for step in (0.004, 0.002)] for name in expected}
print("delay [ms] of 12 samples at steps of 4, 2 ms:", seen)
assert seen == expected
PY
