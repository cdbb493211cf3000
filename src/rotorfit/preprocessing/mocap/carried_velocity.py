"""The velocity that carries the rotors sideways, from rare positions and the IMU between them.

Cameras tell the place rarely and with gaps, the accelerometer what happens between: turned by the
attitude and integrated it is a place but for a slow drift, which is the smoothest curve through
what is left of the camera's (a natural cubic spline: De Boor, A Practical Guide to Splines, 1978,
chapter XIV). The position need not be of the instants of the attitude: some logs have the cameras'
position and the vehicle's own attitude.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import make_smoothing_spline
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.clocks import usable_samples
from rotorfit.preprocessing.kinematics import continuous_quaternions
from rotorfit.preprocessing.mocap.camera import without_spikes

PLACE_STD: Final = 0.03
"""Error of one position [m]: its time is off by up to 10 ms."""
DRIFT_STD: Final = 0.5
"""Error of the acceleration, over a second [m/s^2]: 3 degrees of attitude."""
MOST_DRIFT: Final = 4.0 * DRIFT_STD
"""Over which attitude, position and accelerometer contradict one another."""
LONGEST_BRIDGE: Final = 0.5
"""From the next position to the farthest instant with a velocity [s]."""
FEWEST: Final = 5
"""Positions of a spline."""


def carried_velocity(log: FlightLog) -> Channel | None:
    """Integrate the accelerometer between positions, body axes [m/s]; None where that is no use."""
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
    near = _near(time, fixes)
    if len(fixes) < FEWEST or near.sum() < FEWEST:
        return None
    turned = _attitude(time, attitude)
    force = turned.apply(accel.values[turning])
    position = without_spikes(fixes, place.values[fresh])[0]
    world = _velocity(time, force, fixes, position, near)
    if world is None:
        return None
    return Channel(
        time=time[near],
        values=turned.apply(world, inverse=True)[near],
        source=f"{place.source}, with {accel.source} between, turned by {attitude.source}",
    )


def _near(time: Float[np.ndarray, " n"], fixes: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " n"]:
    """Mark the instants that have a position not far away."""
    after = np.searchsorted(fixes, time)
    distance = np.minimum(
        np.abs(time - fixes[np.clip(after, 0, len(fixes) - 1)]),
        np.abs(time - fixes[np.clip(after - 1, 0, len(fixes) - 1)]),
    )
    return distance <= LONGEST_BRIDGE


def _attitude(at: Float[np.ndarray, " n"], attitude: Channel) -> Rotation:
    """Interpolate the rotation from the body to the world at other times."""
    q = continuous_quaternions(attitude.values)
    between = np.column_stack([np.interp(at, attitude.time, q[:, k]) for k in (1, 2, 3, 0)])
    return Rotation.from_quat(between)


def _velocity(
    time: Float[np.ndarray, " n"],
    force: Float[np.ndarray, "n 3"],
    fixes: Float[np.ndarray, " m"],
    position: Float[np.ndarray, "m 3"],
    near: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"] | None:
    """Integrate specific force in world axes, and take the drift off; None where it is too much."""
    steps = np.diff(time, prepend=time[:1])[:, None]
    velocity: Float[np.ndarray, "n 3"] = np.cumsum((force - [0.0, 0.0, GRAVITY]) * steps, axis=0)
    path: Float[np.ndarray, "n 3"] = np.cumsum(velocity * steps, axis=0)
    for k in range(3):
        left = position[:, k] - np.interp(fixes, time, path[:, k])
        drift = make_smoothing_spline(fixes, left, lam=(PLACE_STD / DRIFT_STD) ** 2)
        if float(np.std(drift(time[near], 2))) > MOST_DRIFT:
            return None
        velocity[:, k] += drift(time, 1)
    return velocity
