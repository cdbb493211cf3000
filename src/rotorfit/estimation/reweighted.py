"""Least squares of equations solved for their noisiest signal, weighted band by band.

The equations must be normalised: the known column (the constant of the parameter map) is the
signal that carries the noise, with a known coefficient, such as m times the specific force or one
times an angular acceleration. Then the residual is that signal's own error, its variance per band
can be estimated from the residuals, and weighting by it does not bias the estimate towards zero,
as it does for homogeneous equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import Estimate, LinearProblem, equation_rows, scaled_singular
from rotorfit.estimation.factors import SMALLEST_PIVOT, borrowed_mean_square
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float, Int

MOST_ITERATIONS = 50
SMALLEST_STEP = 0.01
"""The iteration ends when no parameter moves by more than this share of its deviation."""
RELATIVE_FLOOR = 1e-20
"""Smallest variance of a band, relative to the known signal's: a simulation may be exact."""


@frozen_dataclass
class BandedFit:
    """An estimate, and the influence of each block of the factors on it.

    - `estimate`: covariance from the bands' own variances.
    - `influence`: of each block on each parameter: the first-order change if it were counted twice.
    - `variance`: of one residual in each block.
    - `known_power`, `residual_power`: sums of squares of known signal and residual, by block.
    - `log_likelihood`: of the normal distribution, up to a constant; to compare delays and models.
    - `information`: of each block on the parameters, without the prior's.
    """

    estimate: Estimate
    influence: Float[np.ndarray, "b f"]
    variance: Float[np.ndarray, " b"]
    known_power: Float[np.ndarray, " b"]
    residual_power: Float[np.ndarray, " b"]
    log_likelihood: float
    information: Float[np.ndarray, "b f f"]


def reweighted(
    problem: LinearProblem, *, prior_std: Mapping[str, float] | None = None
) -> BandedFit:
    """Iterate the estimate until its band weights agree with its own residuals."""
    J, y, rows = _block_equations(problem)
    names = problem.map.names
    information = _prior_information(names, prior_std or {})
    known = np.einsum("bm,bm->b", y, y)
    if not known.sum() > 0.0:
        raise EstimationError(
            "about one axis the gyro shows no turn at all: in these seconds the vehicle stands "
            "still, or the log lacks that axis; give seconds in which it flies"
        )
    floor = RELATIVE_FLOOR * float(known.sum() / rows.sum()) + np.finfo(float).tiny
    variance = np.full(len(rows), float(known.sum() / rows.sum()))
    phi = np.zeros(len(names))
    covariance = np.zeros((len(names), len(names)))
    residual = y
    flat = J.reshape(-1, J.shape[2])
    gram, right = J.transpose(0, 2, 1) @ J, (y[:, None] @ J)[:, 0]
    for _ in range(MOST_ITERATIONS):
        before = phi
        covariance = _quick_covariance(gram, variance, information)
        if covariance is None:
            phi, covariance = _weighted_solution(J, y, variance, information)
        else:
            phi = covariance @ ((1.0 / variance) @ right)
            # Once more for what is left: of exact simulations squares alone lose digits.
            left = ((y - J @ phi) / variance[:, None]).reshape(-1) @ flat
            phi = phi + covariance @ (left - information * phi)
        residual = y - J @ phi
        power = np.einsum("bm,bm->b", residual, residual)
        mean_square = borrowed_mean_square(power[:, None], problem.factors[0])[:, 0]
        variance = np.maximum(mean_square / np.count_nonzero(problem.weights[0]), floor)
        if np.all(np.abs(phi - before) <= SMALLEST_STEP * np.sqrt(np.diagonal(covariance))):
            break
    A, _ = _weighted_equations(J, y, variance, information)
    few: Float[np.ndarray, "r f"] = np.asarray(np.linalg.qr(A, mode="r"))  # and as singular
    svd = scaled_singular(few, names)
    scores = (residual[:, None] @ J)[:, 0] / variance[:, None]
    return BandedFit(
        estimate=Estimate(
            names=names,
            values=phi,
            covariance=covariance,
            condition_number=svd.condition_number,
        ),
        influence=scores @ covariance,
        variance=variance,
        known_power=known,
        residual_power=np.einsum("bm,bm->b", residual, residual),
        log_likelihood=float(-0.5 * np.sum(rows * np.log(variance))),
        information=gram / variance[:, None, None],
    )


