"""Which combinations of parameters the equations leave free."""

from dataclasses import dataclass

import numpy as np

from rotorfit.estimation.estimate import LinearProblem, problem_rows, scaled_singular

FREE = 1e-9
"""Relative singular value of the column-scaled equations under which a direction is free: exact
data leave rounding there, noisy data their noise."""
SHARE = 0.05
"""Parameters with a smaller share of a direction are not named in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeDirection:
    """A combination of parameters that the equations do not determine.

    Attributes
    ----------
    strength
        Its singular value relative to the largest, columns scaled to unit length.
    parts
        Its parameters and their relative changes along it, the largest 1.
    """

    strength: float
    parts: dict[str, float]


def free_directions(problem: LinearProblem, *, below: float = FREE) -> tuple[FreeDirection, ...]:
    """Return the directions of parameters that the known equations leave free.

    The null space of the observation matrix without its known column: the argument of Six et al.
    2020, eq. 23, for any flight, vehicle and number of configurations.

    Parameters
    ----------
    problem
        The equations; columns that are zero are an error, not a direction.
    below
        Largest relative singular value of a free direction.
    """
    names = problem.map.names
    svd = scaled_singular(problem_rows(problem)[:, : len(names)], names)
    found: list[FreeDirection] = []
    for s, v in zip(svd.s, svd.Vt, strict=True):
        if s <= below * svd.s[0]:
            shares = v / v[np.argmax(np.abs(v))]
            parts = {n: float(x) for n, x in zip(names, shares, strict=True) if abs(x) > SHARE}
            found.append(FreeDirection(strength=float(s / svd.s[0]), parts=parts))
    return tuple(found)
