r"""When a series of estimates changed: in one step, steadily from some moment on, or once only.

Every shape :math:`s_k` gives one standard normal statistic :math:`Z_k` if nothing changed; the
largest is judged by a bound on :math:`P(\max_k |Z_k| > z)`: the sum over all shapes, less what
neighbours in a row have in common.

References
----------
Hunter, J. of Applied Probability 13, 1976 (the bound); Worsley, Biometrika 70, 1983 (its use for a
change at an unknown moment).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

Kind = Literal["step", "ramp", "once"]

LEAST_SERIES: Final = 4
"""Of fewer values nothing is said."""
MOST_PLACES: Final = 400
"""Of longer series this many moments are tried, evenly spaced."""
MOST_CHANGES: Final = 8
LOG_LIKELIHOOD_DROP: Final = 3.84
"""Of twice the log likelihood: moments this close to the best one are in its 95 % interval."""
NORMAL_95: Final = 1.96
LEAST_STEPS: Final = 10
"""Differences between neighbours by which stated variances can be held against what is seen."""
LEAST_SHARE: Final = 1e-4
NORMAL_MAD: Final = 1.4826
"""Standard deviation over median absolute deviation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shapes:
    """Every way of changing that is tried on a series.

    Attributes
    ----------
    values
        One row a shape: 0 before, then 1 (step), 1, 2, 3 ... (ramp), or 1 at one value (once).
    kind, first
        Of each row; the index of the first value that it concerns.
    """

    values: Float[np.ndarray, "k n"]
    kind: tuple[Kind, ...]
    first: Int[np.ndarray, " k"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What changed in a series.

    Attributes
    ----------
    kind, first
        How, and the index of the first value concerned.
    earliest, latest
        95 % interval of `first`.
    size, low, high
        Of a step or of what happened once; of a ramp the change per value; with the 95 % interval,
        over all moments in theirs.
    p
        Chance of such a change, or a clearer one, anywhere in a series in which nothing changed.
    shape
        The row of `Shapes`.
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


def shapes_of(n: int) -> Shapes:
    """List the shapes that are tried on a series of `n` values, similar ones side by side."""
    j = np.arange(n)
    inside = _places(1, n - 1)  # at the last value all three would be one
    tried: tuple[tuple[Kind, Int[np.ndarray, " k"]], ...] = (
        ("step", _places(1, n)),
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


def _places(start: int, end: int) -> Int[np.ndarray, " k"]:
    return np.unique(np.linspace(start, end - 1, min(end - start, MOST_PLACES)).astype(int))


def find_changes(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    *,
    alarm: float,
    freedom: float = np.inf,
) -> tuple[Change, ...]:
    """Find what changed in a series in order of time, the clearest first; usually nothing.

    `variance` is about a level that does not change, known with `freedom` degrees of freedom;
    `alarm` is the chance of a false alarm in a series in which nothing changed.
    """
    n = len(values)
    if n < LEAST_SERIES:
        return ()
    shapes, found = shapes_of(n), list[Change]()
    while len(found) < min(MOST_CHANGES, n // 3):
        known = [np.ones(n), *(change.shape for change in found)]
        change = _clearest(values, variance, shapes, known, freedom)
        if change is None or change.p > alarm:
            break
        found.append(change)
    return tuple(found)


def _clearest(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    shapes: Shapes,
    known: Sequence[Float[np.ndarray, " n"]],
    freedom: float,
) -> Change | None:
    """Find the clearest further change, with the columns of those already known projected out."""
    root = 1.0 / np.sqrt(variance)
    Q = np.linalg.qr(np.array(known).T * root[:, None])[0]
    U = shapes.values * root
    whole = np.linalg.norm(U, axis=1)
    U = U - (U @ Q) @ Q.T
    length = np.linalg.norm(U, axis=1)
    seen = length > 1e-6 * whole
    if not seen.any():
        return None
    U[seen] /= length[seen, None]
    U[~seen] = 0.0
    Z = U @ (root * values)
    best = int(np.argmax(np.abs(Z)))
    near = (Z[best] ** 2 - Z**2 <= LOG_LIKELIHOOD_DROP) & seen
    near &= np.array(shapes.kind) == shapes.kind[best]
    std = 1.0 / length[near]
    quantile = float(stats.t.ppf(0.975, freedom)) if np.isfinite(freedom) else NORMAL_95
    sizes, reach = Z[near] * std, quantile * std
    kept = near if shapes.kind[best] != "once" else np.arange(len(Z)) == best
    return Change(
        kind=shapes.kind[best],
        first=int(shapes.first[best]),
        earliest=int(shapes.first[kept].min()),
        latest=int(shapes.first[kept].max()),
        size=float(Z[best] / length[best]),
        low=float((sizes - reach).min()),
        high=float((sizes + reach).max()),
        p=chance_of_largest(abs(float(Z[best])), U[seen], freedom),
        shape=shapes.values[best],
    )


def chance_of_largest(z: float, directions: Float[np.ndarray, "k n"], freedom: float) -> float:
    """Bound the chance that the largest of the statistics Z = u^T (white noise) exceeds `z`.

    `directions` holds unit vectors u, neighbours alike. With `freedom` of the noise's scale the
    tails are Student's, as if each statistic's.
    """
    if np.isfinite(freedom):
        tail = max(float(stats.t.sf(z, freedom)), 1e-300)
        z = float(stats.norm.isf(tail))
    single = 2.0 * float(stats.norm.sf(z))
    shared = np.einsum("kn,kn->k", directions[1:], directions[:-1])
    both = _both_exceed(z, np.clip(shared, -1.0, 1.0))
    return float(min(max(len(directions) * single - both.sum(), single), 1.0))


def _both_exceed(z: float, correlation: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return P(|Z_1| > z, |Z_2| > z) of standard normal pairs."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    reach = 8.0 / max(z, 1.0)
    x = z + 0.5 * reach * (nodes + 1.0)
    density = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi) * weights * 0.5 * reach
    rho = correlation[:, None]
    left = np.sqrt(np.maximum(1.0 - rho**2, 1e-12))
    above = stats.norm.sf((z - rho * x) / left) + stats.norm.cdf((-z - rho * x) / left)
    return 2.0 * (above @ density)


def robust_scatter(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
) -> float:
    """Estimate the variance between repeats beyond their own: the median over groups.

    From differences of neighbours in time, so that neither steps nor steady change, nor a few
    groups with many strange values, spoil it; 0 where no group has `LEAST_SERIES` values.
    """
    seen = _seen_and_stated(values, variance, group)
    return max(float(np.median(seen[:, 0] - seen[:, 1])), 0.0) if len(seen) else 0.0


def overstated(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
) -> float:
    """Estimate the share of their stated variances by which repeats really scatter; 1 at most.

    As `robust_scatter`; 1 with fewer than `LEAST_STEPS` differences.
    """
    seen = _seen_and_stated(values, variance, group)
    if seen[:, 2].sum() < LEAST_STEPS or not (seen[:, 1] > 0.0).all():
        return 1.0
    return float(min(max(np.median(seen[:, 0] / seen[:, 1]), LEAST_SHARE), 1.0))


def _seen_and_stated(
    values: Float[np.ndarray, " n"],
    variance: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
) -> Float[np.ndarray, "g 3"]:
    """Return of each long group: variance by neighbours, as stated, how many differences."""
    found: list[tuple[float, float, float]] = []
    for i in np.unique(group):
        y, v = values[group == i], variance[group == i]
        if len(y) >= LEAST_SERIES:
            step = np.diff(y)
            size = NORMAL_MAD * float(np.median(np.abs(step - np.median(step))))
            stated = float(np.median(0.5 * (v[1:] + v[:-1])))
            found.append((0.5 * size**2, stated, float(len(step))))
    return np.array(found).reshape(-1, 3)
