"""Rows of a joined table that copy a channel's last sample forward.

Tools that join messages of different clocks to one table (PlotJuggler, `merge_ordered`, `ffill` of
pandas) write a row for each message, and the last sample of every other channel into it. The copies
stand at times of their own, at which that channel measured nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

FEWEST: Final = 50
"""Samples that show how evenly a channel comes."""
LEAST_SHARE: Final = 0.05
"""Share of copied rows from which a table may be a joined one."""
UNEVEN: Final = 0.2
"""Spread of the rows' steps over their mean from which their clock is not a channel's."""
EVENER: Final = 0.5
"""Largest part of that spread which the steps of the samples alone have, where others were copied
between them."""
LONGEST: Final = 1.5
"""Steps after which the next row counts, although it repeats: the sensor itself stands still."""


def sampled_rows(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> Bool[np.ndarray, " n"] | None:
    """Mark the rows with samples of a channel's own; None where no other rows are between them."""
    if len(time) < FEWEST:
        return None
    fresh = np.concatenate([[True], (values[1:] != values[:-1]).any(axis=1)])
    if fresh.sum() < FEWEST or 1.0 - fresh.mean() < LEAST_SHARE:
        return None
    before, after = np.diff(time), np.diff(time[fresh])
    if spread_of(before) < UNEVEN or spread_of(after) > EVENER * spread_of(before):
        return None
    # Beyond the last sample other channels alone go on.
    row = np.arange(len(time))
    last = time[np.maximum.accumulate(np.where(fresh, row, 0))]
    stands = (time - last > LONGEST * float(np.median(after))) & (row < np.flatnonzero(fresh)[-1])
    return fresh | stands


def spread_of(steps: Float[np.ndarray, " n"]) -> float:
    """Return the spread of nine in ten steps over their mean."""
    low, high = np.quantile(steps, (0.05, 0.95))
    return float(high - low) / max(float(steps.mean()), np.finfo(float).tiny)
