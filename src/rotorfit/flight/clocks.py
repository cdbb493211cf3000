"""Channels on clocks of their own, brought to one uniform clock without bridging a gap."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.errors import FlightError
from rotorfit.flight.log import Channel
from rotorfit.flight.signals import true_runs

GAP_STEPS = 2.5
"""A step longer than this many median steps is a gap: a sample was lost."""

JITTER_STEPS = 0.05
"""Samples closer than this to the uniform clock are taken as they are, without interpolation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UniformChannels:
    """Channels on one clock.

    Attributes
    ----------
    sample_rate
        Of the uniform clock [Hz].
    time
        In the log's own time [s]; steps over a gap are longer.
    values
        Each channel by name; rows where a channel has no data nearby hold its last value and are
        outside every stretch.
    stretches
        Start and stop (exclusive) of the rows without a gap in any channel.
    rates
        True rate of each channel [Hz].
    gaps
        Start and end of every gap in any channel [s], with the channel's name.
    """

    sample_rate: float
    time: Float[np.ndarray, " n"]
    values: Mapping[str, Float[np.ndarray, "n k"]]
    stretches: tuple[tuple[int, int], ...]
    rates: Mapping[str, float]
    gaps: tuple[tuple[float, float, str], ...]


def uniform_channels(channels: Mapping[str, Channel], *, clock: str) -> UniformChannels:
    """Return channels on the uniform clock of the one named `clock`.

    Raises
    ------
    FlightError
        If a channel is too short, runs backwards, or they do not overlap in time.
    """
    clean = {name: _clean(channel, name) for name, channel in channels.items()}
    steps = {name: float(np.median(np.diff(t))) for name, (t, _) in clean.items()}
    time, sample_rate = _uniform_clock(clean[clock][0], steps[clock])
    valid = np.ones(len(time), dtype=bool)
    values: dict[str, Float[np.ndarray, "n k"]] = {}
    gaps: list[tuple[float, float, str]] = []
    for name, (t, x) in clean.items():
        values[name] = _resample(time, t, x, 1.0 / sample_rate)
        valid &= _covered(time, t, GAP_STEPS * steps[name])
        late = np.flatnonzero(np.diff(t) > GAP_STEPS * steps[name])
        gaps += [(float(t[i]), float(t[i + 1]), name) for i in late]
    if not valid.any():
        raise FlightError(
            f"the channels {', '.join(channels)} never overlap in time; "
            "the log's clocks do not belong together"
        )
    return UniformChannels(
        sample_rate=sample_rate,
        time=time,
        values=values,
        stretches=_split_at_jumps(valid, time, 1.5 / sample_rate),
        rates={name: 1.0 / step for name, step in steps.items()},
        gaps=tuple(sorted(gaps)),
    )


def _clean(channel: Channel, name: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
    """Return a channel's samples that are numbers, in time order, each time once."""
    keep = np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time)
    t, x = channel.time[keep], channel.values[keep]
    if len(t) < 8:
        raise FlightError(
            f"channel {name} has {len(t)} usable samples ({channel.source}); at least a few "
            "seconds of flight are needed"
        )
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        i = int(back[0])
        raise FlightError(
            f"the clock of channel {name} runs backwards: {t[i]:.6f} s, then {t[i + 1]:.6f} s; "
            "cut the log there, or export it again with one clock"
        )
    fresh = np.concatenate([[True], np.diff(t) > 0])
    if fresh.sum() < 8:
        raise FlightError(f"the clock of channel {name} stands still at {t[0]:.6f} s")
    return t[fresh], x[fresh]


def _uniform_clock(
    t: Float[np.ndarray, " n"], step: float
) -> tuple[Float[np.ndarray, " m"], float]:
    """Return a clock that is uniform within every stretch between gaps, and its rate."""
    breaks = np.flatnonzero(np.diff(t) > GAP_STEPS * step) + 1
    edges = [0, *breaks.tolist(), len(t)]
    spans = [(a, b) for a, b in pairwise(edges) if b - a > 1]
    # Lost single samples are not gaps, so that durations count whole steps, not samples.
    durations = [float(t[b - 1] - t[a]) for a, b in spans]
    counts = [max(round(duration / step), 1) for duration in durations]
    dt = sum(durations) / sum(counts)
    parts = [t[a] + dt * np.arange(count + 1) for (a, _), count in zip(spans, counts, strict=True)]
    return np.concatenate(parts), 1.0 / dt


def _resample(
    time: Float[np.ndarray, " m"],
    t: Float[np.ndarray, " n"],
    x: Float[np.ndarray, "n k"],
    dt: float,
) -> Float[np.ndarray, "m k"]:
    """Return samples at `time`: the recorded ones where they are there, else linear between."""
    if len(t) == len(time) and float(np.abs(t - time).max()) < JITTER_STEPS * dt:
        return x
    values = np.empty((len(time), x.shape[1]))
    for k in range(x.shape[1]):
        values[:, k] = np.interp(time, t, x[:, k])
    return values


def _covered(
    time: Float[np.ndarray, " m"], t: Float[np.ndarray, " n"], longest: float
) -> Bool[np.ndarray, " m"]:
    """Return which times have recorded samples on both sides, no further apart than `longest`."""
    tolerance = 1e-9 + 1e-3 * longest
    right = np.searchsorted(t, time - tolerance)
    inside = (time >= t[0] - tolerance) & (time <= t[-1] + tolerance)
    right = np.clip(right, 1, len(t) - 1)
    left_time = np.where(time >= t[right] - tolerance, t[right], t[right - 1])
    return inside & (t[right] - left_time <= longest)


def _split_at_jumps(
    valid: Bool[np.ndarray, " m"], time: Float[np.ndarray, " m"], jump: float
) -> tuple[tuple[int, int], ...]:
    """Return the runs of valid rows, cut where the clock itself jumps."""
    cuts = np.flatnonzero(np.diff(time) > jump) + 1
    stretches: list[tuple[int, int]] = []
    for start, stop in true_runs(valid):
        inner = cuts[(cuts > start) & (cuts < stop)].tolist()
        edges = [start, *inner, stop]
        stretches += list(pairwise(edges))
    return tuple(stretches)
