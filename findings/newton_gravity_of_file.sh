#!/bin/sh
# Newton 1.8.0: `ModelBuilder.add_mjcf` takes density, viscosity, wind and integrator from a file's
# <option>, and <flag gravity="disable">, but not the vector `gravity`: every model falls with the
# builder's 9.81 m/s^2, without a warning.
# Seen for gravity="0 0 -1.62" wind="3 0 0": gravity -9.81, wind 3 0 0; with <flag gravity="disable"/>
# gravity 0.
# It matters where a model is flown by the thrust that carries its weight: made for 9.80665 m/s^2 it
# sinks, if little, and one for another planet is flown on the Earth.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q newton==1.8.0 warp-lang==1.19.0 mujoco==3.17.0 mujoco-warp==3.17.0
WARP_CACHE_PATH="$folder/cache" "$folder/venv/bin/python" - <<'PY' 2>/dev/null
import mujoco
import newton
import warp

warp.config.quiet = True
XML = """<mujoco><option gravity="0 0 -1.62" timestep="0.004" wind="3 0 0"><flag gravity="{}"/></option>
<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom size="0.1"/>
</body></worldbody></mujoco>"""


def seen(flag):
    """Return gravity and wind of a file in MuJoCo and in Newton."""
    text = XML.format(flag)
    options = mujoco.MjModel.from_xml_string(text).opt
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_mjcf(text)
    model = builder.finalize(device="cpu")
    return [
        [round(float(x), 3) + 0.0 for x in (*gravity, *wind)]
        for gravity, wind in (
            (options.gravity, options.wind),
            (model.gravity.numpy()[0], model.mujoco.wind.numpy()[0]),
        )
    ]


for flag, fall in (("enable", -9.81), ("disable", 0.0)):
    there, here = seen(flag)
    print(f"gravity and wind with the flag {flag}: MuJoCo", there, "Newton", here)
    assert there == [0.0, 0.0, -1.62, 3.0, 0.0, 0.0]
    assert here == [0.0, 0.0, fall, 3.0, 0.0, 0.0]
PY
