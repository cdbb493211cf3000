"""The vertical motion of a stretch of flight, and the mean that weighs it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

FORGOTTEN = 2.0
"""Time in which a vehicle's vertical velocity becomes another one [s]."""


@frozen_dataclass
class VerticalMotion:
    """Of one stretch without gaps, along the vertical as the gyro carries it.

    - `step`: between samples [s].
    - `read`: specific force by the accelerometer [m/s^2].
    - `push`: thrust over mass and k_t.
    - `velocity`: upwards [m/s], where the log has it.
    """

    step: float
    read: Float[np.ndarray, " n"]
    push: Float[np.ndarray, " n"]
    velocity: Float[np.ndarray, " n"] | None

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return len(self.read) * self.step

    @property
    def weights(self) -> Float[np.ndarray, " n"]:
        """Of the mean, with which an acceleration is the slope of the velocity."""
        return bell_weights(len(self.read))

    @property
    def slope_std(self) -> float:
        """Deviation of that slope over the one of the velocity [1/s]."""
        return slope_std(self.seconds)


def bell_weights(n: int) -> Float[np.ndarray, " n"]:
    """Return the weights of a mean, with which an acceleration is the slope of the velocity."""
    share = (np.arange(n) + 0.5) / n
    # 6 t (T - t) / T^3, by which the slope of the least-squares line weighs an acceleration.
    bell = share * (1.0 - share)
    return bell / bell.sum()


def slope_std(seconds: float) -> float:
    """Return the deviation of that slope over the one of the velocity [1/s]."""
    return float(np.sqrt(12.0 * min(FORGOTTEN / seconds, 1.0))) / seconds
