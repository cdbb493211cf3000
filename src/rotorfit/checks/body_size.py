"""Can a body of the found inertia and weighed mass stand on the declared arms? After the fit.

`plausible_units.py` asks the same of one flight before the fit, where the rotors explain most of
its motion. Where they explain little, the interval of the inertia says how little is known, and all
of it must be outside. And whatever was flown: with an arm in centimetres a vehicle is lighter than
air.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from rotorfit.checks.plausible_units import implausible_size
from rotorfit.errors import FrameError
from rotorfit.fit.flights import Flown
from rotorfit.fit.joint_equations import JointConfiguration
from rotorfit.fit.number_intervals import Numbers

LIGHTEST: Final = 0.1
"""Mass over the cube of the arm [kg/m^3]. Vehicles have 10 to 1000, air 1.2; an arm in centimetres
makes a millionth of it."""
USUAL: Final = 0.45
"""Radius of gyration over the arm of most vehicles."""

_TINY: Final = float(np.finfo(float).tiny)


def refuse_impossible_size(
    flown: Flown, joint: Sequence[JointConfiguration], numbers: Numbers
) -> None:
    """Raise where mass, or the whole interval of the inertia, does not go with the arms.

    Parameters
    ----------
    flown
        The flights.
    joint, numbers
        The configurations, and the numbers with their final intervals.

    Raises
    ------
    FrameError
        With what would explain it.
    """
    for configured, c in zip(flown.configurations, joint, strict=True):
        words = None
        if configured.entry.mass != "unknown":
            words = too_light(configured.mass, c.vehicle.arm)
        words = words or implausible_size(surest_gyration(c, numbers), c.vehicle.arm)
        if words is not None:
            raise FrameError(f"{c.name}: {words}")


def too_light(mass: float, arm: float) -> str | None:
    """Return what contradicts a mass [kg] on an arm [m], None where nothing does."""
    if mass > LIGHTEST * arm**3:
        return None
    return (
        f"{mass:g} kg on arms of {arm:g} m would be lighter than air: the rotors' positions are "
        "too large (centimetres given as metres?); correct the unit"
    )


def surest_gyration(configuration: JointConfiguration, numbers: Numbers) -> float | None:
    """Return the radius of gyration over the arm, of its intervals the end nearest to usual ones.

    Of roll and pitch the one nearer to them; None where neither has a finite interval.
    """
    ratios: list[float] = []
    for name in ("Ixx_com", "Iyy_com"):
        interval = numbers.interval(f"{name}@{configuration.name}")
        if not np.isfinite(interval).all():
            return None
        ends = np.sqrt(np.maximum(interval, 0.0) / configuration.mass)
        ratios.append(float(np.clip(USUAL, *(ends / configuration.vehicle.arm))))
    return min(ratios, key=lambda ratio: abs(np.log(max(ratio, _TINY) / USUAL)))
