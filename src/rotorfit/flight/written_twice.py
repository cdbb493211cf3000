"""Find rows that a recorder wrote twice, each under a time of its own: the clock then runs long.

A recorder that repeats a record in place of one that it lost keeps its clock: the next change of a
rate is as large as two. One that writes a record twice and counts its rows as time stretches the
clock: the next change is as large as any other. Both repeat all six axes of the IMU at once, which
noise does not.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.flight.frozen_imu import fewest_repetitions, imu_axes
from rotorfit.flight.signals import repeated_rows, running_mean, true_runs, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.flight.clocks import UniformChannels

    Runs = Int[np.ndarray, "r 2"]

WRITTEN_TWICE: Final = "rows-written-twice"
"""Kind of the finding that rows are repeated under new times."""
BLOCK: Final = 0.5
"""Over which the axes' own repeats are counted [s]: rounded values repeat where nothing moves."""
LEAST_SHARE: Final = 0.01
"""Share of the rows from which inertia, with the clock squared, is wrong by 2 %, a third of a usual
interval."""
LEAST_UNCLEAR: Final = 0.03
"""The same where the flight does not show whether time passed: rounding made .01 at most."""
FEWEST_RUNS: Final = 20
"""Repeats below which no rhythm and no mean change is known."""
LEAST_IRREGULAR: Final = 0.3
"""Share of the distances between repeats that are further than a row from the median. By chance it
is .5 to .9 (repeats of 5 to 33 %); a slower source that is written at the recorder's rate repeats
in a rhythm (0 to .3), and its time passes."""
SPANS: Final = (2, 4, 8, 16)
"""Rows over which the slope on either side is taken: the longer, the less noise is in it, and the
slower the motion must be."""
HALF: Final = 0.5
"""Share of a row's time that separates a clock that counts repeats from one that is right."""
CERTAIN: Final = 2.0
"""Deviations by which the passed time must be off that."""
USABLE: Final = 5.0
"""Deviations of an ordinary row's change from nothing, under which noise hides the motion."""


class PassedTime(NamedTuple):
    """Share of the time of a repeated row in which the motion went on, and its deviation."""

    share: float
    std: float

    @property
    def none(self) -> bool:
        """Whether no time passed: the clock counts rows that are no samples."""
        return self.share + CERTAIN * self.std < HALF

    @property
    def all(self) -> bool:
        """Whether all of it passed: the clock is right."""
        return self.share - CERTAIN * self.std > HALF


@frozen_dataclass
class Repeats:
    """Rows of an IMU that repeat the row before.

    - `share`: of all rows in flight, above what rounding makes.
    - `irregular`: share of the distances between them that are off the median by over a row.
    - `passed`: how much of their time passed; None where noise hides it.
    """

    share: float
    irregular: float
    passed: PassedTime | None


def written_twice(
    uniform: UniformChannels, flights: Sequence[tuple[int, int]]
) -> Iterator[Finding]:
    """Find repeated rows that make the clock of a log run long, or may do so."""
    found = find_repeats(uniform, flights)
    if found is None or found.irregular < LEAST_IRREGULAR:
        return
    if found.passed is not None and found.passed.all:
        return
    certain = found.passed is not None and found.passed.none
    if not certain and found.share < LEAST_UNCLEAR:
        return
    percent = 100.0 * found.share
    effect = f"inertia comes out up to {100.0 * ((1.0 - found.share) ** -2 - 1.0):.0f} % too large"
    seen = (
        "and the motion goes on after them as if no time had passed: the recorder wrote them twice "
        f"and counted them as time, so that {effect}"
        if certain
        else "and the motion is too noisy to show whether time passed: if the recorder wrote them "
        f"twice and counted them as time, {effect}"
    )
    yield doubt(
        WRITTEN_TWICE,
        f"{percent:.2g} % of the rows repeat all of gyro and accelerometer under a new time, "
        f"{seen}; export the log again with the recorder's own times",
        doubtful_because=None if certain else "repeated rows may stretch the clock of the log",
        evidence=(Evidence(name="rows_written_twice", value=found.share, limit=LEAST_SHARE),),
    )


