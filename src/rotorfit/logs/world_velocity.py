"""Turn a velocity into the body where a log gives it along world axes.

`nav_msgs/Odometry` and flight tables give it along the axes of the body. Many programs (VINS-
Fusion, FAST-LIO, simulators, bridges of motion capture) give that along the axes of the world. The
position beside it tells the two apart as soon as the vehicle turns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.units import world_to_body

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.logs.flight_log import Channel

STRIDE: Final = 0.2
"""Time over which the position tells a velocity [s]: noise of 5 mm is 35 mm/s."""
SURE: Final = 0.5
"""Error of a velocity by world axes over that by the body's, below which it is by world axes. With
vehicles that hardly turn both errors are alike, and the difference does not matter."""
FEWEST: Final = 20
"""Strides that tell the axes."""


def turn_world_velocity(channels: Mapping[str, Channel]) -> tuple[Channel, str] | None:
    """Return the velocity in the body and a note; None if it is there already, or unknown.

    `channels`: of one topic or table: position, attitude and velocity.
    """
    names = ("position", "attitude", "velocity")
    if not set(names) <= set(channels):
        return None
    place, attitude, velocity = (channels[name] for name in names)
    if not all(np.array_equal(one.time, velocity.time) for one in (place, attitude)):
        return None
    back = attitude.values * np.array([1.0, -1.0, -1.0, -1.0])
    in_world = world_to_body(velocity.values, back)
    errors = [
        _velocity_error(velocity.time, place.values, along) for along in (in_world, velocity.values)
    ]
    if not np.isfinite(errors).all() or errors[1] >= SURE * errors[0]:
        return None
    turned = world_to_body(velocity.values, attitude.values)
    note = (
        f"the velocity of {velocity.source} is along the axes of the world, as its position shows "
        f"(by them it is off by {errors[1]:.2g} m/s, by the body's by {errors[0]:.2g}): it is "
        "turned into the body."
    )
    return replace(
        velocity, values=turned, source=f"{velocity.source}, turned from the world"
    ), note


def _velocity_error(
    time: Float[np.ndarray, " n"], place: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]
) -> float:
    """Return the rms difference of a velocity from the change of place [m/s]; NaN if unknown."""
    steps = np.diff(time)
    count = max(round(STRIDE / float(np.median(steps))), 1) if len(steps) else 1
    if len(time) < FEWEST * count + 1:
        return np.nan
    way = np.zeros_like(place)
    way[1:] = np.cumsum(0.5 * steps[:, None] * (along[1:] + along[:-1]), axis=0)
    seconds = time[count::count] - time[:-count:count]
    moved = (place - way)[count::count] - (place - way)[:-count:count]
    speed = np.linalg.norm(moved, axis=1) / np.maximum(seconds, np.finfo(float).tiny)
    # Of most strides: a jump of the estimate is no velocity.
    return float(np.sqrt(np.mean(np.square(np.sort(speed)[: max(int(0.9 * len(speed)), 1)]))))
