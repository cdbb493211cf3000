r"""Groups about a common mean, repeats about their group, every repeat with its own covariance.

:math:`y_{ij} = \mu + b_i + X_{ij} \delta_i + e_{ij} + n_{ij}` with :math:`b_i \sim N(0, B)`
between groups, :math:`e_{ij} \sim N(0, W)` between the repeats of a group, and
:math:`n_{ij} \sim N(0, S_{ij})`, known; what changed within a group is :math:`\delta_i`.
B and W are diagonal: some twenty groups do not show their correlations.

References
----------
Harville, J. of the American Statistical Association 72, 1977 (restricted likelihood, and the
prediction of random effects); Chung et al., Psychometrika 78, 2013 (standard deviations of random
effects that do not collapse to zero: the mode under a flat prior on the logarithm's Jacobian);
Kackar and Harville, J. of the American Statistical Association 79, 1984 (what not knowing B and W
adds to the error of a prediction).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Bool, Float, Int

LEAST_GROUPS: Final = 5
"""Fewest groups: with fewer, the spread between groups is unknown, and nothing is drawn towards the
mean."""
LEAST_REPEATS: Final = 2
"""Repeats beyond the first of each group; with fewer, the scatter between them is unknown."""
UNKNOWN_STD: Final = 1e4
"""Deviation where it is unknown, in units of the spread of all values."""
LIMITS: Final = (-9.0, 3.0)
"""Limits of the logarithm of a standard deviation in the same units."""
LEAST_CURVATURE: Final = 0.5
"""Least curvature of the likelihood in that logarithm: it is known to a factor of four at worst."""


@frozen_dataclass
class Repeated:
    """Numbers that were estimated several times for each of several groups.

    - `values`: one row a repeat; NaN if it does not have the number.
    - `covariance`: of each row's error; ignored for numbers that a row does not have.
    - `group`: of each repeat, from 0.
    - `changes`: columns of what changed within a group; each has one coefficient for every group in
      which it is not zero.
    """

    values: Float[np.ndarray, "n p"]
    covariance: Float[np.ndarray, "n p p"]
    group: Int[np.ndarray, " n"]
    changes: Float[np.ndarray, "n p m"]

    @property
    def known(self) -> Bool[np.ndarray, "n p"]:
        """Which numbers each repeat has."""
        return np.isfinite(self.values)

    @property
    def groups(self) -> int:
        """How many groups there are."""
        return int(self.group.max()) + 1


@frozen_dataclass
class RandomEffects:
    """What groups and repeats say together.

    - `mean`, `mean_covariance`: of the population the groups are drawn from.
    - `between`, `within`: standard deviations between groups and between the repeats of a group;
      NaN with too few groups or repeats.
    - `level`, `level_covariance`: each group's level by its own repeats only; NaN if they do not
      have it. Levels are those where all columns of changes are zero.
    - `shrunk`, `shrunk_covariance`: each group's level by its repeats and the population, with the
      uncertainty of the mean and of both deviations in the covariance; NaN with fewer than
      `LEAST_GROUPS` groups.
    """

    mean: Float[np.ndarray, " p"]
    mean_covariance: Float[np.ndarray, "p p"]
    between: Float[np.ndarray, " p"]
    within: Float[np.ndarray, " p"]
    level: Float[np.ndarray, "g p"]
    level_covariance: Float[np.ndarray, "g p p"]
    shrunk: Float[np.ndarray, "g p"]
    shrunk_covariance: Float[np.ndarray, "g p p"]


@frozen_dataclass
class _Levels:
    """Each group's level by its repeats: information, its product with the level, cost."""

    A: Float[np.ndarray, "g p p"]
    q: Float[np.ndarray, "g p"]
    cost: float


@frozen_dataclass
class _Posterior:
    """Mean, and levels drawn towards it, for given deviations."""

    mean: Float[np.ndarray, " p"]
    mean_covariance: Float[np.ndarray, "p p"]
    level: Float[np.ndarray, "g p"]
    covariance: Float[np.ndarray, "g p p"]
    cost: float


def random_effects(data: Repeated) -> RandomEffects:
    """Estimate mean, deviations, and every group's level with and without the others."""
    if not data.known.any(axis=0).all():
        raise EstimationError("a number has no value in any flight: leave it out")
    center = np.nanmedian(data.values, axis=0)
    scale = _scatter_size(data.values - center, data.covariance)
    unit = Repeated(
        values=(data.values - center) / scale,
        covariance=data.covariance / np.outer(scale, scale),
        group=data.group,
        changes=data.changes,
    )
    log_std, free = _search_start(unit)
    # The deviations are where the restricted likelihood times their product is largest; means and
    # covariances are averaged over what the likelihood leaves open of them.
    mode, root = _find_mode(lambda x: restricted_cost(unit, x), log_std, free)
    return _average_over_mode(unit, mode, root, free, center=center, scale=scale)


