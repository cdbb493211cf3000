"""Widen intervals by a thrust that changes during a flight.

One rotor speed lifts more near the ground, and less on a tether or a sagging battery. Which half of
a flight is free air nothing shows; the scale of all that is in proportion to force is open by the
change between the halves, as far as that is more than chance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.weight.hover_thrusts import hover_thrusts
from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.parameters import EVERY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.fit import Fit

CHANCE: Final = 1.0
"""Deviations of a change that chance makes. (k_t, between both halves, is off by half of it.)"""
OF_ONE_HALF: Final = ("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_kt")
"""No mass scales these, but each half of a flight has its own k_t, and inertia is that of the half
in which the vehicle turns most: the whole change is open, less its deviation in squares."""


def allow_for_thrust_change(fit: Fit) -> Fit:
    """Append the change of thrust between halves of a flight to numbers proportional to force."""
    return fit.with_terms(thrust_change_term(fit)) if fit.mass_known else fit


def thrust_change_term(fit: Fit) -> IntervalTerm:
    """Return the term by the change of thrust, of several flights its mean square."""
    numbers, dataset = fit.numbers, fit.dataset
    found = hover_thrusts(
        dataset.configurations, numbers, dataset.vehicle, layout=dataset.model.layout
    )
    known = [(one.sag, CHANCE * one.sag_std) for one in found if one.sag is not None]
    change = _mean_square([max(abs(sag) - std, 0.0) for sag, std in known])
    whole = _mean_square([max(sag**2 - std**2, 0.0) ** 0.5 for sag, std in known])
    pairs = zip(numbers.names, np.abs(numbers.values), strict=True)
    return IntervalTerm(
        name="thrust changes in flight",
        half_width=np.array(
            [_open_width(name.partition("@")[0], size, change, whole) for name, size in pairs]
        ),
        source="thrust at one rotor speed, early against late in the flight",
    )


def _mean_square(changes: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(changes)))) if changes else 0.0


def _open_width(name: str, size: float, change: float, whole: float) -> float:
    """Return by how much a number of that size is uncertain, in its unit."""
    if name == "accel_bias_z":
        # The constant force that carries the weight is shared between it and the thrust.
        return change * GRAVITY
    if name in OF_ONE_HALF:
        return whole * size
    if name == "hover_speed":
        return 0.5 * change * size
    return change * size if EVERY[name].mass_power else 0.0
