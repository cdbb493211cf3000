"""The speeds that commands lead to, at the instants of measured ones; and their slopes.

A command is held until the next one. Between two of them a rotor approaches the speed that its
command settles at exponentially, so that its speed at any instant is exact on any two clocks,
however they jitter: no channel is resampled, and a delay is any number of seconds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.cubic_spline import cubic_spline_between
from rotorfit.flight.recursion import solve_recursion
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.flight.motors.command_response import MeasuredResponse

SETTLING: Final = 0.5
"""Time after the beginning of a stretch in which nothing counts: earlier speeds are unknown [s]."""
FASTEST: Final = 125.0
"""Highest rate of the measured speeds that count [Hz]: the error between two of them lasts longer
than their distance, so that more of them add nothing (lags from 12 Hz are as sharp as from 500)."""
MOST_ROUNDS: Final = 40
SETTLED: Final = 1e-9
FINE: Final = 1e-3
"""Time between commands that are drawn between those of the log [s]."""
FEWEST_DRAWN: Final = 4
ROUNDING: Final = 0.05
"""Share of a step by which as many commands as fit may be longer: clocks are rounded."""
STRETCH_DISTANCE: Final = 1e4
"""Distance of two stretches on the common clock: longer than any of them [s]."""


@frozen_dataclass
class Recording:
    """All stretches of all rotors, one after the other on one clock.

    - `command_time`: rising throughout [s].
    - `command`: 0 to 1.
    - `voltage`: over its median, at the commands; None if there is none.
    - `nominal_voltage`: that median [V].
    - `rotor`: of each command, among `rotors`.
    - `rotors`: those that are there, from 0 in the log's order.
    - `flight`, `since`: in which flight each command was given, and how long after its middle [s].
    - `begins`: commands at which a stretch begins.
    - `time`: of the measured speeds, on the same clock [s].
    - `speed`: [rad/s]
    - `speed_rotor`, `speed_flight`: of each speed.
    - `flight_time`: when it was measured on the flight's own clock [s].
    """

    command_time: Float[np.ndarray, " n"]
    command: Float[np.ndarray, " n"]
    voltage: Float[np.ndarray, " n"] | None
    nominal_voltage: float | None
    rotor: Int[np.ndarray, " n"]
    rotors: tuple[int, ...]
    flight: Int[np.ndarray, " n"]
    since: Float[np.ndarray, " n"]
    begins: Bool[np.ndarray, " n"]
    time: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]
    speed_rotor: Int[np.ndarray, " m"]
    speed_flight: Int[np.ndarray, " m"]
    flight_time: Float[np.ndarray, " m"]


@frozen_dataclass
class Timing:
    """Logarithms of the rising lag [s] and of falling over rising, and the delay [s]."""

    log_lag: float
    log_ratio: float
    delay: float


def recording_of(flights: Sequence[Sequence[MeasuredResponse]]) -> Recording | None:
    """Join the responses of all flights on one clock; None if nothing is left."""
    listed = [(k, a) for k, responses in enumerate(flights) for a in responses]
    if not listed:
        return None
    stretches = [a for _, a in listed]
    volts = [a.voltage for a in stretches if a.voltage is not None]
    nominal = None
    if len(volts) == len(stretches):
        nominal = float(np.median(np.concatenate(volts)))
    rotors = tuple(sorted({a.rotor for a in stretches}))
    present = sorted({k for k, _ in listed})  # a flight may have no stretch that is left
    sizes = [len(a.command) for a in stretches]
    begins = np.zeros(sum(sizes), dtype=bool)
    begins[np.cumsum([0, *sizes[:-1]])] = True
    offsets = [i * STRETCH_DISTANCE - float(a.command_time[0]) for i, a in enumerate(stretches)]
    used = [_mark_fitted_speeds(a) for a in stretches]
    counts = [int(rows.sum()) for rows in used]
    flight = np.array([present.index(k) for k, _ in listed])
    number = np.array([rotors.index(a.rotor) for a in stretches])
    clock = np.concatenate([a.command_time for a in stretches])
    owner = np.repeat(flight, sizes)
    middle = [
        0.5 * (clock[owner == k].min() + clock[owner == k].max()) for k in range(len(present))
    ]
    return Recording(
        command_time=clock + np.repeat(offsets, sizes),
        command=np.concatenate([a.command for a in stretches]),
        voltage=None if nominal is None else np.concatenate(volts) / nominal,
        nominal_voltage=nominal,
        rotor=np.repeat(number, sizes),
        rotors=rotors,
        flight=owner,
        since=clock - np.array(middle)[owner],
        begins=begins,
        time=np.concatenate(
            [a.speed_time[rows] + o for a, o, rows in zip(stretches, offsets, used, strict=True)]
        ),
        speed=np.concatenate([a.speed[rows] for a, rows in zip(stretches, used, strict=True)]),
        speed_rotor=np.repeat(number, counts),
        speed_flight=np.repeat(flight, counts),
        flight_time=np.concatenate(
            [a.speed_time[rows] for a, rows in zip(stretches, used, strict=True)]
        ),
    )


def _mark_fitted_speeds(response: MeasuredResponse) -> Bool[np.ndarray, " m"]:
    time = response.speed_time
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    stride = max(int(1.0 / (FASTEST * step)), 1) if step > 0.0 else 1
    every = np.arange(len(time)) % stride == 0
    return every & (time >= response.command_time[0] + SETTLING)


def drawn_between(recording: Recording) -> Recording:
    """Interpolate smooth commands between those of a log that keeps only some of the loop's.

    A cubic spline through each stretch, in steps of some `FINE` seconds that hold its middles.
    """
    step = float(np.median(np.diff(recording.command_time)))
    parts = round(step / FINE)
    if parts < 2:
        return recording
    starts = np.flatnonzero(recording.begins)
    pieces = zip(
        np.split(recording.command_time, starts[1:]),
        np.split(recording.command, starts[1:]),
        strict=True,
    )
    drawn = [_draw_commands(time, command, step, parts) for time, command in pieces]
    rows = np.repeat(np.arange(len(recording.command)), parts)
    volts = recording.voltage
    return replace(
        recording,
        command_time=np.concatenate([time for time, _ in drawn]),
        command=np.concatenate([command for _, command in drawn]),
        voltage=None if volts is None else volts[rows],
        rotor=recording.rotor[rows],
        flight=recording.flight[rows],
        since=recording.since[rows],
        begins=recording.begins[rows] & (np.arange(len(rows)) % parts == 0),
    )


def _draw_commands(
    time: Float[np.ndarray, " n"], command: Float[np.ndarray, " n"], step: float, parts: int
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Draw one stretch: the times from which each of the finer commands holds, and these."""
    lasts = np.diff(time, append=time[-1] + step)[:, None]
    shares = np.arange(parts) / parts
    begin = (time[:, None] + lasts * shares).ravel()
    if len(time) < FEWEST_DRAWN:
        return begin, np.repeat(command, parts)
    between = cubic_spline_between(time, command, shares + 0.5 / parts)
    curve = np.append(between.ravel(), np.full(parts, command[-1]))
    return begin, np.clip(curve, command.min(), command.max())


