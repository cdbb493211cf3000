"""How far drag of the frame that a model lacks may stand in its other numbers.

Drag of the rotors is in proportion to their speeds, that of the frame is not: at one sum of speeds
the forces show no more than both together. A model without drag of the frame gives it all to the
rotors. The share is known as well as before the flight, or as the changes of the speeds show it.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.banded import BandedEstimate, normal_equations
from rotorfit.estimation.estimate import Estimate
from rotorfit.fit.joint.added_parameters import Added, with_added
from rotorfit.fit.joint.joint_problem import JointConfiguration, size_of
from rotorfit.model.terms.air import DRAG, DRAG_NAMES
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float


def frame_drag_shifts(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> Float[np.ndarray, "s f"]:
    """Return shifts of the free parameters by the frame's rms drag by axis; none if it is known."""
    layout, free = configurations[0].model.layout, len(fit.estimate.names)
    known = {name.partition("@")[0] for name in fit.estimate.names}
    if DRAG_OF_ROTORS not in layout.added or not DRAG.stands_in(layout) or {*DRAG_NAMES} & known:
        return np.zeros((0, free))
    equations = normal_equations(
        _with_frame_drag(fit, configurations[0]), np.ones(len(fit.influence), dtype=bool)
    )
    H = equations.information
    by_drag = -np.linalg.solve(H[:free, :free], H[:free, free:])
    covariance = np.linalg.inv(H[free:, free:] + H[free:, :free] @ by_drag)
    # The flights ask for as much; the air brakes and never drives, so that none is left where they
    # ask for less than none.
    size = rms_above_zero(equations.step[free:], np.sqrt(np.diagonal(covariance)))
    shifts: Float[np.ndarray, "s f"] = (by_drag * size).T
    return shifts


def _with_frame_drag(fit: BandedEstimate, first: JointConfiguration) -> BandedEstimate:
    """Return a fit with drag of the frame among its parameters, of which there is none yet."""
    assert DRAG.entries is not None
    blocks, size = DRAG.entries(first.vehicle, first.model.layout), size_of(first)
    added = [
        Added(name=name, entries=blocks[name], times=None, prior=float(prior(size)))
        for name in DRAG_NAMES
        if (prior := DRAG.parameters[name].prior) is not None
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
