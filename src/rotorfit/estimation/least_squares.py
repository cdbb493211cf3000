"""Ordinary least squares, and total least squares as Six et al. 2020 use it.

The equation numbers are those of Six, Briot, Erskine and Chriette, "Identification of the
Propeller Coefficients and Dynamic Parameters of a Hovering Quadrotor from Flight Data", ICRA 2020.
The standard deviations are shown as that paper defines them; they hold only if every entry of the
equations carried an independent error of one size, which flight data never do.
"""

from __future__ import annotations

import dataclasses
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import (
    Estimate,
    LinearProblem,
    ScaledSingular,
    problem_rows,
    refuse_free_direction,
    scaled_singular,
)
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float


def ordinary(problem: LinearProblem) -> Estimate:
    r"""Return :math:`\arg\min_\phi \sum_j w_j^2 |B_j(\theta(\phi)) Z^T|^2`."""
    rows = problem_rows(problem)
    f = len(problem.map.names)
    A, y = rows[:, :f], -rows[:, f]
    # Columns are scaled, so that the units of the parameters do not matter.
    svd = scaled_singular(A, problem.map.names)
    refuse_free_direction(svd, problem.map.names)
    phi = (svd.Vt.T @ ((svd.U.T @ y) / svd.s)) / svd.lengths
    residual = y - A @ phi
    # Weighted errors are taken as independent, of equal variance.
    variance = float(residual @ residual) / max(problem.rows - f, 1)
    return Estimate(
        names=problem.map.names,
        values=phi,
        covariance=variance * (svd.inverse_root @ svd.inverse_root.T),
        condition_number=svd.condition_number,
    )


@frozen_dataclass
class EssentialEstimate:
    """The essential parameters, and the removed ones in the order of their removal."""

    estimate: Estimate
    removed: tuple[str, ...]
    problem: LinearProblem


def total(problem: LinearProblem) -> Estimate:
    """Solve by total least squares (Six et al. 2020, eq. 14-22)."""
    Wt = problem_rows(problem)
    names = problem.map.names
    if Wt.shape[0] < Wt.shape[1]:
        raise EstimationError(
            f"{Wt.shape[0]} equations cannot determine {len(names)} parameters; "
            "give a longer flight"
        )
    svd = scaled_singular(Wt[:, :-1], names)
    refuse_free_direction(svd, names)
    U, s, Vt = np.linalg.svd(Wt, full_matrices=False)
    # The right singular vector of the smallest singular value, divided by its last entry. In the
    # units as given: total least squares is not invariant to them.
    v = Vt[-1]
    if abs(v[-1]) < 1e-12:
        raise EstimationError(
            "total least squares has no solution here: the flattest direction has no part along "
            "the weighed mass; remove the parameters that the flight does not excite"
        )
    chi = _refine_solution(Wt, svd, v[:-1] / v[-1])
    return Estimate(
        names=names,
        values=chi,
        covariance=_solution_covariance(problem.rows, chi, (U, s, Vt)),
        condition_number=svd.condition_number,
    )


def _refine_solution(
    Wt: Float[np.ndarray, "m g"], svd: ScaledSingular, chi: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " f"]:
    """Refine a solution by the digits that columns of very different size have cost."""
    A, y = Wt[:, :-1], Wt[:, -1]
    # In the coordinates V^T D chi of the scaled columns A = U S V^T D.
    backward = (svd.Vt / svd.lengths).T
    right = -svd.s * (svd.U.T @ y)
    for _ in range(2):
        residual = A @ chi + y
        # In SI units the columns differ by 1e7, and the singular vector is off by some 1e-7. The
        # solution obeys (A^T A - sigma^2 1) chi = -A^T y for Wt = [A y] and its smallest singular
        # value; sigma^2 is the Rayleigh quotient.
        square = float(residual @ residual) / (1.0 + float(chi @ chi))
        shifted = np.diag(svd.s**2) - square * (backward.T @ backward)
        chi = backward @ np.linalg.solve(shifted, right)
    return chi