def restricted_cost(data: Repeated, log_std: Float[np.ndarray, " p2"]) -> float:
    """Return -2 log of the restricted likelihood, up to a constant (Harville 1977).

    `log_std` holds the logarithms of the deviations within groups, then of those between groups.
    """
    levels, p = _estimate_levels(data, log_std), data.values.shape[1]
    return levels.cost + _towards_mean(levels, np.exp(log_std[p:])).cost


def _scatter_size(
    values: Float[np.ndarray, "n p"], covariance: Float[np.ndarray, "n p p"]
) -> Float[np.ndarray, " p"]:
    """Return the size of each number's scatter: the unit in which it is worked with."""
    known = np.where(np.isfinite(values), np.einsum("nii->ni", covariance), np.nan)
    size = np.sqrt(np.nanmean(values**2, axis=0) + np.nanmedian(known, axis=0))
    return np.where(size > 0, size, 1.0)


def _search_start(data: Repeated) -> tuple[Float[np.ndarray, " p2"], Bool[np.ndarray, " p2"]]:
    """Return where the search begins, and which deviations can be estimated at all."""
    known, g = data.known, data.groups
    count = np.array([np.bincount(data.group, known_k, g) for known_k in known.T]).T
    groups = (count > 0).sum(axis=0)
    within_free = np.maximum(count - 1, 0).sum(axis=0) >= LEAST_REPEATS
    between_free = groups >= LEAST_GROUPS
    p = known.shape[1]
    start = np.log(np.concatenate([np.full(p, 0.3), np.full(p, 0.5)]))
    start[:p][~within_free] = -np.inf
    start[p:][~between_free] = np.log(UNKNOWN_STD)
    return start, np.concatenate([within_free, between_free])


def _find_mode(
    cost: Callable[[Float[np.ndarray, " d"]], float],
    start: Float[np.ndarray, " d"],
    free: Bool[np.ndarray, " d"],
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "f f"]]:
    """Find the most likely logarithms, and a root of the covariance of those that are free."""

    def posterior(x: Float[np.ndarray, " f"]) -> float:
        whole = start.copy()
        whole[free] = x
        # A prior flat in each standard deviation is its product in the logarithm: none is zero
        # then.
        return 0.5 * cost(whole) - float(x.sum())

    if not free.any():
        return start, np.zeros((0, 0))
    from scipy import optimize  # slow to import

    bounds = [LIMITS] * int(free.sum())
    found = optimize.minimize(posterior, start[free], method="L-BFGS-B", bounds=bounds).x
    mode = start.copy()
    mode[free] = found
    values, vectors = np.linalg.eigh(_numerical_curvature(posterior, found))
    return mode, vectors / np.sqrt(np.maximum(values, LEAST_CURVATURE))


def _numerical_curvature(
    function: Callable[[Float[np.ndarray, " f"]], float], at: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "f f"]:
    """Compute second derivatives by central differences."""
    f, h = len(at), 0.1
    step = h * np.eye(f)
    H = np.empty((f, f))
    middle = function(at)
    for i in range(f):
        H[i, i] = (function(at + step[i]) - 2.0 * middle + function(at - step[i])) / h**2
        for j in range(i):
            a, b = step[i] + step[j], step[i] - step[j]
            corners = function(at + a) + function(at - a) - function(at + b) - function(at - b)
            H[i, j] = H[j, i] = corners / (4.0 * h**2)
    return H


def _estimate_levels(data: Repeated, log_std: Float[np.ndarray, " p2"]) -> _Levels:
    """Estimate each group's level by its repeats, changes projected out."""
    known, p, m = data.known, data.values.shape[1], data.changes.shape[2]
    both = known[:, :, None] & known[:, None, :]
    within = np.exp(2.0 * log_std[:p])
    V = np.where(both, data.covariance, 0.0)
    V += np.eye(p) * np.where(known, within, 1.0)[:, :, None]
    y, A = np.where(known, data.values, 0.0), np.where(both, np.linalg.inv(V), 0.0)
    r = np.einsum("npk,nk->np", A, y)
    cost = float(np.linalg.slogdet(V)[1].sum() + np.sum(r * y))
    total: Float[np.ndarray, "g p p"] = _sum_by_group(A, data)
    q: Float[np.ndarray, "g p"] = _sum_by_group(r, data)
    if m:
        AX = A @ data.changes
        cross: Float[np.ndarray, "g p m"] = _sum_by_group(AX, data)
        square: Float[np.ndarray, "g m m"] = _sum_by_group(
            data.changes.transpose(0, 2, 1) @ AX, data
        )
        rest: Float[np.ndarray, "g m"] = _sum_by_group(
            np.einsum("npm,np->nm", data.changes, r), data
        )
        idle = np.einsum("gmm->gm", square) <= 0.0
        square += np.eye(m) * idle[:, :, None]
        gain: Float[np.ndarray, "g p m"] = np.linalg.solve(
            square, cross.transpose(0, 2, 1)
        ).transpose(0, 2, 1)
        cost += float(np.linalg.slogdet(square)[1].sum())
        cost -= float(np.sum(rest * np.linalg.solve(square, rest[:, :, None])[:, :, 0]))
        total = total - gain @ cross.transpose(0, 2, 1)
        q = q - np.einsum("gpm,gm->gp", gain, rest)
    return _Levels(A=total, q=q, cost=cost)


