"""What is to be said of a log as it was recorded: true rates, clocks, limits, vibration."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import signal

from rotorfit.logs.firmware import Lack
from rotorfit.logs.flight_log import CHANNELS, Channel
from rotorfit.preprocessing.clocks import GAP_STEPS, LARGEST_VALUE
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.signals import LEAST_LIMIT, share_at_limit, true_runs

FAST_ENOUGH: Final = 150.0
"""Below this the fast motion that inertia shows in is lost [Hz]."""
FEWEST: Final = 50
LONGEST_REPEAT: Final = 100
EVEN: Final = 0.35
"""Variance of the intervals between new samples, over that of chance, below which they are even."""
LEAST_REPEATED: Final = 0.8
FEW_REPEATS: Final = 0.03
"""Share of repeated samples that is not worth words."""
MOST_BY_CHANCE: Final = 0.1
"""Of repeated samples, that chance may explain where all are to count as repeats."""
LEAST_STRAIGHT: Final = 0.1
"""Share of samples that lie on the line through their neighbours, below which none is drawn."""
LONGEST_BEND: Final = 20
"""Samples in a row that bend, beyond which there are no lines between them."""
LOWEST_CUTOFF: Final = 40.0
"""A low-pass below this takes away what inertia shows in, or makes sensors differ [Hz]."""
BANDS: Final = ((10.0, 50.0), (50.0, 150.0), (150.0, 500.0))
"""In which vibration is given [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReport:
    """One channel of a log, measured.

    Attributes
    ----------
    rate
        Of the recorded samples, counted over the time outside of gaps [Hz].
    true_rate
        Of the samples that bring something new [Hz]: repeats and straight lines are left out.
    jitter
        Deviation of the steps from their median, without gaps [s].
    gaps, longest_gap
        Steps over 2.5 median ones, and the longest [s].
    at_limit
        Share of the samples that a sensor's end cut off, see `share_at_limit`.
    """

    name: str
    columns: int
    unit: str
    samples: int
    missing: int
    rate: float
    true_rate: float
    jitter: float
    gaps: int
    longest_gap: float
    at_limit: float
    resolution: float | None
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
    """Level of the accelerometer's noise in one band, rms over the three axes [m/s^2]."""

    low: float
    high: float
    level: float


def channel_report(name: str, channel: Channel) -> ChannelReport:
    """Return one channel, measured."""
    finite = np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time)
    t, x = channel.time[finite], channel.values[finite]
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else 0.0
    late = steps > GAP_STEPS * step
    gaps = steps[late] if step > 0 else steps[:0]
    # Not by the median step: where some samples are late or lost, fewer come than that says.
    rate = (len(steps) - len(gaps)) / float(steps[~late].sum()) if step > 0 else 0.0
    share = new_share(x)
    return ChannelReport(
        name=name,
        columns=channel.values.shape[1],
        unit=CHANNELS[name][1],
        samples=int(finite.sum()),
        missing=int((~finite).sum()),
        rate=rate,
        true_rate=rate * share,
        jitter=float(steps[~late].std()) if step > 0 else 0.0,
        gaps=len(gaps),
        longest_gap=float(gaps.max()) if len(gaps) else 0.0,
        at_limit=(
            share_at_limit(x, LEAST_LIMIT[name], repeats=round(1.0 / share))
            if name in LEAST_LIMIT
            else 0.0
        ),
        resolution=channel.resolution,
        source=channel.source,
    )


def new_share(values: Float[np.ndarray, "n k"]) -> float:
    """Return the share of samples that bring something new, while anything changes at all.

    A recorder faster than its source repeats the last sample, or draws a straight line to the
    next. What changes at uneven intervals in steps of the resolution is only coarse; and where a
    quantity stands still for long (motors off), nothing can be told.
    """
    if len(values) < FEWEST or np.abs(values).max() > LARGEST_VALUE:
        return 1.0
    first = np.diff(values, axis=0)
    moves = (first != 0.0).any(axis=1)
    bent = _bent(first, np.abs(values).max(axis=0))
    return min(
        _share_at_even_intervals(moves), _share_of_corners(bent, moves), _share_fine(first, moves)
    )


def _share_fine(first: Float[np.ndarray, "n k"], moves: Bool[np.ndarray, " n"]) -> float:
    """Return the share of samples that change, where chance would hardly repeat any.

    A column of steps of m times its resolution repeats by chance once in about 1 + m samples, and
    all of them together once in the product.
    """
    steps = np.abs(first)
    finest: Float[np.ndarray, " k"] = np.where(steps > 0, steps, np.inf).min(axis=0)
    usual = np.array(
        [float(np.median(column[column > 0])) if column.any() else 0.0 for column in steps.T]
    )
    alive = np.isfinite(finest)
    by_chance = float(np.prod(1.0 / (1.0 + usual[alive] / finest[alive])))
    intervals = np.diff(np.flatnonzero(moves))
    intervals = intervals[intervals <= LONGEST_REPEAT]
    if len(intervals) < FEWEST:
        return 1.0
    share = 1.0 / float(intervals.mean())
    repeats = 1.0 - share
    return share if repeats > FEW_REPEATS and by_chance < MOST_BY_CHANCE * repeats else 1.0


