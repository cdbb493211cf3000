"""What a part of the blocks says against the whole: one Gauss-Newton step, no second fit.

Two estimates that share their data do not scatter independently. The variance of their difference
is taken from what each block pulls it by (one-step jackknife), and is at least the difference of
the two covariances (Hausman, Econometrica 46(6), 1978), which is what the formal noise alone makes.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

from rotorfit.estimation.banded import BandedEstimate, normal_equations, parameter_scale
from rotorfit.estimation.reweighted import scatter_covariance

UNDETERMINED = 1e-10
"""Eigenvalue of the unit-diagonal information under which a direction counts as lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """By how much numbers move, and how much of that chance explains.

    Attributes
    ----------
    values, covariance
        Of the shift.
    """

    values: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "q q"]

    @property
    def std(self) -> Float[np.ndarray, " q"]:
        """Standard deviation of each shift that chance alone makes."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))


def left_out(fit: BandedEstimate, blocks: Bool[np.ndarray, " b"]) -> Shift:
    """Return how the free parameters move when some blocks are left out.

    Parameters
    ----------
    fit
        Of all blocks.
    blocks
        True for those to leave out.
    """
    whole = normal_equations(fit, np.ones_like(blocks))
    rest = normal_equations(fit, ~blocks)
    scale = parameter_scale(whole.information)
    inverse, inverse_rest = _inverse(whole.information, scale), _inverse(rest.information, scale)
    influence = (rest.scores @ inverse_rest - whole.scores @ inverse)[:-1]
    formal = inverse_rest - inverse
    return Shift(
        values=rest.scores.sum(axis=0) @ inverse_rest,
        covariance=_at_least(_scatter(influence[blocks]) + _scatter(influence[~blocks]), formal),
    )


def _scatter(influence: Float[np.ndarray, "b f"]) -> Float[np.ndarray, "f f"]:
    """Return the covariance that the scatter within a group of blocks makes (jackknife).

    About their mean: what the two groups differ by is the shift, not chance.
    """
    if len(influence) < 2:
        return influence.T @ influence
    return scatter_covariance(influence)


def _inverse(
    H: Float[np.ndarray, "f f"], scale: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "f f"]:
    """Return the inverse, in which directions that the equations lost are infinitely uncertain."""
    values, vectors = scipy.linalg.eigh(H / np.outer(scale, scale))
    values = np.maximum(values, UNDETERMINED)
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def _at_least(
    covariance: Float[np.ndarray, "q q"], floor: Float[np.ndarray, "q q"]
) -> Float[np.ndarray, "q q"]:
    """Return the covariance, scaled up where its variances are under those of the floor."""
    variance = np.maximum(np.diagonal(covariance), np.finfo(float).tiny)
    factor = np.sqrt(np.maximum(np.diagonal(floor) / variance, 1.0))
    return covariance * np.outer(factor, factor)
