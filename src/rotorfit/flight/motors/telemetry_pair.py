"""Commands and measured speeds of rotors on one clock, and where the motors turn."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.motors.coarse_speeds import speed_step
from rotorfit.flight.signals import true_runs, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

    from rotorfit.logs.flight_log import Channel

    _Columns = list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]

FASTEST: Final = 100.0
"""Rate of the common clock at most [Hz]."""
SLOWEST: Final = 2.0
"""Slower telemetry shows nothing of the motion [Hz]."""
FEWEST: Final = 20
"""Samples of each, below which nothing is said."""
MOST_HOLES: Final = 10.0
"""Length of the common clock over the samples: a longer one is no clock."""
LEAST_SECONDS: Final = 3.0
"""Least time of turning motors, below which nothing is reported [s]."""
LONGEST_CONSTANT: Final = 1.0
"""A speed that stays the same for so long while its command moves is stuck [s]."""
TURNING: Final = 0.3
"""Share of the largest command above which motors count as turning."""
EDGE: Final = 0.5
"""Left out after motors start and before they stop: the band-pass rings there [s]."""


STRAY: Final = 0.5
"""Jump of a command for a single sample, over its usual value, from which the sample is stray."""
STRAY_JUMPS: Final = 10.0
"""The same over the usual jumps of that command."""
FEWEST_STRAYS: Final = 1e-3
"""Share of stray commands up to which they are left alone: eleven sound logs have up to .00006."""
USUAL_PERCENTILE: Final = 90.0
"""Share of the samples whose jumps count as usual [%]: strays are rarer."""


@frozen_dataclass
class TelemetryPair:
    """Commands and speeds on one clock; the rows that count, and which columns are alive.

    `speed_step`: in which the speeds come [rad/s], 0 if they lie on no grid.
    """

    rate: float
    command: Float[np.ndarray, "n N"]
    speed: Float[np.ndarray, "n N"]
    used: Bool[np.ndarray, " n"]
    live: Int[np.ndarray, " k"]
    speed_step: float = 0.0


def pair_channels(command: Channel, speed: Channel) -> TelemetryPair | None:
    """Resample both to one clock, where they overlap; a column that ends early is held."""
    columns = [finite_columns(command), finite_columns(speed)]
    if not all(columns):
        return None
    clocks = [max((t for t, _ in one), key=len) for one in columns]
    if min(map(len, clocks)) < FEWEST:
        return None
    begin = max(min(t[0] for t, _ in one if len(t)) for one in columns)
    end = min(max(t[-1] for t, _ in one if len(t)) for one in columns)
    rate = min(FASTEST, *(1.0 / float(np.median(np.diff(t))) for t in clocks))
    span = (end - begin) * rate
    if not LEAST_SECONDS * rate < span < MOST_HOLES * max(map(len, clocks)) or rate < SLOWEST:
        return None
    time = begin + np.arange(whole_samples(span)) / rate
    # Commands may jump from sample to sample: taken singly, the jumps would look like slow motion.
    commands = _average_columns(time, columns[0], rate)
    speeds = _interpolate_columns(time, [(t, despike_values(x)) for t, x in columns[1]])
    used = _mark_turning(commands, rate) & ~np.any([_in_gap(time, t, rate) for t in clocks], axis=0)
    # Means of a constant differ by rounding.
    varies = [used.any() and np.ptp(x[used], axis=0) > 1e-9 for x in (commands, speeds)]
    live = np.flatnonzero(np.logical_and(*varies))
    return TelemetryPair(
        rate=rate,
        command=commands,
        speed=speeds,
        used=used,
        live=live,
        speed_step=speed_step(speed.values),
    )


def _interpolate_columns(
    time: Float[np.ndarray, " m"], columns: _Columns
) -> Float[np.ndarray, "m N"]:
    """Interpolate columns at other times, ends held; NaN if there is no sample."""
    values = np.full((len(time), len(columns)), np.nan)
    for k, (t, x) in enumerate(columns):
        if len(t) > 1:
            values[:, k] = np.interp(time, t, x)
    return values


def _average_columns(
    time: Float[np.ndarray, " m"], columns: _Columns, rate: float
) -> Float[np.ndarray, "m N"]:
    """Average columns over the time from one row to the next; NaN if there is no sample."""
    values = np.full((len(time), len(columns)), np.nan)
    half = 0.5 / rate
    for k, (t, x) in enumerate(columns):
        if len(t) > 1:
            area = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])
            first, last = np.clip(time - half, t[0], t[-1]), np.clip(time + half, t[0], t[-1])
            over = np.where(last > first, last - first, 1.0)
            mean = (np.interp(last, t, area) - np.interp(first, t, area)) / over
            held = np.interp(time, t, x)
            values[:, k] = np.where(last > first, mean, held)
    return values


def despike_values(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Replace a value that is above or below both neighbours by the middle one of the three."""
    if len(values) < 3:
        return values
    middle = np.median(np.lib.stride_tricks.sliding_window_view(values, 3), axis=1)
    return np.concatenate([values[:1], middle, values[-1:]])


