#!/bin/sh
# MuJoCo MJX 3.17.0 takes a model with delayed actuators or sensors and flies it without their delay,
# and `actearly` without its early activation; a force sensor stays at 0. It says nothing, where it
# refuses other things that it does not know (NotImplementedError). MuJoCo itself heeds all of them.
# Seen for a force of 1 N on 1 kg, steps of 2 ms, delay="0.006" nsample="3": velocity after 1 to 5 steps
# 0, 0, 0, 2, 4 mm/s in MuJoCo 3.17.0 and 2, 4, 6, 8, 10 mm/s in MJX. With filterexact of 50 ms and
# actearly: 0.0784, 0.2322 mm/s after two steps in MuJoCo, 0, 0.0784 mm/s in MJX.
# It matters where a controller is trained in MJX for a vehicle whose MJCF has the delay of its
# motors: it is trained for motors that are 6 ms quicker, and the same file in MuJoCo is not.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==3.17.0 mujoco-mjx==3.17.0 jax==0.10.2 jaxlib==0.10.2
"$folder/venv/bin/python" - <<'PY'
import jax
import mujoco
from mujoco import mjx

jax.config.update("jax_enable_x64", True)
XML = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
<joint name="j" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
</worldbody><actuator><general name="a" joint="j" {}/></actuator><sensor>
<actuatorfrc actuator="a" {}/></sensor></mujoco>"""
DELAY = 'delay="0.006" nsample="3"'
EARLY = 'dyntype="filterexact" dynprm="0.05" actearly="true"'


def flown(actuator="", sensor=""):
    """Return velocity [mm/s] and sensed force [N] after each of five steps, in MuJoCo and in MJX."""
    model = mujoco.MjModel.from_xml_string(XML.format(actuator, sensor))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    there, on_device = mjx.put_model(model), mjx.put_data(model, data)
    step, seen = jax.jit(mjx.step), ([], [])
    for _ in range(5):
        mujoco.mj_step(model, data)
        on_device = step(there, on_device)
        for rows, one in zip(seen, (data, on_device)):
            rows.append((round(1e3 * float(one.qvel[0]), 4), round(float(one.sensordata[0]), 3)))
    return seen


expected = {
    ("", ""): ([2.0, 4.0, 6.0, 8.0, 10.0], [2.0, 4.0, 6.0, 8.0, 10.0]),
    (DELAY, ""): ([0.0, 0.0, 0.0, 2.0, 4.0], [2.0, 4.0, 6.0, 8.0, 10.0]),
    (EARLY, ""): ([0.0784, 0.2322, 0.4583, 0.7541, 1.1166], [0.0, 0.0784, 0.2322, 0.4583, 0.7541]),
}
for options, speeds in expected.items():
    seen = flown(*options)
    print(options[0] or "no delay", "[mm/s]:", *([v for v, _ in rows] for rows in seen))
    assert tuple([v for v, _ in rows] for rows in seen) == speeds
late = flown(sensor=DELAY)
print("force by a sensor with a delay [N]:", *([f for _, f in rows] for rows in late))
assert [f for _, f in late[0]] == [0.0, 0.0, 0.0, 1.0, 1.0]
assert [f for _, f in late[1]] == [0.0] * 5
PY
