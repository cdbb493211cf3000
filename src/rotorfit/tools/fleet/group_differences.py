"""Differences between groups: of pairs, where all groups scatter alike, and of outlying groups.

Each group is held against all others, with Student's tails.

References
----------
Paule and Mandel, J. of Research of the National Bureau of Standards 87, 1982 (scatter beyond the
stated variances); Rosner, Technometrics 25, 1983 (several outliers that hide one another);
Benjamini and Hochberg, J. of the Royal Statistical Society B 57, 1995 (rate of false discoveries);
Simes, Biometrika 73, 1986 (several tests as one); Benjamini and Bogomolov, J. of the Royal
Statistical Society B 76, 2014 (rates within what was selected).
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import student_quantile, student_tail
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.tools.fleet.random_effects import LEAST_GROUPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jaxtyping import Bool, Float, Int

HALVINGS: Final = 60
LEAST_FREEDOM: Final = 4
"""Values beyond one a group, without which their scatter is not known."""
CONFIDENCE: Final = 0.95
MOST_OUTLYING: Final = 0.25
"""Share of groups that may be outliers; beyond, it is the type that has two kinds."""
SET_ASIDE: Final = 0.05
"""Chance that a group is set aside, where none is an outlier, before the others are judged."""


@frozen_dataclass
class Contrasts:
    """How far the first group of each pair is from the second; NaN if the scatter is not known.

    - `difference`, `low`, `high`: with its 95 % interval.
    - `p`: chance of a difference as large between groups that are alike.
    """

    difference: Float[np.ndarray, " k"]
    low: Float[np.ndarray, " k"]
    high: Float[np.ndarray, " k"]
    p: Float[np.ndarray, " k"]


@frozen_dataclass
class OutlierTest:
    """How far each group is from the others.

    - `difference`: from the mean of the others.
    - `std`: of the difference: of the group's number and the mean, and the groups' spread.
    - `p`: chance of a difference as large in a group that is like the others; NaN if not known.
    """

    difference: Float[np.ndarray, " g"]
    std: Float[np.ndarray, " g"]
    p: Float[np.ndarray, " g"]


def additional_scatter(
    chi2: Callable[[Float[np.ndarray, "*s"]], Float[np.ndarray, "*s"]],
    freedom: Float[np.ndarray, "*s"],
    values: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "*s"]:
    """Solve for the variance beyond the stated ones with which chi^2 is `freedom`; at least 0."""
    low = np.zeros_like(freedom)
    high = np.full_like(freedom, 4.0 * float(np.ptp(values)) ** 2 + np.finfo(float).tiny)
    # For all sets of values at once (Paule and Mandel); the range of `values` bounds it.
    for _ in range(HALVINGS):
        middle = np.asarray(0.5 * (low + high))
        more = chi2(middle) > freedom
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.where(low > 0.0, 0.5 * (low + high), 0.0)


def contrasts(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    pairs: Sequence[tuple[int, int]],
) -> Contrasts:
    """Estimate how pairs of groups differ; groups scatter alike beyond the stated `variance`."""
    unknown = np.full(len(pairs), np.nan)
    freedom = len(values) - len(np.unique(group))
    if freedom < LEAST_FREEDOM or not pairs:
        return Contrasts(difference=unknown, low=unknown, high=unknown, p=unknown)

    def chi2(scatter: Float[np.ndarray, ""]) -> Float[np.ndarray, ""]:
        mean, _ = _group_means(values, variance + scatter, group)
        return np.asarray(np.sum((values - mean[group]) ** 2 / (variance + scatter)))

    scatter = float(additional_scatter(chi2, np.array(float(freedom)), values))
    mean, squared = _group_means(values, variance + scatter, group)
    first, second = np.array(pairs).T
    difference = mean[first] - mean[second]
    std = np.sqrt(squared[first] + squared[second])
    # Where there is scatter, it and the stated variances together are what the values show.
    degrees = freedom if scatter > 0.0 else np.inf
    half = float(student_quantile(0.5 + 0.5 * CONFIDENCE, degrees)) * std
    return Contrasts(
        difference=difference,
        low=difference - half,
        high=difference + half,
        p=2.0 * student_tail(np.abs(difference) / std, degrees),
    )


def _group_means(
    values: Float[np.ndarray, " n"], variance: Float[np.ndarray, " n"], group: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Return the mean of each group and its variance; infinite if a group has no value."""
    weight = np.bincount(group, 1.0 / variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.bincount(group, values / variance) / weight, 1.0 / weight


def outlier_test(values: Float[np.ndarray, " g"], variance: Float[np.ndarray, " g"]) -> OutlierTest:
    """Compare each group's number with the mean of those that belong together; NaN: not known."""
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(variance))
    difference, std, p = np.full((3, len(values)), np.nan)
    if len(known) >= LEAST_GROUPS:
        y, v = values[known], variance[known]
        away = _set_aside(y, v)
        difference[known], std[known], chance = _compared_with_others(y, v, ~away)
        # Those set aside with others were chosen among all who could have been.
        chance[away] = np.minimum(chance[away] * comb(len(y) - 1, max(int(away.sum()) - 1, 0)), 1.0)
        p[known] = chance
    return OutlierTest(difference=difference, std=std, p=p)


