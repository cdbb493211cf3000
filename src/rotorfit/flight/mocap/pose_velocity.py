"""The velocity and the horizontal axes of a body, made of its poses.

The body's velocity, which the air's drag needs, is made of a pose where none is logged: position is
differentiated as motion capture is (one low-pass, one spline), and turned into body
axes by the attitude. The two need not be of the same instants: some logs have the cameras' position
and the vehicle's own attitude.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.clocks import usable_samples
from rotorfit.flight.kinematics import continuous_quaternions, rotated_back
from rotorfit.flight.mocap.camera import camera_clock, restamped
from rotorfit.flight.mocap.spikes import without_spikes
from rotorfit.flight.signals import (
    low_pass,
    spline_derivatives,
    whole_samples,
)
from rotorfit.logs.flight_log import Channel, FlightLog

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

CUTOFF: Final = 10.0
"""Low-pass on the position [Hz]: a velocity that moves drag lies far under it."""
CUTOFF_SHARE: Final = 0.25
"""The same at most, as a share of the frame rate."""
MARGIN: Final = 1.0
"""Left out at the ends of every run, in periods of the cut-off."""
LONGEST_BRIDGE: Final = 0.3
"""A straight line stands for the velocity over a loss of frames up to this [s]."""


def known_velocity(log: FlightLog) -> Channel | None:
    """Take the body-axes velocity of a log, else of its pose; None if neither is usable."""
    try:
        if "velocity" in log.channels:
            return usable_samples(log.channels["velocity"], "velocity")
        return velocity_of_pose(log)
    except FlightError:
        return None


def horizontal_axes(log: FlightLog) -> Channel | None:
    """Turn the world's axes x and y into body axes, six columns; None without an attitude."""
    if "attitude" not in log.channels:
        return None
    try:
        attitude = usable_samples(log.channels["attitude"], "attitude")
    except FlightError:
        return None
    axes = [
        rotated_back(attitude.values, np.full_like(attitude.values[:, 1:], axis))
        for axis in np.eye(3)[:2]
    ]
    return Channel(time=attitude.time, values=np.hstack(axes), source=attitude.source)


def velocity_of_pose(log: FlightLog) -> Channel | None:
    """Differentiate position and turn it into body axes [m/s]; None without both."""
    if not {"position", "attitude"} <= set(log.channels):
        return None
    place = usable_samples(log.channels["position"], "position")
    attitude = usable_samples(log.channels["attitude"], "attitude")
    fresh = np.concatenate([[True], np.any(place.values[1:] != place.values[:-1], axis=1)])
    time = restamped(place.time[fresh])
    position = without_spikes(time, place.values[fresh])[0]
    clock = camera_clock(time)
    cutoff = min(CUTOFF, CUTOFF_SHARE * clock.rate)
    margin = whole_samples(MARGIN / cutoff * clock.rate)
    times: list[Float[np.ndarray, " m"]] = []
    world: list[Float[np.ndarray, "m 3"]] = []
    for a, b in clock.runs:
        if b - a <= 2 * margin + 6:
            continue
        own, _ = spline_derivatives(low_pass(position[a:b], clock.rate, cutoff), clock.rate)
        times.append(clock.time[a + margin : b - margin])
        world.append(own[margin:-margin] if margin else own)
    if not times:
        return None
    return _in_body(
        *_bridge_losses(np.concatenate(times), np.concatenate(world), clock.rate),
        attitude,
        source=f"{place.source}, differentiated and turned by {attitude.source}",
    )


def _bridge_losses(
    time: Float[np.ndarray, " n"], velocity: Float[np.ndarray, "n 3"], rate: float
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    """Interpolate the velocity over short losses of frames."""
    steps = np.diff(time)
    short = np.flatnonzero((steps > 1.5 / rate) & (steps < LONGEST_BRIDGE + 2.0 * MARGIN / CUTOFF))
    more: list[Float[np.ndarray, " k"]] = [
        np.linspace(time[i], time[i + 1], round(float(steps[i]) * rate) + 1)[1:-1] for i in short
    ]
    whole = np.sort(np.concatenate([time, *more]))
    return whole, _interpolate_between(whole, time, velocity)


def _interpolate_between(
    at: Float[np.ndarray, " m"], time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "m k"]:
    result = np.empty((len(at), values.shape[1]))
    for k in range(values.shape[1]):
        result[:, k] = np.interp(at, time, values[:, k])
    return result


def _in_body(
    time: Float[np.ndarray, " n"],
    world: Float[np.ndarray, "n 3"],
    attitude: Channel,
    *,
    source: str,
) -> Channel:
    """Turn world vectors into body axes, by the attitude between its samples."""
    q = continuous_quaternions(attitude.values)
    known: Bool[np.ndarray, " n"] = (time >= attitude.time[0]) & (time <= attitude.time[-1])
    time, world = time[known], world[known]
    between = _interpolate_between(time, attitude.time, q)
    body = rotated_back(between / np.linalg.norm(between, axis=1, keepdims=True), world)
    return Channel(time=time, values=body, source=source)
