"""How well the law of commanded motors is known: in every number that depends on their speeds.

A law that is wrong by a factor leaves forces and inertia as they are, and takes k_t, k_d and J_r
with it: by its inverse square, and its inverse. One whose slope is wrong makes changes of thrust
another share of the weight.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.diagnostics.motors.other_speeds import Speeds, shift_by_speeds, with_other_speeds
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.parameters import EVERY

LAW: Final = "law-uncertain"


def allow_for_law(fit: Fit) -> Fit:
    """Widen the intervals by what is not known of the law from command to speed."""
    law = fit.dataset.motors.law
    if law is None or not (law.speed_std or law.slope_std):
        return fit
    variance = fit.numbers.half_width**2 + (1.96 * scale_shift(fit.numbers, law.speed_std)) ** 2
    if law.slope_std:
        variance = variance + (1.96 * _slope_shift(fit, law.slope_std)) ** 2
    return fit.with_half_width(np.sqrt(variance)).found(_uncertain(fit.numbers, law.speed_std))


def scale_shift(numbers: Numbers, std: float) -> Float[np.ndarray, " q"]:
    """Compute how far numbers go where all speeds are off by a share `std`."""
    return np.array(_speed_powers(numbers), dtype=float) * std * np.abs(numbers.values)


def _speed_powers(numbers: Numbers) -> list[int]:
    return [EVERY[name.partition("@")[0]].speed_power for name in numbers.names]


def _slope_shift(fit: Fit, std: float) -> Float[np.ndarray, " q"]:
    """Compute how far numbers go where the speed grows with the command by a share `std` more."""

    def steeper(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        hover = float(np.median(flown))
        return hover * (np.maximum(speed, 0.0) / hover) ** (1.0 + std)

    return shift_by_speeds(fit, with_other_speeds(fit.dataset, steeper))


def _uncertain(numbers: Numbers, std: float) -> Finding:
    """Say what the law leaves open."""
    return Finding(
        kind=LAW,
        severity="note",
        sentence=(
            f"the law under [motors] gives the rotor speeds to +-{196 * std:.1f} %: the interval "
            "of Jr includes as much, those of kt and kd twice as much; log the rotor speed, or "
            "the battery's voltage, for a law that depends on it"
        ),
        numbers=tuple(
            name for name, power in zip(numbers.names, _speed_powers(numbers), strict=True) if power
        ),
        evidence=(Evidence(name="law_speed_std", value=std),),
    )
