"""Refuse roll and pitch that respond as if the IMU were turned about z against the rotors.

The response to the torques of the rotors is then a turn times a symmetric matrix. In a calm hover
gusts turn a vehicle more than its rotors do, and the few turns of a short flight may look like one:
a turned IMU is refused where the 95 % interval of the angle holds no tolerance of a mounting.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FrameError
from rotorfit.fit.dataset.response_signals import (
    CLEAR,
    cross_signals,
    inside_band,
    select_response_band,
)

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.model.vehicle import Vehicle

TURNED = float(np.radians(12.0))
"""Angle about z between IMU and rotors from which it is no tolerance: sound logs have up to 3.5."""

OTHER_LAYOUT: Final = {
    4: " (quad-plus instead of quad-x)",
    6: " (hexa-plus instead of hexa-x)",
}
"""Layouts that differ by a turn, by the number of rotors."""


def refuse_turned(factors: Factors, vehicle: Vehicle) -> None:
    """Raise where roll and pitch respond as if the IMU were turned about z against the rotors."""
    angle, shares = turn_about_z(inside_band(factors), vehicle)
    if abs(angle) <= TURNED or min(shares) <= CLEAR:
        return
    # In a calm hover gusts turn the vehicle more than the rotors do, and it may look turned.
    if abs(angle) - 1.96 * std_of_turn(factors, vehicle) > TURNED:
        raise FrameError(
            f"roll and pitch respond to the rotors as if the IMU were turned by "
            f"{abs(np.degrees(angle)):.0f} degrees "
            f"{'counter-clockwise' if angle > 0 else 'clockwise'} about z (seen from above) "
            "relative to the rotors: turn the rotors' positions by as much the other way, or give "
            f"the layout that really flies{OTHER_LAYOUT.get(len(vehicle.rotors), '')}"
        )


def std_of_turn(factors: Factors, vehicle: Vehicle) -> float:
    """Compute the standard deviation of the angle of `turn_about_z` [rad]."""
    import scipy.linalg  # slow to import

    blocks = select_response_band(factors)
    torque, turned = cross_signals(blocks.total, blocks.total, vehicle)
    inverse: Float[np.ndarray, "2 2"] = scipy.linalg.pinvh(torque.T @ torque)
    response = inverse @ torque.T @ turned
    # By the residual of each block, whose rows count as independent: gusts are strong in some bands
    # and phases, weak in others (White, Econometrica 48, 1980).
    covariance = np.zeros((2, 2, 2))
    for R, rows in zip(blocks.R, blocks.rows, strict=True):
        own, acceleration = cross_signals(R, blocks.total, vehicle)
        left = ((acceleration - own @ response) ** 2).sum(axis=0) / max(int(rows), 1)
        covariance += left[:, None, None] * (own.T @ own)
    of_roll, of_pitch = inverse @ covariance @ inverse
    # tan(angle) = (B21 - B12) / (B11 + B22), and its derivatives by the columns of B.
    size = response[0, 0] + response[1, 1]
    tangent = (response[1, 0] - response[0, 1]) / size
    by_roll, by_pitch = np.array([-tangent, 1.0]), np.array([-1.0, -tangent])
    variance = float(by_roll @ of_roll @ by_roll + by_pitch @ of_pitch @ by_pitch) / size**2
    return float(np.sqrt(variance)) / (1.0 + float(tangent) ** 2)


def turn_about_z(
    R: Float[np.ndarray, "r z"], vehicle: Vehicle
) -> tuple[float, tuple[float, float]]:
    """Estimate the least turn of the IMU about z [rad], and the shares of roll and pitch in it."""
    import scipy.linalg  # slow to import

    torque, turned = cross_signals(R, R, vehicle)
    response: Float[np.ndarray, "2 2"] = scipy.linalg.pinv(torque, rtol=1e-9) @ turned
    left = ((turned - torque @ response) ** 2).sum(axis=0)
    total = np.maximum((turned**2).sum(axis=0), np.finfo(float).tiny)
    roll, pitch = (1.0 - left / total).tolist()
    # A vector reads turned back in axes that are turned.
    # The response is a turn times a symmetric matrix, the inverse inertia (polar decomposition).
    angle = np.arctan2(response[1, 0] - response[0, 1], response[0, 0] + response[1, 1])
    # Each torque by itself turns its response as far; of an axis that nobody flies only one does.
    alone = np.arctan2([-response[0, 1], response[1, 0]], np.diagonal(response))
    agreed = np.abs([angle, *alone]).min() if (alone * angle > 0.0).all() else 0.0
    return float(np.copysign(agreed, angle)), (roll, pitch)