def _share_of_corners(bent: Bool[np.ndarray, " b"], moves: Bool[np.ndarray, " m"]) -> float:
    """Return the share of samples at the corners of straight lines, where there are lines.

    A corner between two samples bends the line at both: a run of bends holds a corner for each two.
    """
    straight = ~bent & moves[1:] & moves[:-1]
    if straight.sum() < LEAST_STRAIGHT * max(int(moves.sum()), 1):
        return 1.0
    runs = true_runs(bent & moves[1:])
    if sum(b - a for a, b in runs if b - a > LONGEST_BEND) > 0.5 * moves.sum():
        return 1.0  # a line here or there, as of a motor that is run up, and motion of its own
    corners = np.zeros(len(moves), dtype=bool)
    for a, b in runs:
        corners[1 + a : 1 + b : 2] = True
    return _share_at_even_intervals(corners)


def _bent(first: Float[np.ndarray, "n k"], size: Float[np.ndarray, " k"]) -> Bool[np.ndarray, " m"]:
    """Return where a line through the samples bends; everywhere, where they are too coarse.

    Samples up to `size` were written with seven to nine digits.
    """
    steps = np.abs(first)
    finest = np.where(steps > 0, steps, np.inf).min(axis=0)
    usual = np.median(steps, axis=0)
    rounding = np.maximum(1e-6 * usual, 2.5e-7 * size)
    fine = np.isfinite(finest) & (usual > 20.0 * finest) & (usual > 100.0 * rounding)
    if not fine.any():
        return np.ones(len(first) - 1, dtype=bool)
    change = np.abs(np.diff(first[:, fine], axis=0))
    bent: Bool[np.ndarray, " m"] = np.any(change > rounding[fine], axis=1)
    return bent


def _share_at_even_intervals(fresh: Bool[np.ndarray, " n"]) -> float:
    """Return the share of fresh samples where they come evenly, else 1.

    By chance the intervals would have the variance (1 - p) / p^2 of a geometric distribution.
    """
    intervals = np.diff(np.flatnonzero(fresh))
    intervals = intervals[intervals <= LONGEST_REPEAT]
    if len(intervals) < FEWEST:
        return 1.0
    p = 1.0 / float(intervals.mean())
    even = float(intervals.var()) < EVEN * (1.0 - p) / p**2
    return p if even and p < LEAST_REPEATED else 1.0


def lacks(
    reports: Mapping[str, ChannelReport], *, accel_cutoff: float | None = None
) -> frozenset[Lack]:
    """Return what a log lacks for an identification.

    Parameters
    ----------
    reports
        Of its channels, by name.
    accel_cutoff
        Low-pass of the accelerometer [Hz], where the log names it.
    """
    found: set[Lack] = set()
    if accel_cutoff is not None and accel_cutoff < LOWEST_CUTOFF:
        found.add("filtered accel")
    if "gyro" not in reports:
        found.add("no gyro")
    elif reports["gyro"].true_rate < FAST_ENOUGH:
        found.add("slow gyro")
    if "accel" not in reports:
        found.add("no accel")
    elif reports["accel"].true_rate < FAST_ENOUGH:
        found.add("slow accel")
    if "rotor_speed" not in reports:
        found.add("no rotor speed")
    if "battery" not in reports:
        found.add("no battery")
    motors = reports.get("rotor_speed") or reports.get("command")
    if motors is None:
        found.add("no motors")
    elif motors.true_rate < 0.5 * FAST_ENOUGH:
        found.add("slow motors")
    return frozenset(found)


def vibration(data: FlightData) -> tuple[Vibration, ...]:
    """Return the level of vibration in flight, in the bands that the sample rate shows."""
    longest = max(data.segments, key=len, default=None)
    rows = min(1024, 0 if longest is None else len(longest))
    if longest is None or rows < 64:
        return ()
    force = data.specific_force[longest.start : longest.stop]
    f, density = signal.welch(force, fs=data.sample_rate, nperseg=rows, axis=0)
    total = density.sum(axis=1) * (f[1] - f[0])
    nyquist = 0.5 * data.sample_rate
    return tuple(
        Vibration(
            low=low,
            high=min(high, nyquist),
            level=float(np.sqrt(total[(f >= low) & (f < high)].sum())),
        )
        for low, high in BANDS
        if low < 0.9 * nyquist
    )
