"""Widen intervals by a thrust that changes during a flight: ground, a tether, a sagging battery.

One rotor speed lifts more near the ground, and less on a tether. Which half of a flight is free air
nothing tells; the scale of all that is in proportion to force is open by the change between the
halves, as far as that is more than chance.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.diagnostics.hover_thrust import hover_thrusts
from rotorfit.fit.fit import Fit
from rotorfit.model.parameters import EVERY

CHANCE: Final = 1.0
"""Deviations of a change that chance makes. (k_t, between both halves, is off by half of it.)"""
RATIOS: Final[Mapping[str, float]] = {
    "hover_speed": 0.5,
    **dict.fromkeys(("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_kt"), 1.0),
}
"""By which power those go with k_t that no mass scales: each half of a flight has its own k_t, and
inertia is that of the half in which the vehicle turns most."""


def allow_for_thrust_change(fit: Fit) -> Fit:
    """Widen what is in proportion to force by the change of thrust between halves of a flight."""
    return fit.with_half_width(changed_half_width(fit)) if fit.mass_known else fit


def changed_half_width(fit: Fit) -> Float[np.ndarray, " q"]:
    """Compute the half-widths with the change of thrust, of several flights its mean square."""
    numbers, dataset = fit.numbers, fit.dataset
    found = hover_thrusts(dataset.configurations, numbers, dataset.vehicle)
    beyond = [max(abs(one.sag) - CHANCE * one.sag_std, 0.0) for one in found if one.sag is not None]
    change = float(np.sqrt(np.mean(np.square(beyond)))) if beyond else 0.0
    power = np.array([_power(name.partition("@")[0]) for name in numbers.names])
    extra = power * change * np.abs(numbers.values)
    half: Float[np.ndarray, " q"] = np.hypot(numbers.half_width, extra)
    return half


def _power(name: str) -> float:
    """Return by which power a number goes with thrust at one rotor speed."""
    return RATIOS.get(name, 1.0 if EVERY[name].mass_power else 0.0)
