"""The quintic spline through equally spaced samples, as `scipy.interpolate.make_interp_spline`.

To import `scipy.interpolate`, which imports `scipy.optimize`, takes longer than to read a short
log. De Boor, "A Practical Guide to Splines", 1978, chapters IX, X and XIII.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.logs.flight_log import pieces

if TYPE_CHECKING:
    from jaxtyping import Float, Int

DEGREE: Final = 5


def quintic_spline(
    values: Float[np.ndarray, "n k"], at: Float[np.ndarray, " m"], *, derivatives: int
) -> tuple[Float[np.ndarray, "m k"], ...]:
    """Evaluate the spline through rows 0, 1, ... of `values` and its derivatives, each per row.

    The knots are the rows without the two next to each end ("not a
    knot"), and the end rows six times.
    """
    n = len(values)
    if n <= DEGREE:
        raise ValueError(f"a quintic spline needs six samples, here are {n}")
    knots = _place_knots(n)
    coefficients = _solve_coefficients(n, values)
    evaluated: list[Float[np.ndarray, "m k"]] = []
    for order in range(derivatives + 1):
        if order:
            coefficients = _differentiate_spline(knots, coefficients, DEGREE - order + 1)
        made = np.empty((len(at), *values.shape[1:]))
        for part in pieces(len(at)):
            made[part] = _evaluate_spline(knots, coefficients, at[part], DEGREE - order)
        evaluated.append(made)
    return tuple(evaluated)


def _evaluate_spline(
    knots: Float[np.ndarray, " t"],
    coefficients: Float[np.ndarray, "n k"],
    at: Float[np.ndarray, " m"],
    degree: int,
) -> Float[np.ndarray, "m k"]:
    """Sum the B-splines of a degree, times their coefficients."""
    span = _find_spans(knots, at)
    basis = _compute_basis(knots, at, span, degree)
    return np.asarray(
        sum(basis[:, j : j + 1] * coefficients[span - degree + j] for j in range(degree + 1))
    )


def _find_spans(
    knots: Float[np.ndarray, " t"], at: Float[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    """Find the number of the last knot that is not above each place, those of the ends once."""
    return np.clip(np.searchsorted(knots, at, side="right") - 1, DEGREE, len(knots) - DEGREE - 2)


def _place_knots(n: int) -> Float[np.ndarray, " t"]:
    """Return the knots of n samples: n + 6 of them."""
    half = (DEGREE + 1) // 2
    inner = np.arange(float(half), n - half)
    return np.concatenate([np.zeros(DEGREE + 1), inner, np.full(DEGREE + 1, n - 1.0)])


def _compute_basis(
    knots: Float[np.ndarray, " t"],
    at: Float[np.ndarray, " m"],
    span: Int[np.ndarray, " m"],
    degree: int,
) -> Float[np.ndarray, "m d"]:
    """Compute the B-splines of a degree that are not zero in the knots' intervals `span`."""
    basis = np.zeros((len(at), degree + 1))
    basis[:, 0] = 1.0
    for d in range(1, degree + 1):
        saved = np.zeros(len(at))
        for j in range(d):
            right, left = knots[span + j + 1], knots[span + j + 1 - d]
            part = basis[:, j] / (right - left)
            basis[:, j] = saved + (right - at) * part
            saved = (at - left) * part
        basis[:, d] = saved
    return basis


def _differentiate_spline(
    knots: Float[np.ndarray, " t"], coefficients: Float[np.ndarray, "c k"], degree: int
) -> Float[np.ndarray, "c k"]:
    """Compute the coefficients of the derivative, one degree lower; each keeps its number."""
    count = len(coefficients)
    slopes = np.zeros_like(coefficients)
    lower = DEGREE - degree + 1
    width = knots[lower + degree : count + degree] - knots[lower:count]
    slopes[lower:] = degree * (coefficients[lower:] - coefficients[lower - 1 : -1]) / width[:, None]
    return slopes


@lru_cache(maxsize=4)
def _factorize_spline(n: int) -> tuple[Any, Any]:
    """Factorize the matrix of the B-splines at the rows, kept for signals of one length."""
    from scipy.linalg import lapack  # slow to import

    at, knots = np.arange(float(n)), _place_knots(n)
    span = _find_spans(knots, at)
    basis = _compute_basis(knots, at, span, DEGREE)
    bands = np.zeros((3 * DEGREE + 1, n), order="F")
    for j in range(DEGREE + 1):
        column = span - DEGREE + j
        bands[2 * DEGREE + np.arange(n) - column, column] = basis[:, j]
    factor: Any = lapack.dgbtrf
    lu, pivots, _ = factor(bands, DEGREE, DEGREE, overwrite_ab=1)
    return lu, pivots


def _solve_coefficients(n: int, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Solve for the coefficients of the spline that goes through the values."""
    from scipy.linalg import lapack  # slow to import

    lu, pivots = _factorize_spline(n)
    solve: Any = lapack.dgbtrs
    found: Float[np.ndarray, "n k"] = solve(lu, DEGREE, DEGREE, values, pivots)[0]
    return np.ascontiguousarray(found)
