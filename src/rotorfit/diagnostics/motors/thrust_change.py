"""Widen intervals by a thrust that changes during a flight: ground, a tether, a sagging battery.

One rotor speed lifts more near the ground, and less on a tether. Which half of a flight is free air
nothing tells; the scale of all that is in proportion to force is open by the change between the
halves, as far as that is more than chance.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.diagnostics.hover_thrust import hover_thrusts
from rotorfit.fit.fit import Fit
from rotorfit.model.parameters import EVERY

CHANCE: Final = 1.0
"""Deviations of a change that chance makes. (k_t, between both halves, is off by half of it.)"""


def allow_for_thrust_change(fit: Fit) -> Fit:
    """Widen what is in proportion to force by the change of thrust between halves of a flight."""
    return fit.with_half_width(changed_half_width(fit)) if fit.mass_known else fit


def changed_half_width(fit: Fit) -> Float[np.ndarray, " q"]:
    """Compute the half-widths with the change of thrust, of several flights its mean square."""
    numbers, dataset = fit.numbers, fit.dataset
    found = hover_thrusts(dataset.configurations, numbers, dataset.vehicle)
    beyond = [max(abs(one.sag) - CHANCE * one.sag_std, 0.0) for one in found if one.sag is not None]
    change = float(np.sqrt(np.mean(np.square(beyond)))) if beyond else 0.0
    by_force = [EVERY[name.partition("@")[0]].mass_power != 0 for name in numbers.names]
    extra = np.where(by_force, change * np.abs(numbers.values), 0.0)
    half: Float[np.ndarray, " q"] = np.hypot(numbers.half_width, extra)
    return half
