r"""The tilt of the IMU: turned by small angles about x and y against the plane of the rotors.

In flight the thrust carries the vehicle, so that the mean specific force lies along the rotors'
axis whatever the attitude: where it leans in the IMU's axes, the IMU leans in the vehicle. Drag of
a fast flight leans it, too; it goes with the velocity, and is taken off where that is known. A bias
leans it as well, which the caller must tell from a turned IMU.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.kinematics import climb_velocity
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.prepare import PreparedFlight

LEAST_TILT: Final = float(np.radians(5.0))
"""Tilt below which a usual bias explains the lean (sound logs: up to 4.5 degrees)."""


@frozen_dataclass
class ImuTilt:
    """The tilt of the IMU in the vehicle.

    - `roll`: of the IMU, right side down [rad].
    - `pitch`: of the IMU, nose up [rad].
    """

    roll: float = 0.0
    pitch: float = 0.0

    @property
    def rotation_imu_to_body(self) -> Float[np.ndarray, "3 3"]:
        """Turns vectors of the IMU (FLU) into the rotors' axes."""
        # About y (left) a positive turn lowers the nose.
        (c, s), (C, S) = ((np.cos(angle), np.sin(angle)) for angle in (self.roll, -self.pitch))
        return np.array([[C, 0.0, S], [s * S, c, -s * C], [-c * S, s, c * C]])

    @property
    def angle(self) -> float:
        """Between the IMU's z and the rotors' axis [rad]."""
        return float(np.arccos(np.clip(self.rotation_imu_to_body[2, 2], -1.0, 1.0)))


def mean_force_tilt(flights: Sequence[FlightData]) -> ImuTilt:
    """Compute the IMU's tilt if the mean specific force of all flights' samples is along z."""
    return tilt_of_force(sum((force_without_drag(one).sum(axis=0) for one in flights), np.zeros(3)))


def force_without_drag(data: FlightData) -> Float[np.ndarray, "n 3"]:
    """Return the specific force of the used rows without what goes with the velocity across.

    As it is in rows without a velocity [m/s^2].
    """
    force = data.specific_force[data.used_rows]
    if data.velocity is None:
        return force
    across = data.velocity[data.used_rows, :2]
    known = np.isfinite(across[:, 0]) & np.isfinite(across[:, 1])
    if not known.any():
        return force
    moved, felt = (x[known] - x[known].mean(axis=0) for x in (across, force[:, :2]))
    energy = float(np.square(moved).sum())
    drag = max(-float(np.sum(moved * felt)) / energy, 0.0) if energy > 0.0 else 0.0
    return force + np.pad(drag * np.where(known[:, None], across, 0.0), ((0, 0), (0, 1)))


def tilt_of_force(force: Float[np.ndarray, " 3"]) -> ImuTilt:
    """Compute the IMU's tilt if a specific force in its axes is along z of the vehicle."""
    x, y, z = force.tolist()
    return ImuTilt(roll=float(np.arctan2(y, np.hypot(x, z))), pitch=float(np.arctan2(x, z)))


def tilt_phrase(tilt: ImuTilt) -> str:
    """Describe a mounting: "10.1 degrees nose down"."""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    parts = [
        f"{abs(angle):.1f} degrees {words[angle > 0]}"
        for angle, words in (
            (pitch, ("nose down", "nose up")),
            (roll, ("left side down", "right side down")),
        )
        if abs(angle) >= 1.0
    ]
    return " and ".join(parts)


def levelled(prepared: PreparedFlight, tilt: ImuTilt) -> PreparedFlight:
    """Turn a flight's IMU signals, and the velocity given in its axes, into the rotors' axes."""
    R = tilt.rotation_imu_to_body
    data = prepared.data
    turned = dataclasses.replace(
        data,
        specific_force=data.specific_force @ R.T,
        angular_velocity=data.angular_velocity @ R.T,
        angular_acceleration=data.angular_acceleration @ R.T,
        velocity=None if data.velocity is None else data.velocity @ R.T,
        carried=None if data.carried is None else data.carried @ R.T,
        world_axes=None
        if data.world_axes is None
        else np.hstack([data.world_axes[:, :3] @ R.T, data.world_axes[:, 3:] @ R.T]),
    )
    if data.climb is None or data.climb.any():  # zero where the velocity is known, and stays so
        turned = dataclasses.replace(turned, climb=climb_velocity(turned))
    return dataclasses.replace(prepared, data=turned)
