"""The nearest point at which a matrix, linear in the parameters, is positive semidefinite."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

SMALLEST_EIGENVALUE = 1e-7
"""Smallest eigenvalue of the matrix scaled to unit size: the nearest point lies that far inside, so
that a program that demands strict inequality accepts it too."""


@frozen_dataclass
class Nearest:
    """A point that keeps the constraint.

    - `distance`: to the given one, in standard deviations: sqrt((x - x_hat)^T C^-1 (x - x_hat)).
    """

    values: Float[np.ndarray, " q"]
    distance: float


def nearest_consistent(
    values: Float[np.ndarray, " q"],
    covariance: Float[np.ndarray, "q q"],
    matrix: tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "q n n"]],
) -> Nearest:
    r"""Find the x nearest to `values` with :math:`M_0 + \sum x_i M_i` positive semidefinite.

    Minimises :math:`(x - \hat x)^T C^{-1} (x - \hat x)`: a quadratic programme over the cone of
    semidefinite matrices (Wensing, Kim and Slotine 2017 for the inertia of bodies). `matrix`: M_0
    and the M_i. Needs Clarabel (the extra ``physical``).
    """
    constant, slopes = matrix
    std = np.sqrt(np.diagonal(covariance))
    if not (np.isfinite(std).all() and (std > 0).all()):
        raise EstimationError("the nearest consistent point needs a deviation of every parameter")
    scale = np.sqrt(np.abs(np.diagonal(constant + np.einsum("q,qij->ij", values, slopes))))
    # Scaling rows and columns alike keeps a matrix semidefinite; in SI kg m^2 stand beside kg.
    unit = np.outer(*[np.where(scale > 0, scale, 1.0)] * 2)
    at = (constant + np.einsum("q,qij->ij", values, slopes)) / unit
    at -= SMALLEST_EIGENVALUE * np.eye(len(at))
    if np.linalg.eigvalsh(at)[0] >= 0.0:
        return Nearest(values=values, distance=0.0)
    information = np.linalg.inv(covariance / np.outer(std, std))
    step = _solve_semidefinite(information, at, slopes / unit * std[:, None, None])
    return Nearest(values=values + std * step, distance=float(np.sqrt(step @ information @ step)))


def _solve_semidefinite(
    information: Float[np.ndarray, "q q"],
    at: Float[np.ndarray, "n n"],
    slopes: Float[np.ndarray, "q n n"],
) -> Float[np.ndarray, " q"]:
    """Solve for the shortest step d in the metric with at + sum d_i slopes_i semidefinite."""
    try:
        clarabel: Any = import_module("clarabel")
    except ImportError as error:
        raise EstimationError(
            'the nearest consistent inertia needs Clarabel: pip install "rotorfit[physical]"'
        ) from error
    from scipy import sparse

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(information)),
        np.zeros(len(information)),
        sparse.csc_matrix(-np.array([_stack_triangle(m) for m in slopes]).T),
        _stack_triangle(at),
        [clarabel.PSDTriangleConeT(len(at))],
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise EstimationError(f"no consistent point was found (Clarabel: {solution.status})")
    return np.array(solution.x)


def _stack_triangle(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " t"]:
    """Stack the upper triangle column by column, off-diagonals times sqrt(2)."""
    n = len(matrix)
    return np.array(
        [matrix[i, j] * (1.0 if i == j else np.sqrt(2.0)) for j in range(n) for i in range(j + 1)]
    )
