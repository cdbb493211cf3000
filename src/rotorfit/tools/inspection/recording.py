"""Check how a log was recorded (true rates, clocks, limits), and advise settings for the next."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.clocks import GAP_STEPS, LARGEST_VALUE
from rotorfit.flight.signals import (
    LEAST_LIMIT,
    share_at_limit,
    true_runs,
)
from rotorfit.flight.spectral_density import power_density
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.firmware import Lack, Setting, advice_for
from rotorfit.logs.flight_log import CHANNELS, Channel

if TYPE_CHECKING:
    from collections.abc import Mapping, Set

    from jaxtyping import Bool, Float

    from rotorfit.flight.flight_data import FlightData

UNKNOWN: Final[Mapping[str, str]] = MappingProxyType({})


def settings_for(
    log_format: str, lacks: Set[Lack], metadata: Mapping[str, str] = UNKNOWN
) -> tuple[Setting, ...]:
    """Select the settings to change before the next flight, by what the log lacks and has set."""
    advice = advice_for(log_format, lacks, metadata)
    return () if advice is None else advice.settings


def settings_file(log_format: str, metadata: Mapping[str, str] = UNKNOWN) -> Path | None:
    """Return the file that holds the settings of a log's firmware; None if there is none."""
    advice = advice_for(log_format, frozenset(), metadata)
    return None if advice is None else Path(__file__).parent / "settings_files" / advice.file


FAST_ENOUGH: Final = 150.0
"""Rate below which the fast motion that shows inertia is lost [Hz]."""
FEWEST_TO_JUDGE: Final = 50
"""Samples, or intervals between new ones, below which no share of new samples is estimated."""
LONGEST_REPEAT: Final = 100
EVEN: Final = 0.35
"""Variance of the intervals between new samples, over that of chance, below which they are even."""
LEAST_REPEATED: Final = 0.8
FEW_REPEATS: Final = 0.03
"""Share of repeated samples that is not reported."""
MOST_RANDOM: Final = 0.1
"""Share of repeated samples that chance may explain where all are to count as repeats."""
LEAST_STRAIGHT: Final = 0.1
"""Share of samples that lie on the line through their neighbours, below which none is drawn."""
LONGEST_BEND: Final = 20
"""Samples in a row that bend, beyond which there are no lines between them."""
LOWEST_CUTOFF: Final = 40.0
"""A low-pass below this takes away what inertia shows in, or makes sensors differ [Hz]."""
BANDS: Final = ((10.0, 50.0), (50.0, 150.0), (150.0, 500.0))
"""Bands in which vibration is given [Hz]."""


@frozen_dataclass
class ChannelReport:
    """One channel of a log, measured.

    - `rate`, `true_rate`: of the recorded samples outside of gaps, and of new ones: without repeats
      and samples on straight lines [Hz].
    - `jitter`: deviation of the steps from their median, without gaps [s].
    - `gaps`, `longest_gap`: steps over 2.5 median ones, and the longest [s].
    - `at_limit`: share of the samples at the sensor's limit, see `share_at_limit`.
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


@frozen_dataclass
class Vibration:
    """Level of the accelerometer's noise in one band, rms over the three axes [m/s^2]."""

    low: float
    high: float
    level: float


def channel_report(name: str, channel: Channel) -> ChannelReport:
    """Measure one channel."""
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
    """Estimate the share of samples that are new, while anything changes at all."""
    if len(values) < FEWEST_TO_JUDGE or np.abs(values).max() > LARGEST_VALUE:
        return 1.0
    first = np.diff(values, axis=0)
    moves = (first != 0.0).any(axis=1)
    bent = _find_bends(first, np.abs(values).max(axis=0))
    # A recorder faster than its source repeats the last sample, or draws a straight line to the
    # next. What changes at uneven intervals in steps of the resolution is only coarse.
    return min(
        _share_at_even_intervals(moves), _share_of_corners(bent, moves), _share_fine(first, moves)
    )


