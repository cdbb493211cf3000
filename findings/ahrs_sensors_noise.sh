#!/bin/sh
# AHRS 0.4.0 (Python): the simulated gyro of `Sensors`, which is in rad/s unless asked for degrees, takes
# its noise in degrees: `gyr_noise` is added before the turn to radians, and is so 57 times smaller than
# asked. Its documentation says that the noise is scaled to the unit of the gyro. `mag_noise` is replaced by
# .5 % of the field wherever it is smaller than the range of the magnetometer, as every usual noise is.
# `acc_noise` is heeded.
# Seen at rest, gyr_noise .01, mag_noise 10 nT and acc_noise .05 m/s^2: the gyro scatters by .000175 rad/s,
# and with in_degrees=True by .0100 deg/s; the magnetometer scatters by 193 nT, the accelerometer by .0501.
# It matters where an estimator or an identification is tried on such data: the gyro is far better than
# the vehicle's own, and what works there fails in flight.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ahrs==0.4.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from ahrs import Sensors

LEVEL = np.tile([1.0, 0.0, 0.0, 0.0], (20000, 1))


def scatter(in_degrees):
    """Return the scatter of gyro, accelerometer and magnetometer at rest, as the mean of three axes."""
    sensors = Sensors(
        quaternions=LEVEL, in_degrees=in_degrees, gyr_noise=0.01, acc_noise=0.05, mag_noise=10.0,
        rng=np.random.default_rng(0),
    )
    signals = (sensors.gyroscopes, sensors.accelerometers, sensors.magnetometers)
    return [float(f"{signal[1:].std(axis=0).mean():.3g}") for signal in signals]


radians, degrees = scatter(False), scatter(True)
print("gyro [rad/s], accelerometer [m/s^2], magnetometer [nT]", radians)
print("gyro [deg/s] of in_degrees=True", degrees[0])
assert np.isclose(radians[0], np.radians(0.01), rtol=0.02) and np.isclose(degrees[0], 0.01, rtol=0.02)
assert np.isclose(radians[1], 0.05, rtol=0.02) and radians[2] > 100.0
PY
