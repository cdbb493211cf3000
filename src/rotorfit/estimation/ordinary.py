"""Ordinary least squares on triangular factors, with block-robust covariance."""

import dataclasses

import numpy as np
from jaxtyping import Float

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import (
    Estimate,
    LinearProblem,
    equation_rows,
    problem_rows,
    refuse_free_direction,
    scaled_singular,
)


def ordinary(problem: LinearProblem) -> Estimate:
    r"""Return :math:`\arg\min_\phi \sum_j w_j^2 |B_j(\theta(\phi)) Z^T|^2`.

    Solved by singular values of the column-scaled equations, so that the units of the parameters
    do not matter. The covariance takes the equations' errors as independent and of equal variance
    once weighted; `block_covariance` does not.

    Raises
    ------
    EstimationError
        If the equations do not determine the parameters to more than rounding.
    """
    rows = problem_rows(problem)
    f = len(problem.map.names)
    A, y = rows[:, :f], -rows[:, f]
    svd = scaled_singular(A, problem.map.names)
    refuse_free_direction(svd, problem.map.names)
    phi = (svd.Vt.T @ ((svd.U.T @ y) / svd.s)) / svd.lengths
    residual = y - A @ phi
    variance = float(residual @ residual) / max(problem.rows - f, 1)
    return Estimate(
        names=problem.map.names,
        values=phi,
        covariance=variance * (svd.inverse_root @ svd.inverse_root.T),
        condition_number=svd.condition_number,
        weak_directions=svd.Vt[::-1][:3],
        weak_strengths=(svd.s[::-1] / svd.s[0])[:3],
    )


def block_scores(
    problem: LinearProblem, phi: Float[np.ndarray, " f"]
) -> tuple[Float[np.ndarray, "b f"], Float[np.ndarray, "b f f"]]:
    """Return each block's gradient J^T e and its information J^T J at `phi`.

    Blocks of all configurations, one after the other; both weighted.
    """
    f = len(phi)
    scores: list[Float[np.ndarray, "b f"]] = []
    information: list[Float[np.ndarray, "b f f"]] = []
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        rows = equation_rows(
            factors.R,
            tensor,
            (problem.map.constant[c], problem.map.matrix[c]),
            problem.weights[c],
        )
        J = rows[:, :, :f]
        e = rows[:, :, f] + J @ phi
        scores.append(np.einsum("bmf,bm->bf", J, e))
        information.append(np.matmul(J.transpose(0, 2, 1), J))
    return np.concatenate(scores), np.concatenate(information)


def block_covariance(problem: LinearProblem, estimate: Estimate) -> Estimate:
    r"""Return the estimate with a covariance that needs no independence within a block.

    The sandwich :math:`H^{-1} (\sum_b g_b g_b^T) H^{-1} b/(b-1)` over the blocks of the factors:
    errors may be coloured and correlated between equations as long as blocks are longer than
    their memory.
    """
    scores, _ = block_scores(problem, estimate.values)
    b = len(scores)
    if b < 2:
        raise EstimationError("one block has no scatter: give at least two blocks of data")
    # H^-1 from the singular values of the equations: forming H would square their condition.
    root = scaled_singular(problem_rows(problem)[:, :-1], problem.map.names).inverse_root
    spread = root @ (root.T @ scores.T)
    covariance = spread @ spread.T * (b / (b - 1))
    return dataclasses.replace(estimate, covariance=covariance)
