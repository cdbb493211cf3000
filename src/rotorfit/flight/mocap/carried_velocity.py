"""The velocity that carries the rotors sideways, from rare positions and the IMU between them.

Cameras show the place rarely and with gaps, the accelerometer what happens between: turned by the
attitude and integrated it is a place but for a slow drift, which is the smoothest curve through
what is left of the camera's (a natural cubic spline: De Boor, A Practical Guide to Splines, 1978,
chapter XIV). The position need not be of the instants of the attitude: some logs have the cameras'
position and the vehicle's own attitude.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.clocks import usable_samples
from rotorfit.flight.kinematics import continuous_quaternions, rotated, rotated_back
from rotorfit.flight.mocap.spikes import without_spikes
from rotorfit.flight.smoothing_spline import smoothing_spline_derivatives
from rotorfit.logs.flight_log import Channel, FlightLog

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

PLACE_STD: Final = 0.03
"""Error of one position [m]: its time is off by up to 10 ms."""
DRIFT_STD: Final = 0.5
"""Error of the acceleration, over a second [m/s^2]: 3 degrees of attitude."""
MOST_DRIFT: Final = 4.0 * DRIFT_STD
"""Over which attitude, position and accelerometer contradict one another."""
LONGEST_CARRIED: Final = 0.5
"""Longest time from the next position to the farthest instant with a velocity [s]."""
FEWEST: Final = 5
"""Positions of a spline."""


def carried_velocity(log: FlightLog) -> Channel | None:
    """Integrate the accelerometer between positions, body axes [m/s]; None if that is no use."""
    if not {"position", "attitude", "accel"} <= set(log.channels):
        return None
    try:
        return _between_positions(log)
    except FlightError:
        return None


def _between_positions(log: FlightLog) -> Channel | None:
    place, attitude, accel = (
        usable_samples(log.channels[name], name) for name in ("position", "attitude", "accel")
    )
    fresh = np.concatenate([[True], np.any(place.values[1:] != place.values[:-1], axis=1)])
    fixes = place.time[fresh]
    turning = (accel.time >= attitude.time[0]) & (accel.time <= attitude.time[-1])
    time = accel.time[turning]
    near = _mark_near_fixes(time, fixes)
    if len(fixes) < FEWEST or near.sum() < FEWEST:
        return None
    turned = _interpolate_attitude(time, attitude)
    force = rotated(turned, accel.values[turning])
    position = without_spikes(fixes, place.values[fresh])[0]
    world = _integrate_velocity(time, force, fixes, position, near)
    if world is None:
        return None
    return Channel(
        time=time[near],
        values=rotated_back(turned, world)[near],
        source=f"{place.source}, with {accel.source} between, turned by {attitude.source}",
    )


def _mark_near_fixes(
    time: Float[np.ndarray, " n"], fixes: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " n"]:
    """Mark the instants that have a position not far away."""
    after = np.searchsorted(fixes, time)
    distance = np.minimum(
        np.abs(time - fixes[np.clip(after, 0, len(fixes) - 1)]),
        np.abs(time - fixes[np.clip(after - 1, 0, len(fixes) - 1)]),
    )
    return distance <= LONGEST_CARRIED


def _interpolate_attitude(
    at: Float[np.ndarray, " n"], attitude: Channel
) -> Float[np.ndarray, "n 4"]:
    """Interpolate the rotation from the body to the world at other times, as quaternions."""
    q = continuous_quaternions(attitude.values)
    between = np.column_stack([np.interp(at, attitude.time, q[:, k]) for k in range(4)])
    return between / np.linalg.norm(between, axis=1, keepdims=True)


def _integrate_velocity(
    time: Float[np.ndarray, " n"],
    force: Float[np.ndarray, "n 3"],
    fixes: Float[np.ndarray, " m"],
    position: Float[np.ndarray, "m 3"],
    near: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"] | None:
    """Integrate specific force in world axes, and take the drift off; None if it is too much."""
    steps = np.diff(time, prepend=time[:1])[:, None]
    velocity: Float[np.ndarray, "n 3"] = np.cumsum((force - [0.0, 0.0, GRAVITY]) * steps, axis=0)
    path: Float[np.ndarray, "n 3"] = np.cumsum(velocity * steps, axis=0)
    for k in range(3):
        # What the path lacks at the fixes is the drift of a twice integrated bias, and smooth.
        left = position[:, k] - np.interp(fixes, time, path[:, k])
        slope, bend = smoothing_spline_derivatives(
            fixes, left, time, penalty=(PLACE_STD / DRIFT_STD) ** 2
        )
        if float(np.std(bend[near])) > MOST_DRIFT:
            return None
        velocity[:, k] += slope
    return velocity