def stray_values(values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Mark single values that are off both neighbours by half of what is usual, or more.

    A recorder or converter that loses a value writes 0. Commands that jump all the time, as the
    noise of a gyro makes them, are none: their usual jumps are as large. A few of a whole log are
    commands of quick manoeuvres.
    """
    found = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    x = values[known]
    turning = x[x > TURNING * float(np.max(x, initial=0.0))]
    if len(x) < FEWEST or not len(turning):
        return found
    off = np.abs(x - despike_values(x))
    usual = float(np.percentile(off, USUAL_PERCENTILE))
    stray = off > max(STRAY * float(np.median(turning)), STRAY_JUMPS * usual)
    if float(stray.mean()) > FEWEST_STRAYS:
        found[known] = stray
    return found


def mark_stray_commands(command: Channel) -> Bool[np.ndarray, "n N"]:
    """Mark the stray values of every command."""
    strays = np.zeros(command.values.shape, dtype=bool)
    for k, column in enumerate(command.values.T):
        strays[:, k] = stray_values(column)
    return strays


def mend_stray_commands(command: Channel, strays: Bool[np.ndarray, "n N"] | None = None) -> Channel:
    """Replace stray values of commands by the line between their neighbours.

    `strays`: from `mark_stray_commands`, where they are known.
    """
    strays = mark_stray_commands(command) if strays is None else strays
    if not strays.any():
        return command
    rows = np.arange(len(command.values))
    mended = command.values.copy()
    for k in np.flatnonzero(strays.any(axis=0)).tolist():
        kept = ~strays[:, k]
        mended[~kept, k] = np.interp(rows[~kept], rows[kept], mended[kept, k])
    return replace(command, values=mended)


def finite_columns(channel: Channel) -> _Columns:
    """Select times and finite values of each column, in the order of time."""
    found: _Columns = []
    for values in channel.values.T:
        known = np.isfinite(channel.time) & (np.abs(channel.time) < 1e12)
        known &= np.abs(values) < 1e9
        t, first = np.unique(channel.time[known], return_index=True)
        found.append((t, values[known][first]))
    return found


def _in_gap(
    time: Float[np.ndarray, " m"], t: Float[np.ndarray, " n"], rate: float
) -> Bool[np.ndarray, " m"]:
    """Mark times whose neighbouring samples are further apart than a moment."""
    after = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    far: Bool[np.ndarray, " m"] = t[after] - t[after - 1] > max(0.2, 3.0 / rate)
    return far


def _mark_turning(commands: Float[np.ndarray, "n N"], rate: float) -> Bool[np.ndarray, " n"]:
    """Mark where the motors turn, without the moments of starting and stopping."""
    known = commands[:, np.isfinite(commands).all(axis=0)]
    turning = np.zeros(len(commands), dtype=bool)
    if known.shape[1] == 0:
        return turning
    level = known.mean(axis=1)
    edge = whole_samples(EDGE * rate)
    for a, b in true_runs(level > TURNING * float(np.percentile(level, 95))):
        turning[a + edge : max(b - edge, a + edge)] = True
    return turning


def advance_samples(values: Float[np.ndarray, "n k"], shift: int) -> Float[np.ndarray, "n k"]:
    """Advance the values by `shift` samples; the last ones are held."""
    rows = np.clip(np.arange(len(values)) + shift, 0, len(values) - 1)
    return values[rows]