def _share_fine(first: Float[np.ndarray, "n k"], moves: Bool[np.ndarray, " n"]) -> float:
    """Estimate the share of samples that change, where chance would hardly repeat any."""
    steps = np.abs(first)
    finest: Float[np.ndarray, " k"] = np.where(steps > 0, steps, np.inf).min(axis=0)
    usual = np.array(
        [float(np.median(column[column > 0])) if column.any() else 0.0 for column in steps.T]
    )
    alive = np.isfinite(finest)
    # A column of steps of m times its resolution repeats by chance once in about 1 + m samples, and
    # all of them together once in the product.
    random_repeats = float(np.prod(1.0 / (1.0 + usual[alive] / finest[alive])))
    intervals = np.diff(np.flatnonzero(moves))
    intervals = intervals[intervals <= LONGEST_REPEAT]
    if len(intervals) < FEWEST_TO_JUDGE:
        return 1.0
    share = 1.0 / float(intervals.mean())
    repeats = 1.0 - share
    return share if repeats > FEW_REPEATS and random_repeats < MOST_RANDOM * repeats else 1.0


def _share_of_corners(bent: Bool[np.ndarray, " b"], moves: Bool[np.ndarray, " m"]) -> float:
    """Estimate the share of samples at the corners of straight lines, where there are lines."""
    straight = ~bent & moves[1:] & moves[:-1]
    if straight.sum() < LEAST_STRAIGHT * max(int(moves.sum()), 1):
        return 1.0
    runs = true_runs(bent & moves[1:])
    if sum(b - a for a, b in runs if b - a > LONGEST_BEND) > 0.5 * moves.sum():
        return 1.0  # a line here or there, as of a motor that is run up, and motion of its own
    corners = np.zeros(len(moves), dtype=bool)
    for a, b in runs:
        # A corner between two samples bends the line at both: a run of bends holds a corner for
        # each two.
        corners[1 + a : 1 + b : 2] = True
    return _share_at_even_intervals(corners)


def _find_bends(
    first: Float[np.ndarray, "n k"], size: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, " m"]:
    """Find where a line through the samples bends; everywhere, where they are too coarse."""
    steps = np.abs(first)
    finest = np.where(steps > 0, steps, np.inf).min(axis=0)
    usual = np.median(steps, axis=0)
    # Samples up to `size` were written with seven to nine digits.
    rounding = np.maximum(1e-6 * usual, 2.5e-7 * size)
    fine = np.isfinite(finest) & (usual > 20.0 * finest) & (usual > 100.0 * rounding)
    if not fine.any():
        return np.ones(len(first) - 1, dtype=bool)
    change = np.abs(np.diff(first[:, fine], axis=0))
    bent: Bool[np.ndarray, " m"] = np.any(change > rounding[fine], axis=1)
    return bent


def _share_at_even_intervals(fresh: Bool[np.ndarray, " n"]) -> float:
    """Estimate the share of fresh samples where they come evenly, else 1."""
    intervals = np.diff(np.flatnonzero(fresh))
    intervals = intervals[intervals <= LONGEST_REPEAT]
    if len(intervals) < FEWEST_TO_JUDGE:
        return 1.0
    p = 1.0 / float(intervals.mean())
    # By chance the intervals would have the variance (1 - p) / p^2 of a geometric distribution.
    even = float(intervals.var()) < EVEN * (1.0 - p) / p**2
    return p if even and p < LEAST_REPEATED else 1.0


def lacks(
    reports: Mapping[str, ChannelReport], *, accel_cutoff: float | None = None
) -> frozenset[Lack]:
    """List what a log lacks for an identification; `accel_cutoff` is the logged low-pass [Hz]."""
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
    """Measure the vibration in flight, in the bands that the sample rate shows."""
    longest = max(data.segments, key=len, default=None)
    rows = min(1024, 0 if longest is None else len(longest))
    if longest is None or rows < 64:
        return ()
    force = data.specific_force[longest.start : longest.stop]
    f, density = power_density(force, data.sample_rate, rows)
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