def _solution_covariance(
    rows: int,
    chi: Float[np.ndarray, " f"],
    svd: tuple[Float[np.ndarray, "m g"], Float[np.ndarray, " g"], Float[np.ndarray, "g g"]],
) -> Float[np.ndarray, "f f"]:
    """Compute the covariance of Six et al. 2020, eq. 19 and 20."""
    U, s, Vt = svd
    n_t = len(s)
    sigma_W = s[-1] / np.sqrt(max(rows - n_t, 1))
    W_bar = ((U * s)[:, :-1] @ Vt[:-1])[:, :-1]
    lengths = np.linalg.norm(W_bar, axis=0)
    # Scaled columns: the same inverse, with the digits that SI units would cost it.
    _, s_bar, Vt_bar = np.linalg.svd(W_bar / lengths, full_matrices=False)
    root = (Vt_bar.T / s_bar) / lengths[:, None]
    return sigma_W**2 * (1.0 + float(chi @ chi)) * (root @ root.T)


def relative_std(estimate: Estimate) -> Float[np.ndarray, " f"]:
    """Return the relative standard deviations (Six et al. 2020, eq. 22), as fractions."""
    return estimate.std / np.abs(estimate.values)


def component_weights(problem: LinearProblem, estimate: Estimate) -> Float[np.ndarray, "c j"]:
    """Return the weights of Six et al. 2020, III-B: each wrench component over its error's std.

    One weight per component for all configurations, times what the problem already gave the
    configuration as a whole (the paper's k_w); components without weight stay without.
    """
    theta = problem.map.theta(estimate.values)
    used = problem.weights != 0
    squares = np.zeros(problem.weights.shape)
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        B = np.einsum("pjz,p->jz", tensor, theta[c])
        squares[c] = np.sum((B @ factors.total.T) ** 2, axis=1)
    counts = np.array([int(part.rows.sum()) for part in problem.factors])
    samples = used.T @ counts
    std = np.sqrt(np.where(used, squares, 0.0).sum(axis=0) / np.maximum(samples, 1))
    if (std[used.any(axis=0)] == 0).any():
        # An exact flight leaves no error to weigh by.
        return problem.weights
    return np.where(used, problem.weights / np.where(std > 0, std, 1.0), 0.0)


def weighted_total(problem: LinearProblem) -> tuple[Estimate, LinearProblem]:
    """Return the solution with component weights from one unweighted pass, and its problem."""
    flat = dataclasses.replace(problem, weights=(problem.weights != 0).astype(float))
    # The paper does not say by which estimator. Ordinary least squares: unweighted total least
    # squares has two nearly equal smallest singular values and may fall into the yaw rows' own.
    weights = component_weights(problem, ordinary(flat))
    weighted = dataclasses.replace(problem, weights=weights)
    return total(weighted), weighted


def essential_total(problem: LinearProblem, *, r_sigma: float) -> EssentialEstimate:
    """Return the essential parameters (Six et al. 2020, III-B).

    The parameter with the largest relative standard deviation is taken out and the rest solved
    again, until largest over smallest is below `r_sigma`.
    """
    removed: list[str] = []
    estimate, weighted = weighted_total(problem)
    while len(estimate.names) > 1:
        relative = relative_std(estimate)
        if relative.max() < r_sigma * relative.min():
            break
        worst = estimate.names[int(np.argmax(relative))]
        removed.append(worst)
        problem = dataclasses.replace(problem, map=problem.map.without(worst))
        estimate, weighted = weighted_total(problem)
    return EssentialEstimate(estimate=estimate, removed=tuple(removed), problem=weighted)


def nonnegative_solution(
    products: Float[np.ndarray, "k k"], right: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    r"""Return :math:`\arg\min_{x \geq 0} |A x - y|^2` for the few columns of A.

    `products`, `right`: A^T A and A^T y. Every choice of columns is tried: of those whose solution
    has no negative entry the one that explains most is the minimum.
    """
    best, most = np.zeros(len(right)), 0.0
    for count in range(1, len(right) + 1):
        for chosen in map(list, combinations(range(len(right)), count)):
            found = np.linalg.lstsq(products[np.ix_(chosen, chosen)], right[chosen])[0]
            explained = float(found @ right[chosen])
            if explained > most and (found >= 0.0).all():
                best, most = np.zeros(len(right)), explained
                best[chosen] = found
    return best
