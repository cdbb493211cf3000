"""Long series made small for display: at most two samples, the extremes, per column of time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float, Int

MOST_COLUMNS = 8192
"""Columns that are kept: two numbers each, more than any screen shows at once."""


@frozen_dataclass
class Series:
    """Curves by name over one rising axis, in general time since the log's first sample [s].

    - `gap`: a longer step than this is a cut, over which no line is drawn.
    """

    time: Float[np.ndarray, " n"]
    values: dict[str, Float[np.ndarray, " n"]]
    gap: float


def thinned(series: Series, *, columns: int = MOST_COLUMNS) -> Series:
    """Reduce a series to at most two samples per column of time: the extremes.

    All values keep one time axis: the first sample of a column and its middle.
    """
    if len(series.time) <= 2 * columns:
        return series
    width = float(series.time[-1] - series.time[0]) / columns
    # Shorter cuts are not seen, and would each begin a column.
    series = replace(series, gap=max(series.gap, 2.0 * width))
    starts = column_starts(series, columns)
    middle = middles(starts, len(series.time))
    time = np.column_stack([series.time[starts], series.time[middle]]).ravel()
    values = {key: extremes(v, starts).ravel() for key, v in series.values.items()}
    return Series(time=time, values=values, gap=series.gap)


def column_starts(series: Series, columns: int) -> Int[np.ndarray, " k"]:
    """Find the samples at which columns of equal time begin; a cut begins one too."""
    time = series.time
    span = max(float(time[-1] - time[0]), 1e-9)
    column = np.minimum(((time - time[0]) / span * columns).astype(int), columns - 1)
    new = (np.diff(column) > 0) | (np.diff(time) > series.gap)
    return np.concatenate([[0], np.flatnonzero(new) + 1])


def middles(starts: Int[np.ndarray, " k"], count: int) -> Int[np.ndarray, " k"]:
    """Find the sample in the middle of each column."""
    return (starts + np.append(starts[1:], count)) // 2


def extremes(
    values: Float[np.ndarray, " n"], starts: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k 2"]:
    """Find least and greatest of each column, in the order that follows its slope."""
    low = np.minimum.reduceat(values, starts)
    high = np.maximum.reduceat(values, starts)
    last = np.append(starts[1:], len(values)) - 1
    falls = values[last] < values[starts]
    return np.where(falls[:, None], np.stack([high, low], 1), np.stack([low, high], 1))
