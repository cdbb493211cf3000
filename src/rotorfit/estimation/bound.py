r"""The Cramér-Rao bound of the banded likelihood.

With noise variances v known, the likelihood of :math:`e = M(\theta)^{-1} B(\theta) z` has the
information :math:`\sum_b \sum_k J_{bk}^T J_{bk} / v_{bk}`, J = de/d phi. Nothing in it needs noisy
data: on exact signals of a flight that was only imagined, it says how well the flight would
determine the parameters. Informations of several flights add.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.estimation.parameter_map import ParameterMap


@frozen_dataclass
class Linearised:
    """The noisy signals' error of one configuration, linearised in the free parameters.

    - `error`: e = error z.
    - `slope`: d error / d phi.
    - `of_residual`: e = of_residual r for a residual r of the equations.
    """

    error: Float[np.ndarray, "k z"]
    slope: Float[np.ndarray, "f k z"]
    of_residual: Float[np.ndarray, "k j"]


def linearised(
    tensor: Float[np.ndarray, "p j z"],
    mapped: ParameterMap,
    phi: Float[np.ndarray, " f"],
    *,
    configuration: int,
    noisy: Sequence[int],
) -> Linearised:
    """Linearise the error: d(M^-1 B) = M^-1 (dB - dM M^-1 B)."""
    theta, dtheta = mapped.theta(phi)[configuration], mapped.jacobian(phi)[configuration]
    B: Float[np.ndarray, "k z"] = np.einsum("p,pjz->jz", theta, tensor)
    # M has the columns of the noisy signals.
    inverse: Float[np.ndarray, "k j"] = np.linalg.inv(B[:, list(noisy)])
    G: Float[np.ndarray, "k z"] = inverse @ B
    dB = np.einsum("pjz,pf->fjz", tensor, dtheta)
    return Linearised(
        error=G, slope=inverse @ (dB - dB[:, :, list(noisy)] @ G), of_residual=inverse
    )


def information(
    model: Linearised, factors: Factors, variance: Float[np.ndarray, "b k"]
) -> Float[np.ndarray, "f f"]:
    """Compute the information of exact signals, for error variances per row of each block."""
    weighted = _weighted_grams(factors, variance)
    return np.einsum("fkz,kzy,gky->fg", model.slope, weighted, model.slope, optimize=True)


def score(
    model: Linearised, factors: Factors, variance: Float[np.ndarray, "b k"]
) -> Float[np.ndarray, " f"]:
    """Compute J^T e / v where the signals do not fit: information^-1 score is minus the shift."""
    weighted = _weighted_grams(factors, variance)
    return np.einsum("fkz,kzy,ky->f", model.slope, weighted, model.error, optimize=True)


def _weighted_grams(
    factors: Factors, variance: Float[np.ndarray, "b k"]
) -> Float[np.ndarray, "k z z"]:
    """Compute sum_b R_b^T R_b / v_bk."""
    return np.einsum("bmz,bk,bmy->kzy", factors.R, 1.0 / variance, factors.R, optimize=True)