def _block_equations(
    problem: LinearProblem,
) -> tuple[Float[np.ndarray, "b m f"], Float[np.ndarray, "b m"], Int[np.ndarray, " b"]]:
    """Return each block's regressors, known signal (negated), and number of scalar equations."""
    if len(problem.factors) != 1:
        raise EstimationError(f"one configuration at a time, not {len(problem.factors)}")
    f = len(problem.map.names)
    weights = problem.weights[0]
    known = (problem.map.constant[0], problem.map.matrix[0])
    stacked = equation_rows(problem.factors[0].R, problem.tensors[0], known, weights)
    count = problem.factors[0].rows * int(np.count_nonzero(weights))
    return np.ascontiguousarray(stacked[:, :, :f]), -stacked[:, :, f], count


def _prior_information(
    names: tuple[str, ...], prior_std: Mapping[str, float]
) -> Float[np.ndarray, " f"]:
    return np.array([prior_std[n] ** -2.0 if n in prior_std else 0.0 for n in names])


def _quick_covariance(
    gram: Float[np.ndarray, "b f f"],
    variance: Float[np.ndarray, " b"],
    information: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "f f"] | None:
    """Compute the covariance from the blocks' Gram matrices; None if that would cost digits."""
    whole = np.tensordot(1.0 / variance, gram, axes=1) + np.diag(information)
    lengths = np.sqrt(np.diagonal(whole))
    if not (lengths > 0.0).all():
        return None
    try:
        lower = np.linalg.cholesky(whole / np.outer(lengths, lengths))
    except np.linalg.LinAlgError:
        return None
    if np.diagonal(lower).min() < SMALLEST_PIVOT:
        return None
    root = np.linalg.inv(lower) / lengths
    covariance: Float[np.ndarray, "f f"] = root.T @ root
    return covariance


def _weighted_solution(
    J: Float[np.ndarray, "b m f"],
    y: Float[np.ndarray, "b m"],
    variance: Float[np.ndarray, " b"],
    information: Float[np.ndarray, " f"],
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "f f"]]:
    """Return the solution and its covariance for given band variances."""
    import scipy.linalg  # slow to import

    f = J.shape[2]
    A, b = _weighted_equations(J, y, variance, information)
    lengths = np.linalg.norm(A, axis=0)
    if (lengths == 0).any():
        raise EstimationError("the flight does not move a parameter of this equation at all")
    # QR of the equations, not their normal equations: exact simulations keep their digits.
    Q, R = scipy.linalg.qr(A / lengths, mode="economic")
    inverse = scipy.linalg.solve_triangular(R, np.eye(f)) / lengths[:, None]
    return inverse @ (Q.T @ b), inverse @ inverse.T


def _weighted_equations(
    J: Float[np.ndarray, "b m f"],
    y: Float[np.ndarray, "b m"],
    variance: Float[np.ndarray, " b"],
    information: Float[np.ndarray, " f"],
) -> tuple[Float[np.ndarray, "n f"], Float[np.ndarray, " n"]]:
    """Return the equations over their deviations, the prior's below them."""
    f = J.shape[2]
    weight = 1.0 / np.sqrt(variance)
    A = np.concatenate([(J * weight[:, None, None]).reshape(-1, f), np.diag(np.sqrt(information))])
    return A, np.concatenate([(y * weight[:, None]).reshape(-1), np.zeros(f)])


def scatter_covariance(influence: Float[np.ndarray, "b f"]) -> Float[np.ndarray, "f f"]:
    """Compute the covariance by the blocks' own scatter (the one-step jackknife).

    The influences of several fits to the same blocks may stand side by side: the result then has
    the covariance between the fits.
    """
    b = len(influence)
    if b < 2:
        raise EstimationError("one block has no scatter: a longer flight is needed")
    centred = influence - influence.mean(axis=0)
    return centred.T @ centred * (b / (b - 1.0))
