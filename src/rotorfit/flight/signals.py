r"""Sampled signals: despiking, saturation, differences, smoothing, splines.

Differences see a signal through a window: the second difference over three samples is
:math:`x_{n+1} - 2 x_n + x_{n-1} = h^2 \int (1 - |u|) \ddot x(t + uh) du`, the derivative through
two one-sample boxcars (a linear B-spline). An equation stays true if its other columns are averaged
alike, with Numerov's [1 10 1]/12 (what [1 4 1]/6 is for the first central difference); but where a
derivative is first turned by an attitude and then multiplied, the window no longer stands outside.
So it is undone instead: dividing the differences by those averages is what an interpolating spline
does, and a quintic one holds to the fourth order. All columns then belong to the same instant, and
what still acts on each of them is the one low-pass.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cache, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.flight.filters import (
    butterworth,
    filter_both_ways,
    first_order_recursion,
    kaiser_low_pass,
    slowest_pole,
    thinned_sums,
)
from rotorfit.flight.quintic_spline import quintic_spline
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import LONG, pieces

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float, Inexact, Int

MEDIAN_WIDTH = 7
SCALE_WIDTH = 51
SPIKE_THRESHOLD = 6.0
"""Robust standard deviations. At 4, one sample in a hundred of plain noise would be touched."""
SAME = 1e-9
"""Change of a sample to the next, over the largest value, that filters leave of nothing."""
SLACK = 1e-3
"""Tolerance of a count of samples from a whole number."""
SPIKE_RATIO = 10.0
"""Ratio of the 95th to the 80th percentile of deviations from which spikes, or a burst, make the
former: 1.3 to 8 in sound logs of eight sources."""
LOUD_RATIO = 4.0
"""Ratio of the 95th percentile of deviations to their median where they are loud: 2.9 of noise."""
SLOW_STEP = 0.02
"""Longest step of a channel in whose samples a quick turn lasts several [s]."""
SUDDEN = 1.5
"""Factor of the usual step, by which a spike comes or goes."""
AROUND = 6
"""Steps on either side that show the usual one: more than half of them are no spikes'."""


