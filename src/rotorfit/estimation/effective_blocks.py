r"""The effective number of independent blocks behind each number of a fit.

The variance that the scatter of blocks shows is a sum of squares, one of each block. Where a number
g(phi) comes from a few of them it is known as badly as from so few: with the share :math:`w_b =
\nabla g^T C H_b C \nabla g` of block b (H_b its information, C the covariance of the fit) it has
:math:`(\sum w_b)^2 / \sum w_b^2` degrees of freedom (Satterthwaite, Biometrics Bulletin 2, 1946;
Bell and McCaffrey, Survey Methodology 28, 2002).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.banded_equations import decorrelated_solutions, lifted_slopes
from rotorfit.estimation.banded_problem import solutions
from rotorfit.estimation.distributions import student_quantile
from rotorfit.estimation.reweighted import scatter_covariance

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate


def effective_blocks(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> Float[np.ndarray, " q"]:
    """Count the effective blocks of each number; all blocks where none is informative.

    `fit`: of all flights. `jacobian`: of the numbers by the free parameters.
    """
    return effective_count(variance_shares(fit, jacobian))


def effective_count(shares: Float[np.ndarray, "b q"]) -> Float[np.ndarray, " q"]:
    """Count the effective blocks by their shares of each variance; all blocks where all are 0."""
    total, squares = shares.sum(axis=0), (shares**2).sum(axis=0)
    every = np.full(len(total), float(len(shares)))
    return np.divide(total**2, squares, out=every, where=squares > 0.0)


def variance_shares(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> Float[np.ndarray, "b q"]:
    """Compute each block's share of the numbers' formal variances."""
    problem, moved = fit.problem, fit.estimate.covariance @ jacobian.T
    found = decorrelated_solutions(problem, solutions(problem, fit.estimate.values))
    slopes = lifted_slopes(problem, fit.estimate.values, found)
    shares = np.zeros((len(fit.variance), len(jacobian)))
    for part, dU in zip(problem.every_part, slopes, strict=True):
        columns = problem.factors[part.configuration].columns[part.local]
        for error, slope in enumerate(dU):
            rows = columns @ (slope @ moved[part.moved])
            power = np.einsum("bmq,bmq->bq", rows, rows)
            shares[part.blocks] += power / fit.variance[part.blocks, error, None]
    return shares


def free_blocks(fit: BandedEstimate) -> float:
    """Count the free blocks: as many parameters as noisy signals cost one block."""
    return max(len(fit.influence) - len(fit.estimate.names) / fit.variance.shape[1], 1.0)


def half_width_of_parameter(fit: BandedEstimate, name: str) -> float:
    """Compute the half-width of one parameter by the scatter of its informative blocks alone."""
    one = np.eye(len(fit.estimate.names))[[fit.estimate.names.index(name)]]
    variance, degrees = own_scatter(fit, one)
    return float(student_quantile(0.975, degrees[0]) * np.sqrt(variance[0]))


def own_scatter(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Compute each number's variance by the scatter of its blocks, and their effective number."""
    blocks, free = len(fit.influence), free_blocks(fit)
    # The parameters take some of the scatter with them: unbiased by n over the free blocks.
    variance = np.diagonal(jacobian @ scatter_covariance(fit.influence) @ jacobian.T)
    return variance * blocks / free, np.minimum(effective_blocks(fit, jacobian), free)
