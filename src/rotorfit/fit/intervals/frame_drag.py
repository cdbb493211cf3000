"""How far terms of the air that a model lacks may stand in its other numbers.

Drag of the rotors is in proportion to their speeds, that of the frame is not: at one sum of speeds
the forces show no more than both together. A model without drag of the frame gives it all to the
rotors. The share is known as well as before the flight, or as the changes of the speeds show it.
And the wakes of the rotors lift the side towards which the vehicle moves, as drag above a low
centre of mass does.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.banded import BandedEstimate, normal_equations
from rotorfit.estimation.estimate import Estimate
from rotorfit.fit.joint.added_parameters import Added, with_added
from rotorfit.fit.joint.joint_problem import JointConfiguration, size_of
from rotorfit.model.terms.air import DRAG, DRAG_NAMES, WAKE_MOMENT
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.model.terms.term import Term


def frame_drag_shifts(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> Float[np.ndarray, "s f"]:
    """Return shifts of the free parameters by the frame's rms drag by axis; none if it is known."""
    return _left_out_shifts(fit, configurations, DRAG, DRAG_NAMES)


def wake_shifts(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> Float[np.ndarray, "s f"]:
    """Return shifts of the free parameters by the wakes' rms moments; none if they are known."""
    return _left_out_shifts(fit, configurations, WAKE_MOMENT, WAKE_MOMENT.names)


def _left_out_shifts(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    term: Term,
    names: Sequence[str],
) -> Float[np.ndarray, "s f"]:
    """Return shifts of the free parameters by what a term that is left out may be."""
    layout, free = configurations[0].model.layout, len(fit.estimate.names)
    known = {name.partition("@")[0] for name in fit.estimate.names}
    if DRAG_OF_ROTORS not in layout.added or not term.stands_in(layout) or {*names} & known:
        return np.zeros((0, free))
    equations = normal_equations(
        _with_term(fit, configurations[0], term, names), np.ones(len(fit.influence), dtype=bool)
    )
    H = equations.information
    by_term = -np.linalg.solve(H[:free, :free], H[:free, free:])
    covariance = np.linalg.inv(H[free:, free:] + H[free:, :free] @ by_term)
    # The flights ask for as much; the air brakes and never drives, and wakes lift and never press
    # down, so that none is left where they ask for less than none.
    variance = np.diagonal(covariance)
    # Rounding makes a variance negative where a fit hardly knows anything: as much as the term's
    # own information says is left.
    variance = np.where(variance > 0.0, variance, 1.0 / np.diagonal(H)[free:])
    size = rms_above_zero(equations.step[free:], np.sqrt(variance))
    shifts: Float[np.ndarray, "s f"] = (by_term * size).T
    return shifts


def _with_term(
    fit: BandedEstimate, first: JointConfiguration, term: Term, names: Sequence[str]
) -> BandedEstimate:
    """Return a fit with a term's numbers among its parameters, of which there is none yet."""
    assert term.entries is not None
    blocks, size = term.entries(first.vehicle, first.model.layout), size_of(first)
    added = [
        Added(name=name, entries=blocks[name], times=None, prior=float(prior(size)))
        for name in names
        if (prior := term.parameters[name].prior) is not None
    ]
    problem = with_added(fit.problem, added)
    count = len(problem.map.names)
    at = Estimate(
        names=problem.map.names,
        values=np.append(fit.estimate.values, np.zeros(len(added))),
        covariance=np.zeros((count, count)),
        condition_number=1.0,
    )
    return dataclasses.replace(fit, problem=problem, estimate=at)


def rms_above_zero(
    mean: Float[np.ndarray, " d"], std: Float[np.ndarray, " d"]
) -> Float[np.ndarray, " d"]:
    """Compute the root mean square of normal variables that are known to be positive."""
    from scipy.special import log_ndtr  # slow to import

    lowest = -mean / std
    hazard = np.exp(-0.5 * lowest**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(-lowest))
    # E[x^2] = m^2 + s^2 + m s phi(a) / (1 - Phi(a)), a = -m / s (truncated normal distribution).
    return np.sqrt(np.maximum(mean**2 + std**2 + mean * std * hazard, 0.0))