def merged_commands(recording: Recording, step: float) -> Recording:
    """Replace neighbouring commands by their mean, as many as are given within `step` [s]."""
    time = recording.command_time
    lasts = np.diff(time, append=time[-1])
    usual = float(np.median(lasts))
    count = int(step / usual + ROUNDING) if usual > 0.0 else 1
    if count < 2:
        return recording
    starts = np.flatnonzero(recording.begins)
    ends = np.append(starts[1:], len(time))
    lasts[ends - 1] = usual
    since_begin = np.arange(len(time)) - np.repeat(starts, ends - starts)
    first = np.flatnonzero(since_begin % count == 0)
    whole = np.add.reduceat(lasts, first)
    volts = recording.voltage
    return replace(
        recording,
        command_time=time[first],
        command=np.add.reduceat(recording.command * lasts, first) / whole,
        voltage=None if volts is None else np.add.reduceat(volts * lasts, first) / whole,
        rotor=recording.rotor[first],
        flight=recording.flight[first],
        since=np.add.reduceat(recording.since * lasts, first) / whole,
        begins=recording.begins[first],
    )


def selected_speeds(recording: Recording, rows: Bool[np.ndarray, " m"] | slice) -> Recording:
    """Keep some of the measured speeds."""
    return replace(
        recording,
        time=recording.time[rows],
        speed=recording.speed[rows],
        speed_rotor=recording.speed_rotor[rows],
        speed_flight=recording.speed_flight[rows],
        flight_time=recording.flight_time[rows],
    )


