r"""Added covariance of an estimate from estimating the correlation between its errors.

The shares C of `BandedProblem.error_correlation` are found beforehand and then held. Error t
without its correlated part is :math:`e_t - C_{ts} e_s`, linear in C: each share is one parameter
more, with the other errors for its regressors. With the information H of the free parameters, D of
the shares (with what is known of them beforehand) and B between them, the covariance of the
parameters, :math:`H^{-1}`, grows by
:math:`H^{-1} B (D - B^T H^{-1} B)^{-1} B^T H^{-1}` (block inverse).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded_equations import decorrelated_solutions, lifted_slopes
from rotorfit.estimation.banded_problem import solutions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate

LEAST_LEFT: Final = 1e-9
"""Least information left on a share: below it the parameters explain all that it does."""


def error_correlation_shifts(fit: BandedEstimate) -> Float[np.ndarray, "n f"]:
    """Compute the parameters' shifts by independent deviations of the correlation's shares."""
    problem, covariance = fit.problem, fit.estimate.covariance
    shifts = [np.zeros((0, len(covariance)))]
    if any(shares.any() for shares in problem.error_correlation):
        found = decorrelated_solutions(problem, solutions(problem, fit.estimate.values))
        slopes = lifted_slopes(problem, fit.estimate.values, found)
        for c, shares in enumerate(problem.error_correlation):
            for t in np.flatnonzero(shares.any(axis=1)).tolist():
                between, own = _share_information(fit, slopes, c, t)
                # What is known of the shares beforehand: they are about zero.
                own += np.eye(len(own)) / problem.error_correlation_std[c] ** 2
                moved = between @ covariance
                values, vectors = np.linalg.eigh(own - moved @ between.T)
                # What the parameters explain just as well is open in their covariance already.
                left = values > LEAST_LEFT * float(np.diagonal(own).max())
                shifts.append((vectors[:, left] / np.sqrt(values[left])).T @ moved)
    return np.concatenate(shifts)


def _share_information(
    fit: BandedEstimate, slopes: Sequence[Float[np.ndarray, "k a _"]], c: int, t: int
) -> tuple[Float[np.ndarray, "s f"], Float[np.ndarray, "s s"]]:
    """Compute the information between error t's shares and the parameters, and of the shares."""
    problem = fit.problem
    others = np.flatnonzero(problem.error_correlation[c][t])
    between = np.zeros((len(others), len(problem.map.names)))
    own = np.zeros((len(others), len(others)))
    for part, dU in zip(problem.every_part, slopes, strict=True):
        if part.configuration == c:
            columns = problem.factors[c].columns[part.local]
            errors = fit.residual[part.blocks][:, :, others]
            weighed = errors.transpose(0, 2, 1) / fit.variance[part.blocks, t, None, None]
            own += (weighed @ errors).sum(axis=0)
            between[:, part.moved] += (weighed @ columns).sum(axis=0) @ dU[t]
    return between, own
