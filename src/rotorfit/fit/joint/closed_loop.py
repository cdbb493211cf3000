r"""Estimate from all flights of a vehicle how far its autopilot responds to disturbances.

What a response adds to the score of a flight goes with its rows, its information with rows
times rho. So a response that is taken too small biases flights by 1 / rho, each as flown, and
flights of different rho show by how much: with the score :math:`s_k` of flight k at the joint fit,
its information :math:`H_k`, and :math:`G_k` what a response would add to it,

.. math:: s_k = H_k \Delta - G_k \delta + n_k, \quad n_k \sim N(0, H_k),

weighed regression gives :math:`\delta` for roll, pitch, yaw and climb: one of all flights, whose
autopilot is the same. Its deviation is that of the flights' scatter about it
(cluster-robust: White, Econometrica 48, 1980; Liang and Zeger, Biometrika 73, 1986).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded import (
    BandedEstimate,
    parameter_scale,
    part_equations,
    pseudo_inverse,
)
from rotorfit.estimation.banded_equations import feedback_scores
from rotorfit.estimation.banded_problem import solutions
from rotorfit.estimation.distributions import student_quantile
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

BEFORE: Final = 1.0 / 1.96
"""Deviation of a response from the nominal one, before the flights: nothing or twice it
are the ends of the interval."""
UNIDENTIFIABLE: Final = 100.0
"""Deviation of a parameter that no flight determines."""
LEAST_OPEN: Final = np.array([1.0, 1.0, 0.5, 1.0])
"""Of that interval, for roll, pitch, yaw and climb, which no number of flights closes: how a
response goes with frequency is assumed, and the scale of yaw depends on that of pitch."""


@frozen_dataclass
class ClosedLoopResponse:
    """An autopilot's response to roll, pitch, yaw and climb errors, over the nominal one.

    - `beyond`: how much more than the nominal one.
    - `open`: half of its 95 % interval; 1 before the flights.
    """

    beyond: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    open: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)


NOMINAL_RESPONSE: Final = ClosedLoopResponse()
"""The response that is assumed of few flights."""


def estimated_response(fit: BandedEstimate) -> ClosedLoopResponse:
    """Estimate the response that the flights show together.

    `fit`: of all flights, each with factors of its own, made with the nominal response.
    """
    return response_from_scores(*_flight_scores(fit))


def response_from_scores(
    H: Float[np.ndarray, "m f f"],
    s: Float[np.ndarray, "m f"],
    G: Float[np.ndarray, "m f e"],
    prior: Float[np.ndarray, "f f"],
) -> ClosedLoopResponse:
    """Estimate the response from the informations and scores of the flights.

    `H`, `s`: information and score of each flight at the joint fit. `G`: what a response to each
    error adds to the score. `prior`: information before the flights.
    """
    flights, f, e = G.shape
    X = np.concatenate([H, -G], axis=2)
    weighed = X.transpose(0, 2, 1) @ np.array([pseudo_inverse(h + prior / flights) for h in H])
    information = (weighed @ X).sum(axis=0)
    information[:f, :f] += prior
    information[f:, f:] += np.eye(e) / UNIDENTIFIABLE**2
    covariance = pseudo_inverse(information)
    # The prior's own score is the rest of all scores: they sum to nothing.
    prior_score = np.concatenate([-s.sum(axis=0), np.zeros(e)])
    found = covariance @ (np.einsum("kif,kf->i", weighed, s) + prior_score)
    left = s - X @ found
    influences = np.einsum("ij,kjf,kf->ki", covariance, weighed, left)[:, f:]
    scatter = flights / (flights - 1.0) * (influences**2).sum(axis=0)
    few = float(student_quantile(0.975, flights - 1)) / 1.96
    variance = few**2 * np.maximum(np.diagonal(covariance)[f:], scatter)
    gain = BEFORE**2 / (BEFORE**2 + variance)
    half = np.maximum(1.96 * np.sqrt(gain * variance), LEAST_OPEN)
    return ClosedLoopResponse(beyond=tuple((gain * found[f:]).tolist()), open=tuple(half.tolist()))


def _flight_scores(
    fit: BandedEstimate,
) -> tuple[
    Float[np.ndarray, "m f f"],
    Float[np.ndarray, "m f"],
    Float[np.ndarray, "m f e"],
    Float[np.ndarray, "f f"],
]:
    """Compute each flight's information, score, and its slope by the response; and the prior."""
    problem, feedback = fit.problem, fit.problem.feedback
    assert feedback is not None
    added = feedback_scores(
        problem, feedback.uncertain_part(), solutions(problem, fit.estimate.values)
    )
    prior = np.diag(problem.prior[1] ** -2.0)
    number = np.arange(len(added))
    flights = [
        (number >= part.blocks.start) & (number < part.blocks.stop) for part in problem.every_part
    ]
    H, s, _ = part_equations(fit, flights)
    G = np.array([added[flight].sum(axis=0).T for flight in flights])
    # Scaled by all flights' information on each parameter alone.
    size = parameter_scale(H.sum(axis=0) + prior)
    square = np.outer(size, size)
    return H / square, s / size, G / size[:, None], prior / square
