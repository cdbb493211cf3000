"""By how much two groups differ, where the scatter inside all groups is one.

References
----------
Paule and Mandel, J. of Research of the National Bureau of Standards 87, 1982 (the scatter beside
stated variances).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

LEAST_FREEDOM: Final = 4
"""Values beyond one a group, without which their scatter is not known."""
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Contrasts:
    """How far the first group of each pair is from the second; NaN where the scatter is not known.

    Attributes
    ----------
    difference, low, high
        With its 95 % interval.
    p
        Chance of a difference as large between groups that are alike.
    """

    difference: Float[np.ndarray, " k"]
    low: Float[np.ndarray, " k"]
    high: Float[np.ndarray, " k"]
    p: Float[np.ndarray, " k"]


def contrasts(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    pairs: Sequence[tuple[int, int]],
) -> Contrasts:
    """Return how pairs of groups differ.

    Parameters
    ----------
    values, variance
        What is measured, and what each value states of itself; they scatter by more inside a
        group, by as much in each.
    group
        Of each value: 0, 1, 2 ...
    pairs
        Groups to compare.
    """
    nothing = np.full(len(pairs), np.nan)
    freedom = len(values) - len(np.unique(group))
    if freedom < LEAST_FREEDOM or not pairs:
        return Contrasts(difference=nothing, low=nothing, high=nothing, p=nothing)
    scatter = _scatter(values, variance, group, freedom)
    mean, squared = _means(values, variance + scatter, group)
    first, second = np.array(pairs).T
    difference = mean[first] - mean[second]
    std = np.sqrt(squared[first] + squared[second])
    # Where there is scatter, it and the stated variances together are what the values show.
    t = stats.t(freedom) if scatter > 0.0 else stats.norm()
    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE)) * std
    return Contrasts(
        difference=difference,
        low=difference - half,
        high=difference + half,
        p=2.0 * t.sf(np.abs(difference) / std),
    )


def _means(
    values: Float[np.ndarray, " n"], variance: Float[np.ndarray, " n"], group: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Return the mean of each group and its variance; infinite where a group has no value."""
    weight = np.bincount(group, 1.0 / variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.bincount(group, values / variance) / weight, 1.0 / weight


def _scatter(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    freedom: int,
) -> float:
    """Return the variance beside the stated one with which chi^2 is what it should be."""
    low, high = 0.0, 4.0 * float(np.ptp(values)) ** 2 + np.finfo(float).tiny
    for _ in range(60):
        middle = 0.5 * (low + high)
        mean, _ = _means(values, variance + middle, group)
        chi2 = float(np.sum((values - mean[group]) ** 2 / (variance + middle)))
        low, high = (middle, high) if chi2 > freedom else (low, middle)
    return 0.5 * (low + high) if low > 0.0 else 0.0
