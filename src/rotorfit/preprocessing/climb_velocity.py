"""The velocity along the thrust that accelerometer and gyro feel, where no log has it.

Air holds a climb back, and the rotors lose thrust in it. At w rad/s a drag of a times the mass per
second makes a change of thrust look 1 / (1 + (a / w)^2) as strong as it is, so that k_t comes out
too small where the velocity is not in the model. Specific force, turned by the gyro into axes that
do not rotate, is acceleration but for gravity and slow errors, and its integral velocity but for
slow parts, which are taken out.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import fft, signal

from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.kinematics import rotated, rotated_back, running_product, small_turns

SLOWEST: Final = 0.1
"""What changes more slowly is left out [Hz]: there the errors of the gyro and of the accelerometer,
integrated, are the larger part."""
STEPS_PER_SECOND: Final = 100.0


def climb_velocity(data: FlightData) -> Float[np.ndarray, " n"]:
    """Integrate the velocity along body z [m/s]; zero outside the segments' rows and neighbours."""
    climb = np.zeros(len(data.time))
    for segment in data.segments:
        rows = slice(max(segment.start - 1, 0), segment.stop + 1)
        climb[rows] = _along_z(
            data.specific_force[rows], data.angular_velocity[rows], data.sample_rate
        )
    return climb


def _along_z(
    force: Float[np.ndarray, "n 3"], rates: Float[np.ndarray, "n 3"], sample_rate: float
) -> Float[np.ndarray, " n"]:
    """Integrate the velocity of one segment along z, without slow changes."""
    group = max(round(sample_rate / STEPS_PER_SECOND), 1)
    count = len(force) // group
    if count < 2:
        return np.zeros(len(force))
    step = group / sample_rate
    f, w = (x[: count * group].reshape(count, group, 3).mean(axis=1) for x in (force, rates))
    # From the middle of one group to that of the next.
    between = np.concatenate([np.zeros((1, 3)), 0.5 * (w[:-1] + w[1:]) * step])
    attitude = running_product(small_turns(between))
    a = rotated(attitude, f)
    a -= a.mean(axis=0)
    v: Float[np.ndarray, "m 3"] = (np.cumsum(a, axis=0) - 0.5 * a) * step
    v = np.asarray(signal.detrend(v, axis=0))
    lines: Float[np.ndarray, "m 3"] = np.asarray(fft.dct(v, axis=0, norm="ortho"))
    lines[: int(2.0 * SLOWEST * count * step) + 1] = 0.0
    velocity: Float[np.ndarray, "m 3"] = np.asarray(fft.idct(lines, axis=0, norm="ortho"))
    along = rotated_back(attitude, velocity)[:, 2]
    middle = (np.arange(count) + 0.5) * group - 0.5
    return np.interp(np.arange(len(force)), middle, along)
