"""Every so many samples of a log, behind a low-pass, for who looks at slow lines alone."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy import signal

FLAT: Final = 4.0 / 3.0
"""Up to so many times the fastest line the filter is flat, and nothing folds back onto it."""
DAMPED: Final = 100.0
"""By how much that is damped which would fold back there [dB]; flat is as even."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Recorded rows without a gap in the clock, and which of them are kept.

    Attributes
    ----------
    start, stop
        Recorded rows, `stop` exclusive.
    step
        Rows that one kept row stands for.
    first
        What the first kept row becomes. It is before `start`, so that the second recorded row is
        kept and has a neighbour; the last is behind `stop` likewise.
    borders
        Recorded rows, the first to the last, between which parts are filtered apart.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Thinning:
    """A filter, and the rows that are kept behind it.

    Attributes
    ----------
    within
        The stretches, with the rows that are kept.
    weights
        Of consecutive samples.
    before
        How many of them are before the row.
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
        # With as many zeros that the first sum over samples alone is one of those that are made.
        turned = np.concatenate([np.zeros(-last % step), self.weights[::-1]])
        skipped = (len(turned) - 1) // step
        made: list[Float[np.ndarray, "_ k"]] = []
        for rows, kept in (part for stretch in self.within for part in stretch.parts):
            wide = np.pad(values[rows], ends, mode="reflect", reflect_type="odd")
            sums = signal.upfirdn(turned, wide[kept.start - rows.start + step :], down=step, axis=0)
            made.append(sums[skipped : skipped + len(kept)])
        return np.concatenate(made)


@lru_cache(maxsize=8)
def low_pass(sample_rate: float, step: int, top: float) -> Float[np.ndarray, " t"]:
    """Design an odd-length linear-phase filter that is flat for lines up to `top` [Hz]."""
    kept_rate = sample_rate / step
    width = kept_rate - 2.0 * FLAT * top
    count, beta = signal.kaiserord(DAMPED, width / (0.5 * sample_rate))
    return signal.firwin(count | 1, 0.5 * kept_rate, window=("kaiser", beta), fs=sample_rate)
