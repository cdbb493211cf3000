"""Channels on clocks of their own, brought to one uniform clock without bridging a gap."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.arrivals import at_sampling_times
from rotorfit.flight.filters import kaiser_low_pass, thinned_sums
from rotorfit.flight.signals import true_runs
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import Channel, pieces

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jaxtyping import Bool, Float, Int

FEWEST_SAMPLES = 8
LARGEST_VALUE = 1e9
"""No sensor reads this, in any unit: a sample beyond it is damaged, and treated as lost."""

GAP_STEPS = 2.5
"""A step longer than this many median steps is a gap: a sample was lost."""

MOMENT = 0.01
"""A column without values for no longer is bridged by a line [s]. A line over 10 ms misses a crest
of 10 Hz by at most (2 pi 10 x 0.01)^2 / 8 = 5 %, in a few samples."""

ATTITUDE = "attitude"
"""Name of the channel whose columns are one quaternion."""

JITTER_STEPS = 0.05
"""Samples closer than this to the uniform clock are taken as they are, without interpolation."""

FASTER = 1.5
"""Samples of a channel for each of the clock, from which it is damped before samples are left out:
below, the damped band would begin above half its own rate."""

PASSED, STOPPED = 0.4, 0.6
"""Ends of the transition of that low-pass, as shares of the clock's rate. What it leaves between a
half and `STOPPED` folds to above `PASSED`, where no band of a fit is."""

FOLDED_DAMPING = 60.0
"""Least damping of what would fold further down [dB]: a thousandth is left."""


@frozen_dataclass
class UniformChannels:
    """Channels on one clock.

    - `sample_rate`: of the uniform clock [Hz].
    - `time`: in the log's own time [s]; steps over a gap are longer.
    - `values`: each channel by name. Rows where a channel has no data nearby are outside every
      stretch; do not use what stands there.
    - `stretches`: start and stop (exclusive) of the rows without a gap in any channel.
    - `rates`: True rate of each channel [Hz].
    - `gaps`: start and end of every gap in any channel [s], with the channel's name.
    """

    sample_rate: float
    time: Float[np.ndarray, " n"]
    values: Mapping[str, Float[np.ndarray, "n k"]]
    stretches: tuple[tuple[int, int], ...]
    rates: Mapping[str, float]
    gaps: tuple[tuple[float, float, str], ...]


def usable_samples(channel: Channel, name: str) -> Channel:
    """Select a channel's finite samples, in time order, each time once; raise if too few.

    A value that one column lost for a moment is taken from the line between its neighbours. Times
    of arrival are evened out.
    """
    values = np.asarray(channel.values, dtype=float)
    if name != ATTITUDE:  # one element of a quaternion means nothing without the others
        values = bridge_lost_values(np.asarray(channel.time, dtype=float), values)
        channel = dataclasses.replace(channel, values=values)
    keep = np.isfinite(channel.time)
    for column in values.T:
        keep &= np.abs(column) < LARGEST_VALUE  # false for NaN, too
    if not keep.all():
        channel = dataclasses.replace(channel, time=channel.time[keep], values=values[keep])
    t = np.asarray(channel.time, dtype=float)
    if len(t) < FEWEST_SAMPLES:
        raise FlightError(
            f"channel {name} has {len(t)} usable samples ({channel.source}); at least a few "
            "seconds of flight are needed: check that this channel was logged"
        )
    steps = np.diff(t)
    if float(steps.min()) < 0:
        i = int(np.flatnonzero(steps < 0)[0])
        raise FlightError(
            f"the clock of channel {name} runs backwards: {t[i]:.6f} s, then {t[i + 1]:.6f} s; "
            "cut the log there, or export it again with one clock"
        )
    fresh = np.concatenate([[True], steps > 0])
    if fresh.sum() < FEWEST_SAMPLES:
        raise FlightError(
            f"the clock of channel {name} does not advance from {t[0]:.6f} s: it has "
            f"{len(t)} samples but {int(fresh.sum())} different times; "
            "export the log with its time column"
        )
    t, values = (t, channel.values) if fresh.all() else (t[fresh], channel.values[fresh])
    t = at_sampling_times(t)
    return dataclasses.replace(channel, time=t, values=np.asarray(values, dtype=float))


def bridge_lost_values(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n k"]:
    """Interpolate values that a column lost for a moment, in rows that hold other columns.

    Rows that lost every column count as lost rows: the clock decides whether they are a gap.
    """
    lost = ~(np.abs(values) < LARGEST_VALUE)  # true for NaN, too
    rows = np.flatnonzero(np.isfinite(time) & ~lost.all(axis=1))
    if not lost[rows].any() or len(rows) < FEWEST_SAMPLES:
        return values
    t = time[rows]
    longest = max(GAP_STEPS * float(np.median(np.diff(t))), MOMENT) + 1e-9
    bridged = values.copy()
    for k in range(values.shape[1]):
        own = lost[rows, k]
        for a, b in true_runs(own):
            rising = a > 0 and b < len(rows) and (np.diff(t[a - 1 : b + 1]) > 0.0).all()
            if rising and t[b] - t[a - 1] <= longest:
                ends = [a - 1, b]
                bridged[rows[a:b], k] = np.interp(t[a:b], t[ends], values[rows[ends], k])
    return bridged


def uniform_channels(
    channels: Mapping[str, Channel | Callable[[], Channel]],
    *,
    clock: str,
    optional: tuple[str, ...] = (),
    held: tuple[str, ...] = (),
) -> UniformChannels:
    """Resample channels to the uniform clock of the first one, named `clock`.

    A callable makes its usable samples only when its turn comes, to save memory; rows without an
    `optional` channel are NaN. Channels that are faster than the clock pass a low-pass first; of
    those that are `held` between their samples, the middle of what the clock holds is taken.
    """
    names = sorted(channels, key=lambda name: name != clock)
    steps: dict[str, float] = {}
    spans: dict[str, tuple[float, float]] = {}
    values: dict[str, Float[np.ndarray, "n k"]] = {}
    gaps: list[tuple[float, float, str]] = []
    time, sample_rate, valid = np.zeros(0), 1.0, np.zeros(0, dtype=bool)
    for name in names:
        given = channels[name]
        channel = given if isinstance(given, Channel) else given()
        t = channel.time
        between = np.diff(t)
        steps[name] = float(np.median(between))
        spans[name] = (float(t[0]), float(t[-1]))
        longest = GAP_STEPS * steps[name]
        late = np.flatnonzero(between > longest)
        del between
        if name == clock:
            time, sample_rate = _uniform_clock(t, steps[name])
            valid = np.ones(len(time), dtype=bool)
        covered = _mark_covered(time, t, longest)
        values[name] = _read_off(
            time, channel, gaps=late, rates=(1.0 / steps[name], sample_rate), is_held=name in held
        )
        del channel, given
        if name in optional:
            values[name] = np.where(covered[:, None], values[name], np.nan)
            continue
        valid &= covered
        gaps += [(float(t[i]), float(t[i + 1]), name) for i in late]
    if not valid.any():
        listed = ", ".join(f"{name} {a:.3f} to {b:.3f} s" for name, (a, b) in spans.items())
        raise FlightError(
            f"the channels never overlap in time ({listed}): their clocks do not belong together; "
            "export the log again with one clock for all channels"
        )
    return UniformChannels(
        sample_rate=sample_rate,
        time=time,
        values=values,
        stretches=_split_at_jumps(valid, time, 1.5 / sample_rate),
        rates={name: 1.0 / step for name, step in steps.items()},
        gaps=tuple(sorted(gaps)),
    )


def _uniform_clock(
    t: Float[np.ndarray, " n"], step: float
) -> tuple[Float[np.ndarray, " m"], float]:
    """Make a clock that is uniform within every stretch between gaps, and its rate."""
    steps = np.diff(t)
    near = steps <= GAP_STEPS * step
    # A single lost sample is not a gap: its step counts as two.
    whole = np.maximum(np.round(steps[near] / step), 1.0)
    dt = float(steps[near].sum() / whole.sum())
    edges = [0, *(np.flatnonzero(~near) + 1).tolist(), len(t)]
    parts: list[Float[np.ndarray, " p"]] = []
    for a, b in pairwise(edges):
        if b - a > 1:
            # Never past the last sample, so that the clock cannot reach into the next stretch.
            parts.append(t[a] + dt * np.arange(int((t[b - 1] - t[a]) / dt + 0.1) + 1))
    return parts[0] if len(parts) == 1 else np.concatenate(parts), 1.0 / dt


def _read_off(
    time: Float[np.ndarray, " m"],
    channel: Channel,
    *,
    gaps: Int[np.ndarray, " g"],
    rates: tuple[float, float],
    is_held: bool,
) -> Float[np.ndarray, "m k"]:
    """Resample a channel to a clock, through a low-pass where it is faster than that clock.

    `gaps`: its last samples before a gap; `rates`: its own and the clock's [Hz].
    """
    t, (own, clock) = channel.time, rates
    if own <= FASTER * clock:
        return _resample_at(time, t, channel.values, 1.0 / clock)
    later = 0.5 * (1.0 / clock - 1.0 / own) if is_held else 0.0
    damped = _damp_faster_channel(channel.values, gaps, rates)
    return _resample_at(time + later, t, damped, 1.0 / own)


def _resample_at(
    time: Float[np.ndarray, " m"],
    t: Float[np.ndarray, " n"],
    x: Float[np.ndarray, "n k"],
    dt: float,
) -> Float[np.ndarray, "m k"]:
    """Interpolate samples at `time`; where a time was recorded, its sample is kept."""
    if len(t) == len(time) and float(np.abs(t - time).max()) < JITTER_STEPS * dt:
        return x
    values = np.empty((len(time), x.shape[1]))
    for rows in pieces(len(time)):
        values[rows] = _resample_piece(time[rows], t, x, JITTER_STEPS * dt)
    return values


def _damp_faster_channel(
    x: Float[np.ndarray, "n k"], gaps: Int[np.ndarray, " g"], rates: tuple[float, float]
) -> Float[np.ndarray, "n k"]:
    """Low-pass a channel without delay, so that a slower clock can be read off it.

    Quick motor commands would else fold into the band of the motion, where no motion answers them:
    inertia came out up to 17 % too large of a gyro at 50 Hz beside commands at 250 Hz.
    Each part between `gaps` is continued by point reflection. `gaps`, `rates`: as for `_read_off`.
    """
    own, clock = rates
    middle, transition = 0.5 * (PASSED + STOPPED) * clock, (STOPPED - PASSED) * clock
    weights = kaiser_low_pass(middle, transition, FOLDED_DAMPING, own)
    around = len(weights) // 2
    damped = np.array(x)
    for a, b in pairwise([0, *(gaps + 1).tolist(), len(x)]):
        if b - a > 1:
            ends = ((around, around), (0, 0))
            wide = np.pad(x[a:b], ends, mode="reflect", reflect_type="odd")
            damped[a:b] = thinned_sums(weights, wide, 1)
    return damped


def _resample_piece(
    time: Float[np.ndarray, " m"],
    t: Float[np.ndarray, " n"],
    x: Float[np.ndarray, "n k"],
    jitter: float,
) -> Float[np.ndarray, "m k"]:
    """Interpolate samples at `time` from those around it alone."""
    first = max(int(np.searchsorted(t, float(time[0]) - jitter)) - 1, 0)
    last = min(int(np.searchsorted(t, float(time[-1]), side="right")) + 1, len(t))
    t, x = t[first:last], x[first:last]
    nearest = np.clip(np.searchsorted(t, time - jitter), 0, len(t) - 1)
    there = np.flatnonzero(np.abs(t[nearest] - time) < jitter)
    exact = nearest[there]
    values = np.empty((len(time), x.shape[1]))
    for k in range(x.shape[1]):
        values[:, k] = np.interp(time, t, x[:, k])
        values[there, k] = x[exact, k]
    return values


def _mark_covered(
    time: Float[np.ndarray, " m"], t: Float[np.ndarray, " n"], longest: float
) -> Bool[np.ndarray, " m"]:
    """Mark times with recorded samples on both sides, no further apart than `longest`."""
    tolerance = 1e-9 + 1e-3 * longest
    covered = (time >= t[0] - tolerance) & (time <= t[-1] + tolerance)
    for rows in pieces(len(time)):
        now = time[rows]
        right = np.clip(np.searchsorted(t, now - tolerance), 1, len(t) - 1)
        left_time = np.where(now >= t[right] - tolerance, t[right], t[right - 1])
        covered[rows] &= t[right] - left_time <= longest
    return covered


def _split_at_jumps(
    valid: Bool[np.ndarray, " m"], time: Float[np.ndarray, " m"], jump: float
) -> tuple[tuple[int, int], ...]:
    """Split valid rows into runs, also where the clock itself jumps."""
    cuts = np.flatnonzero(np.diff(time) > jump) + 1
    stretches: list[tuple[int, int]] = []
    for start, stop in true_runs(valid):
        inner = cuts[(cuts > start) & (cuts < stop)].tolist()
        edges = [start, *inner, stop]
        stretches += list(pairwise(edges))
    return tuple(stretches)
