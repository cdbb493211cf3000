"""Can a body of the found inertia and weighed mass stand on the declared arms? After the fit.

`plausible_units.py` asks the same of one flight before the fit, where the rotors explain most of
its motion. Where they explain little, the interval of the inertia says how little is known, and all
of it must be outside. And whatever was flown: with an arm in centimetres a vehicle is lighter than
air.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from rotorfit.dataset.checks.plausible_units import implausible_size
from rotorfit.dataset.dataset import Dataset
from rotorfit.diagnostics.rotor_size import impossible_rotors
from rotorfit.errors import FrameError
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration

LIGHTEST: Final = 0.1
"""Mass over the cube of the arm [kg/m^3]. Vehicles have 10 to 1000, air 1.2; an arm in centimetres
makes a millionth of it."""
DENSEST: Final = 2000.0
"""Density of a ball with the body's mass and mean radius of gyration [kg/m^3]. Vehicles have 10 to
450; a mass in grams makes a thousand times that, stone has 2700."""
UNUSUAL: Final = 800.0
"""From here on it is said."""
SPHERE: Final = float(np.sqrt(5.0 / 3.0))
"""Radius of a ball over the root mean square distance of its mass from the centre."""
USUAL: Final = 0.45
"""Radius of gyration over the arm of most vehicles."""

_TINY: Final = float(np.finfo(float).tiny)


def refuse_impossible_size(
    dataset: Dataset, joint: Sequence[JointConfiguration], numbers: Numbers
) -> None:
    """Raise where mass, or the whole interval of the inertia, does not go with the arms.

    Parameters
    ----------
    dataset
        The flights.
    joint, numbers
        The configurations, and the numbers with their final intervals.

    Raises
    ------
    FrameError
        With what would explain it.
    """
    if all(c.entry.mass != "unknown" for c in dataset.configurations):
        words = impossible_rotors(dataset, numbers)
        if words is not None:
            raise FrameError(words)
    for configured, c in zip(dataset.configurations, joint, strict=True):
        words = None
        if configured.entry.mass != "unknown":
            words = too_light(configured.mass, c.vehicle.arm)
            words = words or too_dense(configured.mass, lightest_density(c, numbers))
        words = words or outside_rotors(c, numbers)
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


def lightest_density(configuration: JointConfiguration, numbers: Numbers) -> float | None:
    """Return the density of a ball of the body's mass and spread, at the upper end of its inertia.

    None where no moment of inertia is bounded by more than a factor of two.
    """
    ends: list[float] = []
    for name in ("Ixx_com", "Iyy_com", "Izz_com"):
        value, half = numbers.number(f"{name}@{configuration.name}")
        if value > 0 and half < value:
            ends.append(value + half)
    if not ends:
        return None
    # Half the sum of the three is the mass times its mean squared distance; of a flat body the
    # third is the sum of the two others.
    spread = 1.5 * float(np.mean(ends)) / configuration.mass
    return configuration.mass / (4.0 / 3.0 * np.pi * (SPHERE * float(np.sqrt(spread))) ** 3)


def too_dense(mass: float, density: float | None) -> str | None:
    """Return what contradicts a mass [kg] of that density [kg/m^3], None where nothing does."""
    if density is None or density <= DENSEST:
        return None
    return (
        f"{mass:g} kg with the inertia found would be a body of {density:.0f} kg/m^3, denser than "
        "stone (multirotors have 10 to 450): the mass is too large (grams given as kilograms?) or "
        "the rotors' positions are too small; correct their unit"
    )


def unusual_density(joint: Sequence[JointConfiguration], numbers: Numbers) -> str | None:
    """Return that a body is denser than multirotors are, in words."""
    for c in joint:
        density = lightest_density(c, numbers)
        if density is not None and density > UNUSUAL:
            return (
                f"{c.name}: with {c.mass:g} kg and the inertia found its density is "
                f"{density:.0f} kg/m^3, where multirotors have 10 to 450: weigh it again, and "
                f"measure the rotors' distances (arm {c.vehicle.arm:g} m)"
            )
    return None


def outside_rotors(configuration: JointConfiguration, numbers: Numbers) -> str | None:
    """Return that the centre of mass is outside the rotors with its whole interval, in words."""
    places = configuration.vehicle.positions[:, :2]
    at = f"@{configuration.name}"
    for k, axis in enumerate("xy"):
        if f"com_{axis}{at}" not in numbers.names:
            return None
        value, half = numbers.number(f"com_{axis}{at}")
        centre = f"rotor_center_{axis}{at}"
        if centre in numbers.names:
            # Both are measured from the IMU: their difference is from the middle of the rotors.
            other, unsure = numbers.number(centre)
            value, half = value - other, float(np.hypot(half, unsure))
        low, high = places[:, k].min(), places[:, k].max()
        if value - half > high or value + half < low:
            return (
                f"the centre of mass would be {1e3 * value:.0f} +- {1e3 * half:.0f} mm along "
                f"{axis}, outside the rotors ({1e3 * low:.0f} to {1e3 * high:.0f} mm), where "
                "nothing hovers: rotor speeds of one side have another scale, or the rotors' "
                "positions or order are wrong"
            )
    return None


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