def find_repeats(uniform: UniformChannels, flights: Sequence[tuple[int, int]]) -> Repeats | None:
    """Find rows in flight whose whole IMU repeats the row before; None where they are too few."""
    gyro, rate = uniform.values["gyro"], uniform.sample_rate
    imu = imu_axes(uniform)
    same = repeated_rows(imu, flights)
    count = sum(stop - start for start, stop in flights)
    if same.sum() < max(LEAST_SHARE * count, FEWEST_RUNS):
        return None
    block = whole_samples(BLOCK * rate)
    chance = _mean_chance(imu, flights, block)
    share = (float(same.sum()) / count - chance) / max(1.0 - chance, LEAST_SHARE)
    longest = fewest_repetitions(rate)
    # A hung sensor is another fault; its seconds are left out.
    runs = np.array([run for run in true_runs(same) if run[1] - run[0] < longest], dtype=int)
    if share < LEAST_SHARE or len(runs) < FEWEST_RUNS:
        return None
    spacing: Int[np.ndarray, " s"] = np.diff(runs[:, 0])
    off_median: Float[np.ndarray, " s"] = np.abs(spacing - float(np.median(spacing)))
    return Repeats(
        share=share,
        irregular=int(np.count_nonzero(off_median > 1.0)) / len(spacing),
        passed=passed_time(gyro, same, runs, flights, block=block),
    )


def _mean_chance(
    imu: Float[np.ndarray, "n 6"], flights: Sequence[tuple[int, int]], block: int
) -> float:
    """Compute the share of rows in which all axes repeat by chance, by each axis' own repeats."""
    total, rows = 0.0, 0
    for start, stop in flights:
        still = np.diff(imu[start:stop], axis=0) == 0.0
        for a, b in pairwise([*range(0, len(still), block), len(still)]):
            shares: Float[np.ndarray, " k"] = np.mean(still[a:b], axis=0, dtype=float)
            total += (b - a) * float(shares.prod())
            rows += b - a
    return total / max(rows, 1)


def passed_time(
    rates: Float[np.ndarray, "n 3"],
    same: Bool[np.ndarray, " n"],
    runs: Runs,
    flights: Sequence[tuple[int, int]],
    *,
    block: int,
) -> PassedTime | None:
    """Estimate the share of the time of repeated rows in which the rates went on changing.

    The change over a repeat is held against the slopes before and after it, and against the change
    of ordinary rows. `same`: rows that the next one repeats; `runs`: first and last row of each
    repeat; `block`: rows that weigh alike. The slopes share no sample with the change, so that
    noise cancels.
    """
    weight = _calm_weights(rates, block)
    repeats = float((runs[:, 1] - runs[:, 0]).mean())
    usual = np.flatnonzero(~same & ~np.concatenate([[False], same[:-1]]))
    found: list[PassedTime] = []
    for span in SPANS:
        once = _change_by_slope(
            rates, weight, _inside(np.column_stack([usual, usual]), flights, span), span
        )
        over = _change_by_slope(rates, weight, _inside(runs, flights, span), span)
        if once is None or over is None or not once.share > USABLE * once.std:
            continue
        ratio = over.share / once.share
        std = float(np.hypot(over.std, ratio * once.std)) / once.share
        found.append(PassedTime((ratio - 1.0) / repeats, std / repeats))
    return min(found, key=lambda one: one.std, default=None)


def _inside(runs: Runs, flights: Sequence[tuple[int, int]], span: int) -> Int[np.ndarray, "k 2"]:
    """Select the runs whose slopes on both sides lie within one flight."""
    first, last = runs[:, 0] - 1 - span, runs[:, 1] + 2 + span
    kept = np.zeros(len(runs), dtype=bool)
    for start, stop in flights:
        kept |= (first >= start) & (last < stop)
    return runs[kept]


def _calm_weights(rates: Float[np.ndarray, "n 3"], block: int) -> Float[np.ndarray, "n 3"]:
    """Weigh rows by the changes around them, so that a blow does not outweigh a flight."""
    changes = np.diff(rates, axis=0, append=rates[-1:]) ** 2
    level = running_mean(changes, block, beyond="symmetric")
    return 1.0 / np.maximum(level, max(float(changes.mean()), np.finfo(float).tiny) * LEAST_SHARE)


def _change_by_slope(
    x: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, "n 3"], runs: Runs, span: int
) -> PassedTime | None:
    """Compute the mean change from the first row of a run to beyond its last, over the slope."""
    if len(runs) < FEWEST_RUNS:
        return None
    first, after = runs[:, 0], runs[:, 1] + 1
    before_slope = (x[first - 1] - x[first - 1 - span]) / span
    after_slope = (x[after + 1 + span] - x[after + 1]) / span
    change = x[after] - x[first]
    moved = (weight[first] * 0.5 * (before_slope + after_slope) * change).sum(axis=1)
    expected = (weight[first] * before_slope * after_slope).sum(axis=1)
    total = float(expected.sum())
    if not total > 0.0:
        return None
    ratio = float(moved.sum()) / total
    return PassedTime(ratio, float(np.linalg.norm(moved - ratio * expected)) / total)
