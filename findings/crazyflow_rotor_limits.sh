#!/bin/sh
# Crazyflow 0.4.0: `Sim` clips rotor commands to the limits of its chosen drone's params.toml, in
# every world alike. Worlds with parameters of their own (mass, thrust per speed) keep the limits of
# that drone, and a larger vehicle cannot use its thrust.
# Seen: 40000 RPM commanded in two worlds for 1 s: the rotors turn at 21661 RPM.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q crazyflow==0.4.0
cd "$folder"
export SCIPY_ARRAY_API=1 HOME="$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
from crazyflow.sim import Sim

sim = Sim(n_worlds=2, control="rotor_vel")
sim.reset()
sim.rotor_vel_control(np.full((2, 1, 4), 40000.0))
sim.step(500)  # 1 s
speeds = np.asarray(sim.data.states.rotor_vel)
print("commanded 40000, turning at", speeds.round(0).tolist())
assert np.allclose(speeds, 21661.0, atol=2.0)
PY
