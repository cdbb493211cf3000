"""Which groups do not belong to the others: each held against all others, tails Student's.

References
----------
Rosner, Technometrics 25, 1983 (several outliers that hide one another);
Benjamini and Hochberg, J. of the Royal Statistical Society B 57, 1995 (rate of false discoveries);
Simes, Biometrika 73, 1986 (several tests as one); Benjamini and Bogomolov, J. of the Royal
Statistical Society B 76, 2014 (rates within what was selected).
"""

from dataclasses import dataclass
from math import comb
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from rotorfit.fleet.population.paule_mandel import scatter_beside
from rotorfit.fleet.population.random_effects import LEAST_GROUPS

MOST_APART: Final = 0.25
"""Share of groups that may be apart; beyond, it is the type that has two kinds."""
SET_ASIDE: Final = 0.05
"""Chance that a group is set aside, where none is apart, before the others are judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Apart:
    """How far each group is from the others.

    Attributes
    ----------
    difference
        From the mean of the others.
    std
        Of the difference: of the group's own number, of the mean, and the spread between groups.
    p
        Chance of a difference as large in a group that is like the others; NaN where not told.
    """

    difference: Float[np.ndarray, " g"]
    std: Float[np.ndarray, " g"]
    p: Float[np.ndarray, " g"]


def apart(values: Float[np.ndarray, " g"], variance: Float[np.ndarray, " g"]) -> Apart:
    """Return how far each group is from the mean of those that belong together.

    Parameters
    ----------
    values, variance
        Of each group's number by itself; NaN where it is not told.
    """
    told = np.flatnonzero(np.isfinite(values) & np.isfinite(variance))
    nothing = np.full(len(values), np.nan)
    if len(told) < LEAST_GROUPS:
        return Apart(difference=nothing, std=nothing, p=nothing)
    y, v = values[told], variance[told]
    away = _set_aside(y, v)
    difference, std, p = _against(y, v, ~away)
    # Those set aside with others were chosen among all who could have been.
    p[away] = np.minimum(p[away] * comb(len(y) - 1, max(int(away.sum()) - 1, 0)), 1.0)
    out = [nothing.copy() for _ in range(3)]
    for whole, part in zip(out, (difference, std, p), strict=True):
        whole[told] = part
    return Apart(difference=out[0], std=out[1], p=out[2])


def discovered(p: Float[np.ndarray, "g k"], rate: float) -> Bool[np.ndarray, "g k"]:
    """Return which groups are apart, and in what.

    Groups first: the tests of each are one (Simes), and of those selected a share of `rate` at most
    is false, in the mean (Benjamini and Hochberg). Of a selected group, numbers at the same rate
    times the share of groups that was selected (Benjamini and Bogomolov).

    Parameters
    ----------
    p
        Chance of each group's numbers under nothing; NaN where there is no test.
    rate
        Expected share of false ones among the groups returned.
    """
    one = np.array([_simes(row) for row in p])
    selected = _benjamini_hochberg(one, rate)
    judged = max(int(np.isfinite(one).sum()), 1)
    inside = rate * selected.sum() / judged
    out = np.zeros(p.shape, dtype=bool)
    for g in np.flatnonzero(selected):
        out[g] = _benjamini_hochberg(p[g], inside)
    return out


def _simes(p: Float[np.ndarray, " k"]) -> float:
    """Return one chance for several tests; NaN where there is none."""
    told = np.sort(p[np.isfinite(p)])
    k = len(told)
    return float(np.min(told * k / np.arange(1, k + 1))) if k else float("nan")


def _benjamini_hochberg(p: Float[np.ndarray, " k"], rate: float) -> Bool[np.ndarray, " k"]:
    """Return which tests say something."""
    told = np.isfinite(p)
    ranked = np.sort(p[told])
    passed = np.flatnonzero(ranked <= rate * np.arange(1, len(ranked) + 1) / max(len(ranked), 1))
    limit = ranked[passed[-1]] if len(passed) else -1.0
    return told & (np.where(told, p, np.inf) <= limit)


def _set_aside(y: Float[np.ndarray, " g"], v: Float[np.ndarray, " g"]) -> Bool[np.ndarray, " g"]:
    """Return groups so far from the others that they must not widen the spread of those.

    One after the other is taken out, the farthest first; the last that is far even among those
    left, however many sets of as many there are, is set aside with all before it: two outliers
    hide one another no more.
    """
    away, taken = np.zeros(len(y), dtype=bool), np.zeros(len(y), dtype=bool)
    for _ in range(max(min(int(MOST_APART * len(y)), len(y) - LEAST_GROUPS), 0)):
        _, _, p = _against(y, v, ~taken)
        p = np.where(taken, np.inf, p)
        farthest = int(np.argmin(p))
        taken[farthest] = True
        if p[farthest] * comb(len(y), int(taken.sum())) <= SET_ASIDE:
            away = taken.copy()
    return away


def _against(
    y: Float[np.ndarray, " g"], v: Float[np.ndarray, " g"], clean: Bool[np.ndarray, " g"]
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Return each group's difference from the mean of the clean others, its std and chance."""
    mine = np.eye(len(y), dtype=bool)
    others = clean[None, :] & ~mine
    between = _between(y, v, others)
    w = others / (v[None, :] + between[:, None])
    total = w.sum(axis=1)
    mean = (w @ y) / total
    std = np.sqrt(v + between + 1.0 / total)
    # Known only by the others' scatter is the spread between groups, not what each group says.
    typical = (w * (v[None, :] + between[:, None])).sum(axis=1) / total
    least = others.sum(axis=1) - 1.0
    freedom = least * ((v + between) / np.maximum(typical, np.finfo(float).tiny)) ** 2
    t = np.abs(y - mean) / std
    return (
        y - mean,
        std,
        np.array([_chance(*x) for x in zip(t, np.maximum(freedom, 1.0), strict=True)]),
    )


def _chance(t: float, freedom: float) -> float:
    return float(2.0 * stats.t.sf(t, freedom))


def _between(
    y: Float[np.ndarray, " g"], v: Float[np.ndarray, " g"], others: Bool[np.ndarray, "g g"]
) -> Float[np.ndarray, " g"]:
    """Return the variance between groups for each set of others."""

    def chi2(between: Float[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
        w = others / (v[None, :] + between[:, None])
        mean = (w @ y) / w.sum(axis=1)
        return np.sum(w * (y[None, :] - mean[:, None]) ** 2, axis=1)

    return scatter_beside(chi2, others.sum(axis=1) - 1.0, y)
