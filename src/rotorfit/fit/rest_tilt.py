"""The IMU's tilt by its reading at rest: it decides between a turned IMU and a lean of the thrust.

Standing on its feet, a vehicle is level but for the slope of the ground and uneven feet. A lean
that is seen in flight alone, at rest neither before nor after, is drag of fast flight or a bias by
vibration, and no mounting of the IMU.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.dataset.plausible_units import LEAST_REST, WINDOW, rest_forces
from rotorfit.flight.imu_tilt import ImuTilt, tilt_of_force, tilt_phrase

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData

ON_ITS_FEET: Final = float(np.radians(30.0))
"""Angle up to which a vehicle stands on its feet: beyond, it lies where it crashed."""


def tilts_at_rest(data: FlightData) -> Iterator[ImuTilt]:
    """Yield the IMU's tilt against the ground, before the first flight and after the last.

    Of rests long enough, on its feet.
    """
    if not data.segments:
        return
    first, last = data.segments[0].start, data.segments[-1].stop
    every = list(rest_forces(data))
    for forces in (
        [force for row, force in every if row < first],
        [force for row, force in every if row >= last],
    ):
        if len(forces) * WINDOW < LEAST_REST:
            continue
        tilt = tilt_of_force(np.median(forces, axis=0))
        if tilt.angle < ON_ITS_FEET:
            yield tilt


def angle_between(one: ImuTilt, other: ImuTilt) -> float:
    """Return the angle between the z axes of two IMUs [rad]."""
    first, second = (_up_in_imu(tilt) for tilt in (one, other))
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


def _up_in_imu(tilt: ImuTilt) -> Float[np.ndarray, " 3"]:
    """Return the rotors' axis in the IMU's axes."""
    return tilt.rotation_imu_to_body[2]


def rest_denies_tilt(flights: Sequence[FlightData], tilt: ImuTilt) -> ImuTilt | None:
    """Return the reading at rest nearest to a tilt, where it is nearer to none."""
    rests = [rest for data in flights for rest in tilts_at_rest(data)]
    nearest = min(rests, key=lambda rest: angle_between(rest, tilt), default=None)
    # The ground and the feet lean a vehicle as likely one way as another (seven sound logs stand
    # 0.3 to 2.1 degrees from what they fly, an eighth 8.8), so that the nearer of the two is the
    # likelier one.
    if nearest is None or angle_between(nearest, tilt) <= nearest.angle:
        return None
    return nearest


def rest_sentence(tilt: ImuTilt, rest: ImuTilt) -> str:
    """Explain that the thrust leans in flight alone."""
    return (
        f"in flight the thrust is tilted as if the IMU were mounted {tilt_phrase(tilt)}, but at "
        f"rest it reads {tilt_phrase(rest) or 'level'}: drag in fast flight or a bias by vibration "
        "is the cause, and the readings are left as they are; kd, Jr and the inertia about z may "
        "be off, so fly slowly for them, or measure the mounting and give imu_tilt_deg"
    )
