"""Estimate errors of a declaration, additional to the parameters of a fit.

A check that compares the declared vehicle with another one is an estimate: how far along the way
from the one to the other the flights are, and with what deviation. Whatever else moves the residual
(products of inertia, unlike rotors, the autopilot's response to gusts) is in the model that
it is estimated with, and its deviation is that of every other number: the larger of what the fit
states and what its blocks and phases show, with what is assumed of autopilot and motors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import BandedEstimate, banded, response_sensitivity
from rotorfit.estimation.distributions import f_quantile
from rotorfit.estimation.error_correlation import error_correlation_shifts
from rotorfit.fit.intervals.joint_numbers import (
    formal_covariance,
    random_half_width,
    timing_shifts,
)
from rotorfit.fit.joint.added_parameters import Added as Added
from rotorfit.fit.joint.added_parameters import with_added
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.fit.joint.joint_problem import JointConfiguration

CLOSE: Final = 0.01
"""Convergence tolerance of such an estimate, in standard deviations of a parameter."""
FEWEST_BLOCKS: Final = 2.0


@frozen_dataclass
class Additional:
    """Estimates of parameters additional to the parameters of a fit.

    - `values`, `covariance`: of the added parameters.
    - `blocks`: effective number of independent ones: degrees of freedom of their covariance.
    - `estimate`: of all parameters, the added ones last.
    """

    values: Float[np.ndarray, " a"]
    covariance: Float[np.ndarray, "a a"]
    blocks: float
    estimate: BandedEstimate

    @property
    def std(self) -> Float[np.ndarray, " a"]:
        """Deviations of the added parameters."""
        return np.sqrt(np.diagonal(self.covariance))


def estimate_additional(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    added: Sequence[Added],
    *,
    instead_of: Sequence[str] = (),
) -> Additional:
    """Estimate additional parameters of a fit, linearised at its estimate.

    `fit`: of the configurations. `configurations`: with what counts of them. `added`: the
    parameters. `instead_of`: free parameters that are left out for them.

    Raises `EstimationError` if the flights do not determine them.
    """
    problem = with_added(fit.problem, added, instead_of)
    known = fit.estimate.by_name | {one.name: one.begin for one in added}
    start = np.array([known[name] for name in problem.map.names])
    found = banded(problem, start, close=CLOSE)
    chosen = np.eye(len(added), len(start), k=len(start) - len(added))
    return Additional(
        values=found.estimate.values[-len(added) :],
        covariance=_additional_covariance(found, configurations, chosen),
        blocks=_effective_blocks(found.influence @ chosen.T),
        estimate=found,
    )


def _additional_covariance(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    chosen: Float[np.ndarray, "a f"],
) -> Float[np.ndarray, "a a"]:
    """Compute the covariance of some parameters, by chance and by what is assumed."""
    # Along the axes of the fit's own covariance: what one direction scatters must not widen
    # another, of which the flights have a thousand times more information.
    strength, Q = np.linalg.eigh(formal_covariance(fit, chosen))
    axes = Q.T @ chosen
    shown = random_half_width(fit, axes, np.diag(strength)) / 1.96
    formal = (Q * np.maximum(shown**2, strength)) @ Q.T
    names = len(fit.estimate.names)
    timing = np.reshape(timing_shifts(fit, configurations[0].timing), (-1, names))
    assumed = np.vstack([response_sensitivity(fit) / 1.96, timing, error_correlation_shifts(fit)])
    shifts = assumed @ chosen.T
    covariance: Float[np.ndarray, "a a"] = formal + shifts.T @ shifts
    return covariance


def _effective_blocks(influence: Float[np.ndarray, "b a"]) -> float:
    """Count the effective blocks of some parameters: as many equal blocks would scatter as much."""
    if not np.isfinite(influence).all():
        raise EstimationError("the flights do not determine the additional parameters")
    whole = np.linalg.pinv(influence.T @ influence, hermitian=True, rcond=1e-12)
    shares = np.einsum("bi,ij,bj->b", influence, whole, influence)
    # Satterthwaite's (sum v)^2 / sum v^2 of their shares v of the variance. The squared size of an
    # influence is v times a chi-square of as many degrees as there are parameters, n, whose mean
    # square is (1 + 2 / n) n^2 v^2.
    count = (1.0 + 2.0 / influence.shape[1]) * float(shares.sum() ** 2 / (shares @ shares))
    return float(np.clip(count, FEWEST_BLOCKS, max(len(influence), FEWEST_BLOCKS)))


def log_likelihood_loss(square: float, blocks: float, dimensions: int = 1) -> float:
    """Compute the log-likelihood that a squared distance costs."""
    # Of Student's t: where few blocks show the covariance, a large distance costs little.
    return 0.5 * (blocks + dimensions) * float(np.log1p(max(square, 0.0) / blocks))


def inside(square: float, blocks: float, dimensions: int) -> bool:
    """Test whether chance explains a squared distance, at 1 %."""
    # By Fisher's F, not by chi-square: few blocks show the covariance itself.
    return square <= dimensions * f_quantile(0.99, dimensions, blocks)


def gained(one: BandedEstimate, other: BandedEstimate) -> float:
    """Compute the gain of log-likelihood of another fit of the same blocks."""
    # Over the errors that count in either, each with the variance that it has there.
    counts = np.isfinite(one.variance) | np.isfinite(other.variance)
    rows = np.concatenate([factors.rows for factors in one.problem.factors])[:, None]
    floors = np.repeat(one.problem.floors, [len(f) for f in one.problem.factors], axis=0)
    left = [np.log(np.maximum(e.residual_power / rows, floors)) for e in (one, other)]
    return 0.5 * float((rows * (left[0] - left[1]))[counts].sum())