def hampel(
    values: Float[np.ndarray, "n k"], *, is_slow: bool = False
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Replace spikes by the median of their seven neighbours, and mark the samples.

    A sample is a spike if it is further from that median than six robust standard deviations.
    Those are taken over 51 samples (over seven, they would jump about and flag ordinary noise),
    and never much below the column's own nor below a thousandth of its range, so that quantised
    stretches are left alone. It comes or goes by a larger step than those beside it: the crest of
    a quick turn in a slow log is as far from the median, but does not.

    Where `is_slow`, a quick turn lasts a sample or two, and many far ones are taken for turns.

    References
    ----------
    Hampel, J. of the American Statistical Association 69, 1974.
    """
    clean = values
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < SCALE_WIDTH:
        return clean, spikes
    for column in range(values.shape[1]):
        x = values[:, column]
        deviation = np.abs(x - local_medians(x, MEDIAN_WIDTH, np.arange(len(x))))
        low, high = np.percentile(x, [1.0, 99.0])
        usual, large = np.percentile(deviation, [80.0, 95.0]).tolist()
        if not is_slow and 0.0 < SPIKE_RATIO * usual < large:
            # More than one spike in twenty samples, or a burst of motion after a long rest, which
            # is as loud for a while.
            loud = local_medians(deviation, SCALE_WIDTH, np.arange(0, len(x), SCALE_WIDTH // 2))
            large = max(SPIKE_RATIO * usual, LOUD_RATIO * float(np.percentile(loud, 95)))
        floor = max(0.4 * large, 1e-3 * float(high - low))
        # Few samples are far enough to need the median of the deviations around them.
        # 1.4826 median deviations are one standard deviation of normal noise.
        far = deviation > SPIKE_THRESHOLD * 1.4826 * floor
        rows = np.flatnonzero(far)
        local = local_medians(deviation, SCALE_WIDTH, rows)
        far[rows] = deviation[rows] > SPIKE_THRESHOLD * 1.4826 * local
        bad = _keep_sudden(x, far)
        if not bad.any():
            continue
        clean = values.copy() if clean is values else clean
        clean[bad, column] = local_medians(x, MEDIAN_WIDTH, np.flatnonzero(bad))
        spikes |= bad
    return clean, spikes


def _keep_sudden(x: Float[np.ndarray, " n"], far: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Keep of runs of samples those that come or go by a larger step than those beside them."""
    kept = far.copy()
    for a, b in true_runs(far):
        begin = max(a - AROUND - 1, 0)
        steps = np.abs(np.diff(x[begin : b + AROUND + 1]))
        # Step k is from sample k to the next.
        own = slice(max(a - 1 - begin, 0), b - begin)
        others = np.delete(steps, own)
        usual = float(np.median(others)) if len(others) else 0.0
        kept[a:b] = float(steps[own].max(initial=0.0)) > SUDDEN * usual
    return kept


def whole_samples(count: float) -> int:
    """Count the whole samples in a rate times a duration."""
    # A rate is known up to rounding, which grows with the time at which its clock begins: where the
    # count is a whole number, it must not decide about one sample more or less.
    return int(np.floor(count + SLACK))


def local_medians(
    values: Float[np.ndarray, " n"], width: int, rows: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Compute the median over an odd number of samples around each of some rows."""
    half = width // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, half, mode="edge"), width)
    found = np.empty(len(rows))
    for part in pieces(len(rows)):
        found[part] = np.partition(windows[rows[part]], half, axis=1)[:, half]
    return found


def running_mean(
    values: Inexact[np.ndarray, "..."],
    width: int,
    *,
    beyond: Literal["edge", "symmetric"] = "edge",
) -> Inexact[np.ndarray, "..."]:
    """Average over `width` samples around each; beyond the ends stand those, or a mirror image."""
    before = width // 2
    around = ((before, width - before - 1), *((0, 0) for _ in values.shape[1:]))
    sums = np.cumsum(np.pad(values, around, mode=beyond), axis=0)
    sums[width:] -= sums[:-width].copy()
    return np.asarray(sums[width - 1 :] / width)


def central_difference(
    values: Float[np.ndarray, "n k"], sample_rate: float
) -> Float[np.ndarray, "n k"]:
    """Difference over two samples, per second; one-sided at both ends."""
    result = np.empty_like(values)
    inner = result[1:-1]
    # The mean of the derivative over the two samples it spans. Averaging the other columns of an
    # equation with [1 4 1]/6 (Simpson's rule over the same span) keeps the equation true to fourth
    # order.
    np.subtract(values[2:], values[:-2], out=inner)
    inner *= 0.5 * sample_rate
    result[0] = (values[1] - values[0]) * sample_rate
    result[-1] = (values[-1] - values[-2]) * sample_rate
    return result


def smooth(
    values: Float[np.ndarray, "n k"], sample_rate: float, cutoff: float
) -> Float[np.ndarray, "n k"]:
    """Filter by a zero-phase second-order low-pass (for looking, not fitting)."""
    sos = _design_butterworth(sample_rate, cutoff)
    if len(values) < LONG:
        return filter_both_ways(sos, values)
    result = np.empty(values.shape)
    margin = fading_rows(sos)
    for rows in pieces(len(values)):
        first, last = max(rows.start - margin, 0), min(rows.stop + margin, len(values))
        wide = filter_both_ways(sos, values[first:last])
        result[rows] = wide[rows.start - first : rows.stop - first]
    return result


def fading_rows(sos: Float[np.ndarray, "s 6"]) -> int:
    """Count the rows in which a filter's response fades to rounding."""
    return int(np.ceil(np.log(1e-17) / np.log(slowest_pole(sos))))


@cache
def _design_butterworth(sample_rate: float, cutoff: float) -> Float[np.ndarray, "1 6"]:
    """Design a second-order Butterworth filter (cached: logs with many gaps ask for it often)."""
    # The bilinear transform has no cut-off at half the sample rate or above.
    return butterworth(2, min(cutoff, 0.45 * sample_rate), sample_rate)


def true_runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """Find start and stop (exclusive) of every run of true values."""
    padded = np.concatenate([[0], flags.astype(np.int8), [0]])
    change = np.diff(padded)
    starts = np.flatnonzero(change == 1)
    stops = np.flatnonzero(change == -1)
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


LEAST_LIMIT: Final = {"gyro": 4.0, "accel": 35.0}
"""Sensors end at 250 deg/s and 4 g at the least: values that stay the same below are no limit."""
LIMIT_RUN: Final = 3
STEEP: Final = 5.0
"""A step of so many times the smallest one is no rounded peak's."""


@frozen_dataclass
class Saturation:
    """The share of a flight that a sensor's end cut off, and the largest reading, in its unit."""

    share: float
    largest: float


def repeated_rows(
    values: Float[np.ndarray, "n k"], within: Sequence[tuple[int, int]]
) -> Bool[np.ndarray, " n"]:
    """Mark the rows of stretches that the next row repeats in all columns."""
    same: Bool[np.ndarray, " n"] = np.zeros(len(values), dtype=bool)
    for a, b in within:
        changes, largest = np.abs(np.diff(values[a:b], axis=0)), np.abs(values[a:b]).max(axis=0)
        same[a : b - 1] = (changes <= SAME * largest).all(axis=1)
    return same


def saturation(values: Float[np.ndarray, "n 3"], sensor: Literal["gyro", "accel"]) -> Saturation:
    """Measure how much of a sensor's readings in flight its range cut off."""
    # A slower sensor in a faster log stands at every value for some rows, at its largest, too.
    fresh = 1 + int(np.diff(values, axis=0).any(axis=1).sum())
    repeats = max(round(len(values) / fresh), 1)
    return Saturation(
        share=share_at_limit(values, LEAST_LIMIT[sensor], repeats=repeats),
        largest=max(float(values.max(initial=0.0)), -float(values.min(initial=0.0))),
    )


def share_at_limit(values: Float[np.ndarray, "n k"], least: float, *, repeats: int = 1) -> float:
    """Compute the share of samples at a sensor's limit, see `at_limit`."""
    stuck = at_limit(values, least, repeats=repeats)
    return float(stuck.mean()) if len(stuck) else 0.0


def at_limit(
    values: Float[np.ndarray, "n k"], least: float, *, repeats: int = 1
) -> Bool[np.ndarray, " n"]:
    """Mark samples that a sensor's range cut off; sizes below `least` are no limit."""
    stuck = np.zeros(len(values), dtype=bool)
    for column in values.T:
        steps = np.abs(np.diff(column))
        if not (steps > 0.0).any():
            continue
        steep = STEEP * float(steps[steps > 0.0].min())
        for extreme in (column.max(), column.min()):
            if abs(extreme) < least:
                continue
            for a, b in true_runs(np.abs(column - extreme) <= 1e-4 * abs(extreme)):
                neighbours = steps[[k for k in (a - 1, b - 1) if 0 <= k < len(steps)]]
                # Samples at a limit stand at one extreme three times in a row or more (times
                # `repeats`, if the recorder writes each sample so often), and come to it or leave
                # it steeply. A rounded peak stands still for a while, too, but a step of the
                # resolution above its neighbours.
                stuck[a:b] |= b - a >= LIMIT_RUN * repeats and bool((neighbours > steep).any())
    return stuck


ORDER = 4
"""Order of one pass of the Butterworth filter whose forward and backward pass `low_pass` equals."""


def low_pass(
    values: Float[np.ndarray, "n k"], sample_rate: float, cutoff: float
) -> Float[np.ndarray, "n k"]:
    """Filter by a zero-phase Butterworth low-pass, forward and backward in one."""
    n = len(values)
    pad = min(n - 1, whole_samples(4.0 * sample_rate / cutoff))
    wide = np.concatenate(
        [
            2.0 * values[:1] - values[pad:0:-1],
            values,
            2.0 * values[-1:] - values[-2 : -pad - 2 : -1],
        ]
    )
    # A straight line keeps the two ends of the periodic continuation together.
    size = len(wide)
    ramp = np.linspace(0.0, 1.0, size)[:, None] * (wide[-1] - wide[0])
    frequency = np.fft.rfftfreq(size, 1.0 / sample_rate)
    # The gain is 3 dB at the cut-off, whatever the sample rate: two channels on different clocks
    # see the same filter, which a recursive filter would not give them near half their rates.
    gain = (1.0 + (np.sqrt(2.0) - 1.0) * (frequency / cutoff) ** (2 * ORDER)) ** -1.0
    lines = np.fft.rfft(wide - ramp, axis=0) * gain[:, None]
    return (np.fft.irfft(lines, n=size, axis=0) + ramp)[pad : pad + n]


def spline_derivatives(
    values: Float[np.ndarray, "n k"], sample_rate: float
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Differentiate the quintic spline through the samples, once and twice.

    Near the ends they are not to be used: a few samples hold what the spline does not know.
    """
    rows = np.arange(len(values), dtype=float)
    _, slope, bend = quintic_spline(values, rows, derivatives=2)
    return slope * sample_rate, bend * sample_rate**2


def spline_at(
    values: Float[np.ndarray, "n k"],
    rows: Float[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """Interpolate values and derivatives per sample at fractional rows, held beyond the ends."""
    inside = np.clip(rows, 0.0, len(values) - 1.0)
    value, slope = quintic_spline(values, inside, derivatives=1)
    return value, slope


def smooth_motors(
    speed: Float[np.ndarray, "n N"], sample_rate: float, *, lag: float, delay: float
) -> tuple[Float[np.ndarray, "n N"], Float[np.ndarray, "n N"]]:
    """Delay and lag low-passed rotor speed without gaps; return speed and acceleration."""
    if lag > 0:
        speed = _lag_signal(speed, 1.0 / (sample_rate * lag))
    rows = np.arange(len(speed)) - delay * sample_rate
    value, slope = spline_at(speed, rows)
    return value, slope * sample_rate


def _lag_signal(speed: Float[np.ndarray, "n N"], step: float) -> Float[np.ndarray, "n N"]:
    """Filter a smooth signal by a lag; `step` is the sample period over the time constant."""
    # Exact for what is linear between samples, where a held command would come half a sample later.
    a = float(np.exp(-step))
    mean = (1.0 - a) / step
    forcing = (1.0 - mean) * speed
    forcing[1:] += (mean - a) * speed[:-1]
    forcing[0] = speed[0]  # settled before the first sample
    return first_order_recursion(forcing, a)


FLAT: Final = 4.0 / 3.0
"""Up to so many times the fastest line the filter is flat, and nothing folds back onto it."""
DAMPED: Final = 100.0
"""Damping of the signals that would fold back there [dB]; flat is as even."""


@frozen_dataclass
class Stretch:
    """Recorded rows without a gap in the clock, and which of them are kept.

    - `start`, `stop`: recorded rows, `stop` exclusive.
    - `step`: rows that one kept row stands for.
    - `first`: what the first kept row becomes. It is before `start`, so that the second recorded
      row is kept and has a neighbour; the last is behind `stop` likewise.
    - `borders`: recorded rows, the first to the last, between which parts are filtered apart.
    """

    start: int
    stop: int
    step: int
    first: int
    borders: tuple[int, ...]

    @property
    def kept(self) -> range:
        """Recorded rows that are kept."""
        return range(self.start + 1 - self.step, self.stop - 1 + self.step, self.step)

    def place(self, row: int) -> int:
        """Return the number of the first kept row from a recorded one on."""
        return self.first - (self.kept.start - row) // self.step

    @property
    def parts(self) -> list[tuple[slice, range]]:
        """Recorded rows that are filtered apart, and the kept rows that they make."""
        last = len(self.borders) - 1
        at = [self.place(border) - self.first for border in self.borders]
        at[0], at[last] = 0, len(self.kept)
        return [
            (slice(a, b), self.kept[i:j])
            for (a, b), (i, j) in zip(pairwise(self.borders), pairwise(at), strict=True)
        ]


def stretches(
    count: int, *, step: int, jumps: Sequence[int], borders: Sequence[int]
) -> tuple[Stretch, ...]:
    """Divide `count` recorded rows at the gaps (`jumps`), keeping every `step`-th row."""
    found: list[Stretch] = []
    first = 0
    for a, b in pairwise([0, *jumps, count]):
        own = sorted({a, b, *(row for row in borders if a < row < b)})
        found.append(Stretch(start=a, stop=b, step=step, first=first, borders=tuple(own)))
        first += len(found[-1].kept)
    return tuple(found)


def kept_rows(within: Sequence[Stretch], start: int, stop: int) -> tuple[int, int]:
    """Map recorded rows `start` to `stop` (exclusive), without a gap, to kept ones."""
    own = within[bisect_right([stretch.start for stretch in within], start) - 1]
    return own.place(start), own.place(stop)


@frozen_dataclass
class Thinning:
    """A filter, and the rows that are kept behind it.

    - `weights`: of consecutive samples.
    - `before`: how many of them are before the row.
    """

    within: tuple[Stretch, ...]
    weights: Float[np.ndarray, " t"]
    before: int

    @property
    def jumps(self) -> Int[np.ndarray, " j"]:
        """The first kept rows after a gap in the clock."""
        return np.array([stretch.first for stretch in self.within[1:]], dtype=np.int64)

    def __call__(self, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
        """Return the kept rows of filtered values, every part continued by point reflection."""
        step, last = self.within[0].step, len(self.weights) - 1
        ends = ((self.before + step, last - self.before + step), (0, 0))
        made: list[Float[np.ndarray, "_ k"]] = []
        for rows, kept in (part for stretch in self.within for part in stretch.parts):
            wide = np.pad(values[rows], ends, mode="reflect", reflect_type="odd")
            sums = thinned_sums(self.weights, wide[kept.start - rows.start + step :], step)
            made.append(sums[: len(kept)])
        return np.concatenate(made)


@lru_cache(maxsize=8)
def thinning_low_pass(sample_rate: float, step: int, top: float) -> Float[np.ndarray, " t"]:
    """Design an odd-length linear-phase filter that is flat for lines up to `top` [Hz]."""
    kept_rate = sample_rate / step
    width = kept_rate - 2.0 * FLAT * top
    return kaiser_low_pass(0.5 * kept_rate, width, DAMPED, sample_rate)
