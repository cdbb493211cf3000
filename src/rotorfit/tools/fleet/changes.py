r"""Detect changes of a number of some vehicles: a step, a drift from a moment on, or an outlier.

A model says for every vehicle which shapes its flights follow beside their level (most often
none), and one scatter between flights of all vehicles. Whole models are compared by

.. math:: S(M) = \log \int p(y \mid M, \sigma) \, d\sigma - \sum_i m_i c_i

with the levels integrated out (restricted likelihood), the sizes of the changes at their best,
:math:`\sigma` the scatter and :math:`m_i` the number of changes of vehicle i. Without stated
variances a change of statistic t with :math:`\nu` degrees of freedom raises the integral by
:math:`\frac{\nu}{2} \log(1 + t^2 / \nu)`; its price c is that at the t that the chance of a false
alarm, shared among all shapes, allows. For a given scatter vehicles stand alone, so their best
changes are sought there; of the models found along the scatters the one with the largest S is
taken, and no alternation is needed.

References
----------
Harville, J. of the American Statistical Association 72, 1977 (restricted likelihood); Chung et al.,
Psychometrika 78, 2013 (flat prior of a standard deviation); Killick, Fearnhead and Eckley, J. of
the American Statistical Association 107, 2012 (changes by a penalised likelihood).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.estimation.dispersion import degrees_of
from rotorfit.estimation.distributions import student_quantile, student_tail
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float, Int

Kind = Literal["step", "ramp", "once"]

LEAST_SERIES: Final = 4
"""Values for each change; of fewer nothing is said."""
MOST_PLACES: Final = 400
"""Most moments of a series that are tried, evenly spaced."""
MOST_CHANGES: Final = 8
CONFIDENCE: Final = 0.95
NORMAL_95: Final = 1.96
LEAST_STEPS: Final = 10
"""Values beyond one a vehicle by which stated variances can be held against what is seen."""
SCATTERS: Final = np.exp(np.linspace(-9.0, 3.0, 97))
"""Standard deviations between flights over which is integrated, in units of the values' spread."""
SHARES: Final = np.exp(np.linspace(-9.0, 0.0, 73))[:-1]
"""Shares of stated deviations, where they may be overstated."""
SEARCHED: Final = 8
"""Of these deviations every so many is searched for changes."""
MOST_FREEDOM: Final = 1e6
"""Degrees of freedom of what is as good as known."""
ALIKE: Final = 1.0 - 1e-9
"""Correlation of two shapes from which on they are one."""


@frozen_dataclass
class Shapes:
    """Every way of changing that is tried on a series.

    - `values`: one row a shape: 0 before, then 1 (step), 1, 2, 3 ... (ramp), or 1 at one value
      (once).
    - `kind`, `first`: of each row; the index of the first value that it concerns.
    """

    values: Float[np.ndarray, "k n"]
    kind: tuple[Kind, ...]
    first: Int[np.ndarray, " k"]


@frozen_dataclass
class Change:
    """What changed in a series.

    - `kind`, `first`: how, and the index of the first value concerned.
    - `earliest`, `latest`: 95 % interval of `first`.
    - `size`, `low`, `high`: of a step or of what happened once; of a ramp the change per value;
      with the 95 % interval, over all moments in theirs.
    - `p`: bound on the chance of such a change, or a clearer one, anywhere in a series in which
      nothing (else) changed.
    - `shape`: the row of `Shapes`.
    """

    kind: Kind
    first: int
    earliest: int
    latest: int
    size: float
    low: float
    high: float
    p: float
    shape: Float[np.ndarray, " n"]

    @property
    def total(self) -> float:
        """How far the last value is from the first by this change."""
        return float(self.size * self.shape[-1])


@frozen_dataclass
class Changes:
    """What changed in the series of some vehicles.

    - `of_group`: the changes of each vehicle, the clearest first.
    - `share`: of the stated variances by which the values really scatter; 1 unless asked for.
    """

    of_group: tuple[tuple[Change, ...], ...]
    share: float