def speed_response(
    recording: Recording,
    settled: Float[np.ndarray, " n"],
    settled_slopes: Float[np.ndarray, "p n"],
    timing: Timing,
    *,
    two_way: bool = True,
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "q m"]]:
    r"""Predict the speed at the instants of measurement [rad/s], and its derivatives.

    :math:`O(t) = g_k + (O_k - g_k) e^{-(t - t_k)/\tau}` while command k is in force, g_k being
    the speed that it settles at, and tau that of the way it goes. Derivatives, one row each, by
    the law's parameters, then log lag, log ratio (if `two_way`), delay.
    """
    up = float(np.exp(timing.log_lag))
    down = float(np.exp(timing.log_lag + timing.log_ratio))
    step = np.diff(recording.command_time, append=recording.command_time[-1] + 1.0)
    rising, remaining, at_command = _at_commands(recording, settled, step, up=up, down=down)
    lag: Float[np.ndarray, " n"] | float = up if up == down else np.where(rising, up, down)
    away = at_command - settled
    p = len(settled_slopes)
    into = np.empty((p + 1 + int(two_way), len(settled)))
    np.multiply(settled_slopes, 1.0 - remaining, out=into[:p])
    into[p] = remaining * step / lag * away  # by the logarithm of the lag in force
    if two_way:
        into[-1] = np.where(rising, 0.0, into[p])
    start = np.zeros((len(into), int(recording.begins.sum())))
    start[:p] = settled_slopes[:, recording.begins]
    moved = _follow_stretches(remaining, into, start, recording.begins)
    k, since = _commands_in_force(recording, timing.delay)
    rate = since / (up if up == down else np.take(lag, k))
    left = np.exp(-rate)
    fading = away[k] * left
    slopes = np.empty((len(into) + 1, len(k)))
    for row in range(p):
        at_start = settled_slopes[row][k]
        slopes[row] = at_start + (moved[row][k] - at_start) * left
    late = fading * rate
    slopes[p] = moved[p][k] * left + late
    if two_way:
        slopes[p + 1] = moved[p + 1][k] * left + np.where(rising[k], 0.0, late)
    slopes[-1] = fading / (up if up == down else np.take(lag, k))
    return settled[k] + fading, slopes


def respond_to_commands(
    recording: Recording, settled: Float[np.ndarray, " n"], timing: Timing
) -> Float[np.ndarray, " m"]:
    """Predict the speed at the instants of measurement [rad/s], as `speed_response`."""
    up = float(np.exp(timing.log_lag))
    down = float(np.exp(timing.log_lag + timing.log_ratio))
    step = np.diff(recording.command_time, append=recording.command_time[-1] + 1.0)
    rising, _, at_command = _at_commands(recording, settled, step, up=up, down=down)
    k, since = _commands_in_force(recording, timing.delay)
    left = np.exp(-since / (up if up == down else np.where(rising[k], up, down)))
    return settled[k] + (at_command[k] - settled[k]) * left


def speeds_at_delays(
    recording: Recording, settled: Float[np.ndarray, " n"], lag: float, delays: Sequence[float]
) -> list[Float[np.ndarray, " m"]]:
    """Predict the speed at the instants of measurement for one lag and each delay [rad/s].

    As `speed_response`, without derivatives: the recursion over the commands is run once.
    """
    step = np.diff(recording.command_time, append=recording.command_time[-1] + 1.0)
    away = _at_commands(recording, settled, step, up=lag, down=lag)[2] - settled
    speeds: list[Float[np.ndarray, " m"]] = []
    for delay in delays:
        k, since = _commands_in_force(recording, delay)
        speeds.append(settled[k] + away[k] * np.exp(-since / lag))
    return speeds


def _commands_in_force(
    recording: Recording, delay: float
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return which command is in force at each measured speed, and since when [s]."""
    at = recording.time - delay
    k = np.searchsorted(recording.command_time, at, side="right") - 1
    k = np.clip(k, 0, len(recording.command) - 1)
    return k, np.maximum(at - recording.command_time[k], 0.0)


def _at_commands(
    recording: Recording,
    settled: Float[np.ndarray, " n"],
    step: Float[np.ndarray, " n"],
    *,
    up: float,
    down: float,
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return whether each command makes its rotor rise, from which speed, and what share is left.

    The share of the way when the next one comes. As `motor_model.two_way_lag`: Newton's iteration
    on a piecewise linear recursion.
    """
    rising = np.diff(settled, prepend=settled[:1]) >= 0.0
    left_rising = remaining = np.exp(step * (-1.0 / up))
    left_falling = np.exp(step * (-1.0 / down)) if up != down else left_rising
    if up != down:
        remaining = np.where(rising, left_rising, left_falling)
    speed = settled
    for _ in range(1 if up == down else MOST_ROUNDS):
        into = (1.0 - remaining) * settled
        begun = settled[None, recording.begins]
        speed = _follow_stretches(remaining, into[None], begun, recording.begins)[0]
        rises = settled > speed
        changed = np.flatnonzero(rises != rising)
        off = np.abs(settled[changed] - speed[changed])
        if not (off > SETTLED * np.abs(settled[changed])).any():
            break
        rising = rises
        if up != down:
            remaining = np.where(rising, left_rising, left_falling)
    return rising, remaining, speed


def _follow_stretches(
    remaining: Float[np.ndarray, " n"],
    into: Float[np.ndarray, "p n"],
    start: Float[np.ndarray, "p s"],
    begins: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, "p n"]:
    """Solve x_k+1 = a_k x_k + b_k, again from `start` where a stretch begins."""
    bands = np.ones((2, len(remaining)), order="F")
    bands[1, :-1] = np.where(begins[1:], 0.0, -remaining[:-1])
    right = np.empty(into.shape)
    right[:, 1:] = into[:, :-1]
    right[:, begins] = start
    return solve_recursion(bands, right.T).T
