"""By how much two groups differ, where the scatter inside all groups is one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from rotorfit.fleet.population.paule_mandel import scatter_beside

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

    def chi2(scatter: Float[np.ndarray, ""]) -> Float[np.ndarray, ""]:
        mean, _ = _means(values, variance + scatter, group)
        return np.asarray(np.sum((values - mean[group]) ** 2 / (variance + scatter)))

    scatter = float(scatter_beside(chi2, np.array(float(freedom)), values))
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
