r"""A force that grows with height: a tether whose weight hangs on the vehicle, or the ground below.

At one rotor speed the thrust lifts less the higher the vehicle is. Heights are integrals of the
vertical velocity; what their unknown constants and a bias add is a parabola, which is fitted
beside. Few flights have such a force, so that the prior is a mixture: none, or, in `SHARE` of them,
one of some `USUAL`. Its 95 % half-width times a usual height is what the mean thrust may lack.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

SHARE: Final = 0.03
"""Of the flights, before they are seen, in which some such force pulls."""
USUAL: Final = 0.25
"""Its deviation, over mass [m/s^2 a metre]: 2.5 % of the weight."""
SOUND: Final = 0.015
"""Deviation of what wakes and drag make in its place in sound flights [m/s^2 a metre]."""
HEIGHT: Final = 3.0
"""Mean height over the ground of a flight that has one, of which no log tells [m]."""
BATCH: Final = 2.0
"""Length of a batch [s]."""
FEWEST, MOST = 4, 10
"""Batches of a stretch."""
ORDERS: Final = 8
"""In which the batches of a stretch are tried."""
TINY: Final = 1e-12
LARGEST: Final = 1.5
"""That is looked for [m/s^2 a metre]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightForce:
    """By how much a force over mass grows with height [m/s^2 a metre].

    Attributes
    ----------
    value, std
        By the regression.
    probability
        That there is one.
    half_width
        Of its 95 % interval from none, by the mixture.
    """

    value: float
    std: float
    probability: float
    half_width: float

    @property
    def mean_std(self) -> float:
        """Deviation of the mean force over mass that it leaves open [m/s^2]."""
        return self.half_width * HEIGHT / 1.96


def height_force(
    left: Float[np.ndarray, " n"], velocity: Float[np.ndarray, " n"], step: float
) -> HeightForce | None:
    """Estimate how a force that is no thrust grows with height; None of a short stretch.

    Parameters
    ----------
    left
        Specific force that thrust leaves unexplained [m/s^2].
    velocity
        Upwards [m/s], with the samples `step` apart [s].
    """
    n = len(left)
    count = min(int(n * step / BATCH), MOST)
    if count < FEWEST:
        return None
    A = _motion(velocity, step)
    value, rest = _slope(A, left)
    rows = np.arange(n)
    batches = np.array_split(rows, count)
    without = [np.delete(rows, own) for own in batches]
    moved = np.array([_slope(A[kept], left[kept])[0] for kept in without]) - value
    std = float(np.sqrt((count - 1) / count * (moved**2).sum()))
    every = (std, SOUND, _by_gusts(A, rest, batches, step))
    return weighed(value, float(np.linalg.norm(every)), degrees=count - 1)


def _motion(velocity: Float[np.ndarray, " n"], step: float) -> Float[np.ndarray, "n 5"]:
    """Build the columns of a parabola, a velocity, and the height that it makes."""
    time = np.linspace(-1.0, 1.0, len(velocity))
    height = np.cumsum(velocity - velocity.mean()) * step
    return np.column_stack([np.ones(len(time)), time, time**2, velocity, height])


def _slope(
    A: Float[np.ndarray, "n 5"], left: Float[np.ndarray, " n"]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Regress a force; return by how much it falls with height, and what is left of it."""
    found = np.linalg.lstsq(A, left)[0]
    return -float(found[-1]), left - A @ found


def _by_gusts(
    A: Float[np.ndarray, "n 5"],
    rest: Float[np.ndarray, " n"],
    batches: Sequence[Int[np.ndarray, " _"]],
    step: float,
) -> float:
    """Estimate what gusts, or noise, make of the slope by the heights that are their own.

    A force f that no thrust answers makes a height whose mean product with f is less than nothing:
    minus the mean square of the velocity. Batches of the rest in another order are such a force.
    """
    rng = np.random.default_rng(0)
    line, height = A[:, :2], A[:, -1]
    height = height - A[:, :-1] @ np.linalg.lstsq(A[:, :-1], height)[0]
    power = [0.0]
    for _ in range(ORDERS):
        order = rng.permutation(len(batches)).tolist()
        gained = np.cumsum(np.concatenate([rest[batches[i]] for i in order])) * step
        gained = gained - line @ np.linalg.lstsq(line, gained)[0]
        power.append(float(gained @ gained))
    return sum(power) / ORDERS / max(float(height @ height), TINY)


def weighed(value: float, std: float, *, degrees: int) -> HeightForce:
    """Weigh an estimate by the mixture of no force and a usual one."""
    grid = np.linspace(0.0, LARGEST, 601)
    prior = SHARE * 2.0 * stats.norm.pdf(grid, scale=USUAL)
    some = prior * stats.t.pdf((value - grid) / std, degrees) * (grid[1] - grid[0])
    none = (1.0 - SHARE) * float(stats.t.pdf(value / std, degrees))
    total = float(some.sum()) + none
    beyond = 1.0 - (none + np.cumsum(some)) / total
    return HeightForce(
        value=value,
        std=std,
        probability=float(some.sum()) / total,
        half_width=float(grid[np.searchsorted(-beyond, -0.05)]),
    )