def discoveries(p: Float[np.ndarray, "g k"], rate: float) -> Bool[np.ndarray, "g k"]:
    """Select outlying groups, and the numbers in which they are, from the chances `p`."""
    one = np.array([_simes_chance(row) for row in p])
    # Groups first: the tests of each are one (Simes), and of those selected a share of `rate` at
    # most is false, in the mean (Benjamini and Hochberg). Of a selected group, numbers at the same
    # rate times the share of groups that was selected (Benjamini and Bogomolov).
    selected = _benjamini_hochberg(one, rate)
    judged = max(int(np.isfinite(one).sum()), 1)
    inside = rate * selected.sum() / judged
    out = np.zeros(p.shape, dtype=bool)
    for g in np.flatnonzero(selected):
        out[g] = _benjamini_hochberg(p[g], inside)
    return out


def _simes_chance(p: Float[np.ndarray, " k"]) -> float:
    """Combine the p-values of several tests (Simes); NaN if there are none."""
    ranked = np.sort(p[np.isfinite(p)])
    k = len(ranked)
    return float(np.min(ranked * k / np.arange(1, k + 1))) if k else float("nan")


def _benjamini_hochberg(p: Float[np.ndarray, " k"], rate: float) -> Bool[np.ndarray, " k"]:
    """Select the tests that reject at a rate of false discoveries."""
    tested = np.isfinite(p)
    ranked = np.sort(p[tested])
    passed = np.flatnonzero(ranked <= rate * np.arange(1, len(ranked) + 1) / max(len(ranked), 1))
    limit = ranked[passed[-1]] if len(passed) else -1.0
    return tested & (np.where(tested, p, np.inf) <= limit)


def _set_aside(y: Float[np.ndarray, " g"], v: Float[np.ndarray, " g"]) -> Bool[np.ndarray, " g"]:
    """Select groups so far from the others that they must not widen the spread of those."""
    away, taken = np.zeros(len(y), dtype=bool), np.zeros(len(y), dtype=bool)
    for _ in range(max(min(int(MOST_OUTLYING * len(y)), len(y) - LEAST_GROUPS), 0)):
        _, _, p = _compared_with_others(y, v, ~taken)
        p = np.where(taken, np.inf, p)
        farthest = int(np.argmin(p))
        taken[farthest] = True
        # However many sets of as many there are (Rosner): two outliers hide one another no more.
        if p[farthest] * comb(len(y), int(taken.sum())) <= SET_ASIDE:
            away = taken.copy()
    return away


def _compared_with_others(
    y: Float[np.ndarray, " g"], v: Float[np.ndarray, " g"], clean: Bool[np.ndarray, " g"]
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Return each group's difference from the mean of the clean others, its std and chance."""
    others = clean[None, :] & ~np.eye(len(y), dtype=bool)

    def chi2(between: Float[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
        w = others / (v[None, :] + between[:, None])
        mean = (w @ y) / w.sum(axis=1)
        return np.sum(w * (y[None, :] - mean[:, None]) ** 2, axis=1)

    between = additional_scatter(chi2, others.sum(axis=1) - 1.0, y)
    w = others / (v[None, :] + between[:, None])
    total = w.sum(axis=1)
    mean = (w @ y) / total
    std = np.sqrt(v + between + 1.0 / total)
    # Known only by the others' scatter is the spread between groups, not what each group says.
    typical = (w * (v[None, :] + between[:, None])).sum(axis=1) / total
    least = others.sum(axis=1) - 1.0
    freedom = least * ((v + between) / np.maximum(typical, np.finfo(float).tiny)) ** 2
    t = np.abs(y - mean) / std
    return y - mean, std, 2.0 * student_tail(t, np.maximum(freedom, 1.0))