def _sum_by_group(each: Float[np.ndarray, "n *k"], data: Repeated) -> Float[np.ndarray, "g *k"]:
    out = np.zeros((data.groups, *each.shape[1:]))
    np.add.at(out, data.group, each)
    return out


def _towards_mean(levels: _Levels, between: Float[np.ndarray, " p"]) -> _Posterior:
    """Estimate the mean, and the levels drawn towards it, with their share of the cost."""
    A, q, D = levels.A, levels.q, np.diag(between)
    K = np.eye(len(between)) + D @ A @ D
    G = D @ np.linalg.inv(K) @ D
    keep = np.eye(len(between)) - G @ A
    C: Float[np.ndarray, "p p"] = np.sum(A @ keep, axis=0)
    c = np.sum(q - np.einsum("gij,gj->gi", A @ G, q), axis=0)
    mean_covariance = np.linalg.inv(C)
    mean = mean_covariance @ c
    cost = np.linalg.slogdet(K)[1].sum() - np.einsum("gi,gij,gj->", q, G, q)
    cost += np.linalg.slogdet(C)[1] - c @ mean
    return _Posterior(
        mean=mean,
        mean_covariance=mean_covariance,
        level=mean + np.einsum("gij,gj->gi", G, q - A @ mean),
        covariance=G + keep @ mean_covariance @ keep.transpose(0, 2, 1),
        cost=float(cost),
    )


def _by_group(
    levels: _Levels,
) -> tuple[Float[np.ndarray, "g p"], Float[np.ndarray, "g p p"]]:
    """Estimate each group's level by its own repeats; NaN if they do not have it."""
    inverse = np.linalg.pinv(levels.A, rcond=1e-12, hermitian=True)
    level = np.einsum("gij,gj->gi", inverse, levels.q)
    seen = np.einsum("gij,gji->gi", inverse, levels.A)
    known = seen > 1.0 - 1e-6
    both = known[:, :, None] & known[:, None, :]
    return np.where(known, level, np.nan), np.where(both, inverse, np.nan)


def _average_over_mode(
    data: Repeated,
    mode: Float[np.ndarray, " p2"],
    root: Float[np.ndarray, "f f"],
    free: Bool[np.ndarray, " p2"],
    *,
    center: Float[np.ndarray, " p"],
    scale: Float[np.ndarray, " p"],
) -> RandomEffects:
    """Average over the uncertainty of the deviations, and convert to plain units."""
    p = data.values.shape[1]
    points = np.repeat(mode[None], max(2 * len(root), 1), axis=0)
    points[:, free] += _spread_points(root)
    levels = [_estimate_levels(data, x) for x in points]
    drawn = [_towards_mean(a, np.exp(x[p:])) for a, x in zip(levels, points, strict=True)]
    mean, mean_cov = _mix_normals([(d.mean[None], d.mean_covariance[None]) for d in drawn])
    shrunk, shrunk_cov = _mix_normals([(d.level, d.covariance) for d in drawn])
    level, level_cov = _mix_normals([_by_group(a) for a in levels])
    deviations = np.where(free, np.exp(mode), np.nan) * np.concatenate([scale, scale])
    square = np.outer(scale, scale)
    few = ~free[p:]
    shrunk[:, few] = np.nan
    return RandomEffects(
        mean=mean[0] * scale + center,
        mean_covariance=mean_cov[0] * square,
        between=deviations[p:],
        within=deviations[:p],
        level=level * scale + center,
        level_covariance=level_cov * square,
        shrunk=shrunk * scale + center,
        shrunk_covariance=np.where(few | few[:, None], np.nan, shrunk_cov * square),
    )


def _spread_points(root: Float[np.ndarray, "f f"]) -> Float[np.ndarray, "k f"]:
    """Return points, all of one weight, that have a covariance: root root^T (about zero)."""
    f = len(root)
    return np.concatenate([np.sqrt(f) * root.T, -np.sqrt(f) * root.T]) if f else np.zeros((1, 0))


def _mix_normals(
    parts: list[tuple[Float[np.ndarray, "g p"], Float[np.ndarray, "g p p"]]],
) -> tuple[Float[np.ndarray, "g p"], Float[np.ndarray, "g p p"]]:
    """Compute mean and covariance of a mixture of normal distributions, all of one weight."""
    means = np.array([mean for mean, _ in parts])
    mean = means.mean(axis=0)
    away = means - mean
    spread = np.einsum("kgi,kgj->gij", away, away) / len(parts)
    return mean, np.mean([covariance for _, covariance in parts], axis=0) + spread
