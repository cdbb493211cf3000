r"""Slopes of the rotor speeds by delay, lag and skew of the motors, from one pass over the samples.

Behind the motors the speed follows :math:`O_{k+1} = a_k O_k + (1 - a_k) u_k` with
:math:`a = e^{-dt/\tau}`, :math:`\tau` that of rising or of falling speed. Differentiated by a time
t, it is the same recursion with another input:

.. math:: S_{k+1} = a_k S_k + (1 - a_k) \frac{\partial u_k}{\partial t}
    + (O_k - u_k) \frac{\partial a_k}{\partial t}, \quad
    \frac{\partial a}{\partial \tau} = a \frac{dt}{\tau^2}.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.flight.flight_data import FlightData
from rotorfit.flight.motors.motor_model import (
    SLOW_LAG,
    MotorResponse,
    clock_jumps,
    first_order_lag,
    follow_shares,
    following_speed,
    remaining_share,
    shift_time,
)
from rotorfit.flight.signals import central_difference

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int

Moved = tuple[FlightData, FlightData, float]
"""A flight with its rotors a step later, a step earlier, and the distance of the two."""


def flights_with_moved_motors(
    data: FlightData,
    channel: Float[np.ndarray, "n N"],
    response: MotorResponse,
    steps: Mapping[str, float],
) -> tuple[FlightData, list[Moved]] | None:
    """Retime the rotors of a flight, and move them along their slopes by a step of each time.

    The steps go to either side. None if the slopes need more than this recursion: motor data that
    were smoothed or averaged, and lags of which a step to either side would go below zero.

    Parameters
    ----------
    data
        The flight.
    channel
        Its motor channel [rad/s].
    response
        Lag and delay at which the slopes are wanted.
    steps
        Steps of ``motor_delay`` [s], ``motor_lag`` [s] and ``motor_skew`` [share].
    """
    lagging = "motor_lag" in steps or "motor_skew" in steps
    if data.differentiation == "exact" or data.lag_on != "speed":
        return None
    if lagging and response.mean_lag <= steps.get("motor_lag", 0.0):
        return None
    held, thinned = data.held, data.thinned
    if held is not None and not response.two_way and response.lag * data.sample_rate >= SLOW_LAG:
        return None  # means of commands, whose own time depends on the lag
    if held is None or thinned is None:
        jumps = clock_jumps(data.time, data.sample_rate) if thinned is None else thinned.jumps
        each = slopes_of_parts(channel, data.sample_rate, jumps, response, tuple(steps))
    else:
        wide = slopes_of_parts(held.speed, held.sample_rate, held.jumps, response, tuple(steps))
        each = [thinned(values) for values in wide]
    speed, *slopes = each
    rate = central_difference(speed, data.sample_rate)
    retimed = dataclasses.replace(data, rotor_speed=speed, rotor_acceleration=rate)
    moved: list[Moved] = []
    for slope, step in zip(slopes, steps.values(), strict=True):
        turn = central_difference(slope, data.sample_rate)
        later, earlier = (
            dataclasses.replace(
                data,
                rotor_speed=speed + side * step * slope,
                rotor_acceleration=rate + side * step * turn,
            )
            for side in (1.0, -1.0)
        )
        moved.append((later, earlier, 2.0 * step))
    return retimed, moved


def slopes_of_parts(
    channel: Float[np.ndarray, "n N"],
    sample_rate: float,
    jumps: Int[np.ndarray, " j"],
    response: MotorResponse,
    names: Sequence[str],
) -> list[Float[np.ndarray, "n N"]]:
    """Return the speed and its slopes, separately for the parts between gaps of the clock."""
    parts = [
        speed_and_slopes(part, sample_rate, response, names) for part in np.split(channel, jumps)
    ]
    return [np.concatenate(each) for each in zip(*parts, strict=True)]


def speed_and_slopes(
    channel: Float[np.ndarray, "n N"],
    sample_rate: float,
    response: MotorResponse,
    names: Sequence[str],
) -> list[Float[np.ndarray, "n N"]]:
    """Return the speed behind delay and lag [rad/s], and its slope by each named time."""
    held = shift_time(channel, sample_rate, response.delay)
    speed = following_speed(held, sample_rate, dataclasses.replace(response, delay=0.0))
    rising = held > speed
    keep = np.where(
        rising, *(remaining_share(sample_rate, lag) for lag in _lags_both_ways(response))
    )
    slopes: list[Float[np.ndarray, "n N"]] = []
    for name in names:
        if name == "motor_delay":
            late = shift_time(channel, sample_rate, response.delay, slope=True)
            slopes.append(_follow_slope(late, keep, sample_rate, response))
        else:
            input = _lag_sensitivity(name, rising, sample_rate, response) * (speed - held)
            still: Float[np.ndarray, " N"] = 0.0 * channel[0]
            slopes.append(follow_shares(keep, input, still))
    return [speed, *slopes]


def _follow_slope(
    late: Float[np.ndarray, "n N"],
    keep: Float[np.ndarray, "n N"],
    sample_rate: float,
    response: MotorResponse,
) -> Float[np.ndarray, "n N"]:
    """Filter the slope of the delayed channel by the lag that holds at each sample."""
    if not response.two_way:
        return first_order_lag(late, sample_rate, response.lag)
    first: Float[np.ndarray, " N"] = late[0]
    return follow_shares(keep, (1.0 - keep) * late, first)


def _lags_both_ways(response: MotorResponse) -> tuple[float, float]:
    """Return the lags of rising and of falling speed [s]."""
    return response.lag, response.lag if response.lag_down is None else response.lag_down


def _lag_sensitivity(
    name: str, rising: Bool[np.ndarray, "n N"], sample_rate: float, response: MotorResponse
) -> Float[np.ndarray, "n N"]:
    """Differentiate a by the mean lag L or by the skew s: lags are L (1 - s) and L (1 + s)."""
    mean = response.mean_lag
    each: list[float] = []
    for lag, side in zip(_lags_both_ways(response), (-1.0, 1.0), strict=True):
        by_lag = remaining_share(sample_rate, lag) / (sample_rate * lag**2) if lag > 0.0 else 0.0
        each.append(by_lag * (side * mean if name == "motor_skew" else lag / mean))
    return np.where(rising, *each)
