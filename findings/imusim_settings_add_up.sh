#!/bin/sh
# imusim 1.1.2 (the IMU Simulator of x-io): `set_gyroscope` and `set_accelerometer` write offset and noise into
# the perfect signal, so that a second setting comes on top of the first, and none takes them off again;
# `plot_gyroscope` shows as "ideal" the signal with offset and noise, and so no error of either. `random_walk` is
# heeded only where `bias_instability` is not zero. It has no documentation but the comments at its arguments.
# Seen at rest at 100 Hz, noise density .01 deg/s/sqrt(Hz), which is .1 deg/s a sample: .100 deg/s, after the same
# setting again .141, after a setting without noise and an offset of 1 deg/s 1.00 +- .141, after one without
# anything still 1.00 +- .141. A random walk of .1 alone: exactly 0; with a bias instability of 1e-9 deg/s: .1
# deg/s after 1 s, as the root mean square of 199 starts.
# It matters where an estimator or an identification is tried at one level of noise after another, or against the
# drift of a real gyro: the noise of all levels so far adds up, and the drift is not there.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q imusim==1.1.2 numpy scipy matplotlib
cd "$folder"
export MPLCONFIGDIR="$folder" MPLBACKEND=Agg
"$folder/venv/bin/python" - <<'PY'
import imusim
import numpy as np

RATE = 100
ONE = np.ones(3)
rows = np.zeros((200 * RATE, 7))  # time, position, roll, pitch, yaw: at rest
rows[:, 0] = np.arange(len(rows)) / RATE
np.savetxt("rest.csv", rows, delimiter=",", header="t,x,y,z,roll,pitch,yaw")
np.random.seed(1)


def shown(simulator):
    """Return mean and scatter of the gyro [deg/s]."""
    gyro = simulator.gyroscope
    return round(float(gyro.mean()), 3), round(float(gyro.std()), 3)


simulator = imusim.Simulator("rest.csv")
seen = []
for setting in (
    {"noise_density": 0.01 * ONE},
    {"noise_density": 0.01 * ONE},
    {"offset": ONE},
    {},
):
    simulator.set_gyroscope(**setting)
    seen.append(shown(simulator))
print("mean and scatter [deg/s] after noise, the same noise, an offset, nothing:", seen)
means, scatters = np.transpose(seen)
assert np.allclose(scatters, [0.1, 0.1414, 0.1414, 0.1414], atol=0.003)
assert np.allclose(means, [0.0, 0.0, 1.0, 1.0], atol=0.01)


def walked(bias_instability):
    """Return the root mean square [deg/s] by which the gyro drifts in a second."""
    simulator = imusim.Simulator("rest.csv")
    simulator.set_gyroscope(random_walk=0.1 * ONE, bias_instability=bias_instability * ONE)
    starts = simulator.gyroscope[::RATE]
    return float(np.sqrt(np.mean(np.diff(starts, axis=0) ** 2)))


alone, both = walked(0.0), walked(1e-9)
print("drift in 1 s of random_walk 0.1: alone", alone, "with bias_instability 1e-9", round(both, 4))
assert alone == 0.0 and 0.09 < both < 0.11
PY
