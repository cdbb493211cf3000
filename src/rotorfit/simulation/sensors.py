"""The sensors: gyro, accelerometer at its place, and rotor speeds, each with its errors."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Errors of the sensors: white noise, constant bias, and the smallest step of the log.

    Attributes
    ----------
    gyro_std, accel_std, rotor_speed_std
        Standard deviation of the noise of each component [rad/s, m/s^2, rad/s].
    gyro_bias, accel_bias
        Constant, body axes [rad/s, m/s^2].
    gyro_resolution, accel_resolution, rotor_speed_resolution
        Smallest step; 0 for none [rad/s, m/s^2, rad/s].
    position_std, attitude_std
        Noise of each component of the motion-capture pose [m, rad].
    pose_rate
        Frames of the motion capture per second; 0: one with every sample of the log [Hz].
    pose_delay
        How much later than it was a pose stands in the log [s].
    """

    gyro_std: float = 0.0
    accel_std: float = 0.0
    rotor_speed_std: float = 0.0
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_resolution: float = 0.0
    accel_resolution: float = 0.0
    rotor_speed_resolution: float = 0.0
    position_std: float = 0.0
    attitude_std: float = 0.0
    pose_rate: float = 0.0
    pose_delay: float = 0.0


PERFECT: Final = Sensors()
"""No errors."""

TYPICAL: Final = Sensors(gyro_std=0.02, accel_std=0.4, rotor_speed_std=5.0)
"""White noise of a small multirotor at 200 Hz, vibration included."""


def measured(
    exact: Float[np.ndarray, "n k"],
    *,
    std: float,
    rng: np.random.Generator,
    bias: tuple[float, ...] = (0.0,),
    resolution: float = 0.0,
) -> Float[np.ndarray, "n k"]:
    """Return what a sensor logs of a quantity: bias and noise added, then rounded to its steps."""
    values = exact + np.array(bias) + std * rng.normal(size=exact.shape)
    return np.round(values / resolution) * resolution if resolution > 0 else values


def at_place(
    specific_force: Float[np.ndarray, "n 3"],
    angular_velocity: Float[np.ndarray, "n 3"],
    angular_acceleration: Float[np.ndarray, "n 3"],
    *,
    position: tuple[float, float, float],
) -> Float[np.ndarray, "n 3"]:
    """Return the specific force at a place of the body: a + dw x r + w x (w x r).

    Parameters
    ----------
    specific_force
        At the body origin, body axes [m/s^2].
    angular_velocity, angular_acceleration
        Body axes [rad/s, rad/s^2].
    position
        Of the place from the body origin, body axes [m].
    """
    w, r = angular_velocity, np.array(position)
    return specific_force + np.cross(angular_acceleration, r) + np.cross(w, np.cross(w, r))


def gauss_markov(
    std: Float[np.ndarray, " k"],
    *,
    bandwidth: float,
    samples: int,
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n k"]:
    """Return a stationary first-order Gauss-Markov process.

    Parameters
    ----------
    std
        Standard deviation of each column.
    bandwidth
        Corner frequency [Hz].
    samples, sample_rate
        Number of samples, and how many of them a second [Hz].
    rng
        Source of the numbers.
    """
    keep = float(np.exp(-2 * np.pi * bandwidth / sample_rate))
    noise = rng.normal(size=(samples, std.size))
    noise[1:] *= np.sqrt(1 - keep**2)
    for row in range(1, samples):
        noise[row] += keep * noise[row - 1]
    return noise * std