@frozen_dataclass
class _Series:
    """One vehicle's values in order of time, and their variance for each scatter."""

    values: Float[np.ndarray, " n"]
    variance: Float[np.ndarray, "s n"]
    shapes: Shapes
    alarm: float

    @property
    def most(self) -> int:
        """How many changes it may have."""
        n = len(self.values)
        return min(MOST_CHANGES, n // LEAST_SERIES) if n >= LEAST_SERIES else 0

    def price(self, freedom: float) -> float:
        """Compute the price of a change in log likelihood: higher where scatter is hardly known."""
        # At Student's t that one of the shapes exceeds by chance as often as alarms may.
        t = -student_quantile(0.5 * self.alarm / max(len(self.shapes.first), 1), freedom)
        return 0.5 * freedom * float(np.log1p(t**2 / freedom))


Model = tuple[tuple[int, ...], ...]
"""The rows of the shapes that every vehicle follows."""


def shapes_of(n: int) -> Shapes:
    """List the shapes that are tried on a series of `n` values, similar ones side by side."""
    j = np.arange(n)
    inside = _spread_places(1, n - 1)  # at the last value all three would be one
    tried: tuple[tuple[Kind, Int[np.ndarray, " k"]], ...] = (
        ("step", _spread_places(1, n)),
        ("ramp", inside),
        ("once", inside),
    )
    (_, steps), *_ = tried
    return Shapes(
        values=np.concatenate(
            [
                (j >= steps[:, None]).astype(float),
                np.maximum(j - inside[:, None] + 1, 0).astype(float),
                (j == inside[:, None]).astype(float),
            ]
        ),
        kind=tuple(kind for kind, places in tried for _ in places),
        first=np.concatenate([places for _, places in tried]),
    )


def _spread_places(start: int, end: int) -> Int[np.ndarray, " k"]:
    count = max(min(end - start, MOST_PLACES), 0)
    return np.unique(np.linspace(start, end - 1, count).astype(int))


def find_changes(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    *,
    alarm: float,
    overstated: bool = False,
) -> Changes:
    """Find what changed in the values of each group, in order of time; usually nothing.

    Values scatter about their group's level by the stated `variance` and by a deviation that all
    groups share. With `overstated` the stated variances may be too large by a factor that all
    share. `alarm` is the chance of a false alarm in a group in which nothing changed.
    """
    wide = overstated and len(values) - len(np.unique(group)) >= LEAST_STEPS
    total, log_weight, share = _list_scatters(values, variance, group, wide)
    series = [
        _Series(
            values=values[group == g],
            variance=total[:, group == g],
            shapes=shapes_of(int((group == g).sum())),
            alarm=alarm,
        )
        for g in range(int(group.max(initial=-1)) + 1)
    ]
    model = _best_model(series, log_weight)
    posterior = _scatter_posterior(series, model, log_weight)
    found = [
        _describe_changes(one, rows, posterior) for one, rows in zip(series, model, strict=True)
    ]
    return Changes(of_group=tuple(found), share=float(np.exp(posterior @ np.log(share))))


def _list_scatters(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    wide: bool,
) -> tuple[Float[np.ndarray, "s n"], Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """List the variances of the values for every scatter, the logarithm of its prior, its share."""
    away = values - np.array([np.median(values[group == g]) for g in group])
    stated = float(np.median(variance))
    unit = np.sqrt(float(np.mean(away**2)) + stated) or 1.0
    total = variance + (unit * SCATTERS[:, None]) ** 2
    # The prior is flat in the standard deviation, whether it adds to the stated ones or scales
    # them.
    log_weight, share = np.log(unit * SCATTERS), np.ones(len(SCATTERS))
    if wide and stated > 0.0:
        total = np.concatenate([SHARES[:, None] ** 2 * variance, total])
        log_weight = np.concatenate([np.log(np.sqrt(stated) * SHARES), log_weight])
        share = np.concatenate([SHARES**2, share])
    return np.maximum(total, np.finfo(float).eps * np.max(values**2)), log_weight, share


def _best_model(series: Sequence[_Series], log_weight: Float[np.ndarray, " s"]) -> Model:
    """Find the model with the largest score, among the best ones for each scatter."""

    def score(model: Model) -> float:
        return _model_score(series, model, log_weight)

    tried = {
        tuple(_best_rows(one, one.variance[k]) for one in series)
        for k in range(0, len(log_weight), SEARCHED)
    }
    best = max(sorted(tried), key=score)
    while True:
        fewer = max(_with_one_less(best), key=score, default=best)
        if score(fewer) <= score(best):
            return best
        best = fewer


def _with_one_less(model: Model) -> list[Model]:
    return [
        (*model[:g], tuple(row for row in rows if row != left), *model[g + 1 :])
        for g, rows in enumerate(model)
        for left in rows
    ]


def _model_score(
    series: Sequence[_Series], model: Model, log_weight: Float[np.ndarray, " s"]
) -> float:
    """Return the criterion by which whole models are compared."""
    posterior = _scatter_posterior(series, model, log_weight)
    price = sum(
        len(rows) * one.price(_degrees_of_freedom(one, posterior))
        for one, rows in zip(series, model, strict=True)
        if rows
    )
    best, _ = _log_likelihoods(series, model)
    return float(np.logaddexp.reduce(best + log_weight)) - price


def _scatter_posterior(
    series: Sequence[_Series], model: Model, log_weight: Float[np.ndarray, " s"]
) -> Float[np.ndarray, " s"]:
    """Return how likely each scatter is."""
    _, restricted = _log_likelihoods(series, model)
    total = restricted + log_weight
    return np.exp(total - np.logaddexp.reduce(total))


def _degrees_of_freedom(one: _Series, posterior: Float[np.ndarray, " s"]) -> float:
    """Return the degrees of freedom with which the variance of the values is known.

    By how far its logarithm is open (`degrees_of`).
    """
    log_variance = np.log(one.variance).mean(axis=1)
    away = log_variance - posterior @ log_variance
    spread = float(posterior @ away**2)
    return degrees_of(spread, least=2.0 / MOST_FREEDOM)


def _log_likelihoods(series: Sequence[_Series], model: Model) -> Float[np.ndarray, "2 s"]:
    """Return the log likelihood for every scatter, levels integrated out.

    First with the sizes of changes at their best, then with these integrated out, too.
    """
    each = [_one_log_likelihoods(one, rows) for one, rows in zip(series, model, strict=True)]
    return np.sum(each, axis=0)


def _one_log_likelihoods(one: _Series, rows: Sequence[int]) -> Float[np.ndarray, "2 s"]:
    y, weight = one.values - np.median(one.values), 1.0 / one.variance
    X = np.vstack([np.ones(len(y)), one.shapes.values[list(rows)]])
    A: Float[np.ndarray, "s a a"] = np.einsum("an,sn,bn->sab", X, weight, X)
    b: Float[np.ndarray, "s a"] = weight @ (X * y).T
    size: Float[np.ndarray, "s a 1"] = np.linalg.solve(A, b[:, :, None])
    misfit = weight @ y**2 - np.einsum("sa,sa->s", b, size[:, :, 0])
    density = np.log(weight).sum(axis=1) - misfit
    return 0.5 * np.array([density - np.log(A[:, 0, 0]), density - np.linalg.slogdet(A)[1]])


def _best_rows(one: _Series, variance: Float[np.ndarray, " n"]) -> tuple[int, ...]:
    """Find the changes that pay their price at one scatter: singly or in pairs, while any does."""
    price, rows = one.price(MOST_FREEDOM), list[int]()
    while len(rows) < one.most:
        Z, U, _ = _shape_statistics(one, variance, rows)
        gains: dict[tuple[int, ...], float] = {
            (int(np.argmax(np.abs(Z))),): 0.5 * float(np.max(Z**2)) - price
        }
        if len(rows) + 2 <= one.most:
            pair, gain = _best_pair(Z, U)
            gains[pair] = gain - 2.0 * price
        best = max(gains, key=lambda added: gains[added])
        if gains[best] <= 0.0:
            break
        rows += best
    return tuple(sorted(rows))


def _best_pair(
    Z: Float[np.ndarray, " k"], U: Float[np.ndarray, "k n"]
) -> tuple[tuple[int, int], float]:
    """Return the two shapes that together explain most, and by how much in log likelihood."""
    r, square = U @ U.T, Z**2
    alike = np.abs(r) > ALIKE
    left = np.where(alike, np.inf, 1.0 - r**2)
    gain = 0.5 * (square[:, None] + square - 2.0 * r * np.outer(Z, Z)) / left
    first, second = divmod(int(np.argmax(gain)), len(Z))
    return (first, second), float(gain[first, second])


def _shape_statistics(
    one: _Series, variance: Float[np.ndarray, " n"], rows: Sequence[int]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k n"], Float[np.ndarray, " k"]]:
    """Return each shape's statistic beside the level and the changes in `rows`."""
    root = 1.0 / np.sqrt(variance)
    known = np.vstack([np.ones(len(root)), one.shapes.values[list(rows)]])
    Q = np.linalg.qr((known * root).T)[0]
    U = one.shapes.values * root
    whole = np.linalg.norm(U, axis=1)
    U = U - (U @ Q) @ Q.T
    length = np.linalg.norm(U, axis=1)
    seen = length > 1e-6 * whole
    # Z = U y / std, with unit directions U free of what is there already.
    U = np.where(seen[:, None], U / np.where(seen, length, 1.0)[:, None], 0.0)
    return U @ (root * (one.values - np.median(one.values))), U, np.where(seen, length, 0.0)


def _describe_changes(
    one: _Series, rows: Sequence[int], posterior: Float[np.ndarray, " s"]
) -> tuple[Change, ...]:
    """Return the changes of one vehicle with their intervals, the clearest first."""
    freedom = _degrees_of_freedom(one, posterior)
    variance = np.exp(posterior @ np.log(one.variance))
    found = [
        _describe_change(one, variance, row, [other for other in rows if other != row], freedom)
        for row in rows
    ]
    return tuple(sorted(found, key=lambda change: change.p))


def _describe_change(
    one: _Series, variance: Float[np.ndarray, " n"], row: int, others: Sequence[int], freedom: float
) -> Change:
    """Return one change beside the others of its vehicle, with its intervals."""
    Z, _, length = _shape_statistics(one, variance, others)
    kinds, kind = np.array(one.shapes.kind), one.shapes.kind[row]
    t = float(student_quantile(0.5 + 0.5 * CONFIDENCE, freedom))
    near = (Z[row] ** 2 - Z**2 <= t**2) & (length > 0.0) & (kinds == kind)
    sizes, reach = Z[near] / length[near], t / length[near]
    kept = near if kind != "once" else np.arange(len(Z)) == row
    return Change(
        kind=kind,
        first=int(one.shapes.first[row]),
        earliest=int(one.shapes.first[kept].min()),
        latest=int(one.shapes.first[kept].max()),
        size=float(Z[row] / length[row]),
        low=float((sizes - reach).min()),
        high=float((sizes + reach).max()),
        p=min(2.0 * len(Z) * float(student_tail(abs(Z[row]), freedom)), 1.0),
        shape=one.shapes.values[row],
    )
