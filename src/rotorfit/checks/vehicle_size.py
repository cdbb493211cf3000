r"""Check the size of the vehicle: rotors, mass and inertia that go with the declared arms.

Can rotors that fit between one another lift that mass with that power? The thrust of a rotor of
radius R in hover takes at least the power :math:`T^{3/2} / \sqrt{2 \rho \pi R^2}` (momentum
theory); the share of it in the power of the motor, :math:`k_d \Omega^3`, is the figure of merit

.. math:: FM = \sqrt{k_t / (2 \pi \rho)} \, k_t / (k_d R),

free of the speed, below one of necessity and .4 to .75 of good propellers. Rotors do not overlap,
so that R is at most half the distance between two of them.

Can a body of the found inertia and weighed mass stand on the declared arms? `plausible_units.py`
asks the same of one flight before the fit, where the rotors explain most of its motion. Where they
explain little, the interval of the inertia says how little is known, and all of it must be outside.
And whatever was flown: with an arm in centimetres a vehicle is lighter than air.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.errors import FrameError
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.dataset.plausible_units import implausible_size
from rotorfit.flight.airborne import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.model.vehicle import Vehicle

AIR: Final = 1.2
"""Density of air [kg/m^3]."""
LEAST_MERIT: Final = 0.11
MOST_MERIT: Final = 0.68
"""Largest figure of merit with the largest rotors that fit; sound vehicles have 0.17 to 0.51."""
USUAL_MERIT: Final = 0.3
HEAVIEST: Final = 500.0
"""Weight over the area of the largest rotors that fit [N/m^2]; vehicles have 10 to 170."""
UNUSUAL_LOADING: Final = 200.0
"""Disk loading that is reported; a Crazyflie of ten times its mass would have 270 [N/m^2]."""
MOST_THRUST: Final = 0.06
"""Thrust over air density, area and squared tip speed; sound vehicles have up to 0.017."""
LIGHTEST: Final = 0.1
"""Mass over the cube of the arm [kg/m^3]. Vehicles have 10 to 1000, air 1.2; an arm in centimetres
makes a millionth of it."""
DENSEST: Final = 2000.0
"""Density of a ball with the body's mass and mean radius of gyration [kg/m^3]. Vehicles have 10 to
450; a mass in grams makes a thousand times that, stone has 2700."""
UNUSUAL: Final = 800.0
"""Density that is reported [kg/m^3]."""
SPHERE: Final = float(np.sqrt(5.0 / 3.0))
"""Radius of a ball over the root mean square distance of its mass from the centre."""
USUAL: Final = 0.45
"""Radius of gyration over the arm of most vehicles."""

_TINY: Final = float(np.finfo(float).tiny)


def largest_radius(vehicle: Vehicle) -> float:
    """Return half the smallest distance between rotors that are not above one another [m]."""
    places = vehicle.positions[:, :2]
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    return 0.5 * float(distances[distances > 0.01 * vehicle.arm].min())


def impossible_rotors(dataset: Dataset, numbers: Numbers) -> str | None:
    """Explain a load that no rotors fitting between one another can carry; None if they can."""
    R, vehicle = largest_radius(dataset.vehicle), dataset.vehicle
    heaviest, loading = _find_heaviest(dataset)
    if loading > HEAVIEST:
        return (
            f"rotors that fit on this frame ({1e3 * R:.0f} mm radius at most) cannot lift "
            f"{heaviest:g} kg, {loading:.0f} N per square metre where 10 to 170 is usual: the mass "
            f"is too large, or the rotors' distances are too small (arm {vehicle.arm:.3g} m)"
        )
    fit = f"with the largest rotors that fit on this frame ({1e3 * R:.0f} mm radius),"
    remedy = (
        f"the mass ({heaviest:g} kg) is too large, the rotors' distances are too small "
        f"(arm {vehicle.arm:.3g} m), or rotor speed has another scale (poles)"
    )
    if dataset.motors.speed == "commanded" and dataset.motors.law_is_relative:
        return None if not dataset.speeds_commanded else _by_speed(numbers, R, fit, remedy)
    return _by_speed(numbers, R, fit, remedy)


def _find_heaviest(dataset: Dataset) -> tuple[float, float]:
    """Find the largest mass [kg], and its weight over the area of rotors that fit [N/m^2]."""
    places = dataset.vehicle.positions[:, :2].round(4).tolist()
    area = len({tuple(place) for place in places}) * np.pi * largest_radius(dataset.vehicle) ** 2
    heaviest = max(c.mass for c in dataset.configurations)
    return heaviest, heaviest * GRAVITY / area


def unusual_loading(dataset: Dataset) -> str | None:
    """Explain that the mass is large for rotors that fit between one another; None if it is not."""
    heaviest, loading = _find_heaviest(dataset)
    if loading < UNUSUAL_LOADING:
        return None
    return (
        f"the largest rotors that fit on this frame would carry {loading:.0f} N per square metre, "
        f"where 10 to 170 is usual: weigh the vehicle again (mass {heaviest:g} kg), and measure "
        f"the rotors' distances (arm {dataset.vehicle.arm:.3g} m)"
    )


def _by_speed(numbers: Numbers, R: float, fit: str, remedy: str) -> str | None:
    """Explain how thrust and torque contradict rotors of radius R [m]; None if they do not."""
    low, _ = numbers.interval("kt")
    thrust = low / (AIR * np.pi * R**4)
    if np.isfinite(thrust) and thrust > MOST_THRUST:
        return (
            f"{fit} the thrust coefficient would be {thrust:.2g} (up to 0.017 is usual): {remedy}"
        )
    merit = figure_of_merit(numbers, R)
    if merit is None or LEAST_MERIT <= merit <= MOST_MERIT:
        return None
    size = "large" if merit < LEAST_MERIT else "small"
    other = "small" if merit < LEAST_MERIT else "large"
    return (
        f"{fit} {100 * merit:.0f} % of the rotors' power would turn into lift "
        f"(17 to 51 % is usual of rotors that large): the rotors' distances are too {size} (a "
        f"diagonal given as arm?), the mass is too {other}, or rotor speed has another scale"
        + (", or the rotors' axes are tilted otherwise than declared" if size == "large" else "")
    )


def figure_of_merit(numbers: Numbers, radius: float) -> float | None:
    """Compute the figure of merit of rotors of a radius [m]; None if k_t or k_d is unknown.

    Of its interval the end nearest to usual rotors.
    """
    (kt, kt_half), (kd, kd_half) = numbers.number("kt"), numbers.number("kd")
    if not (kt > 0 and kd > 0 and np.isfinite(kd_half) and kd_half < kd):
        return None
    merit = float(np.sqrt(kt / (2.0 * np.pi * AIR))) * kt / (kd * radius)
    # The figure of merit goes with k_t^1.5 / k_d.
    spread = float(np.hypot(1.5 * kt_half / kt, kd_half / kd))
    return float(np.clip(USUAL_MERIT, merit * (1.0 - min(spread, 0.9)), merit * (1.0 + spread)))


def refuse_impossible_size(fit: Fit) -> Iterator[Finding]:
    """Refuse a mass, or an inertia with its whole interval, that no vehicle with these arms has."""
    dataset, numbers = fit.dataset, fit.numbers
    kind = "impossible-size"
    if fit.mass_known:
        sentence = impossible_rotors(dataset, numbers)
        if sentence is not None:
            raise FrameError(sentence).about(kind=kind)
    for configured, c in zip(dataset.configurations, fit.configurations, strict=True):
        sentence = None
        if configured.entry.mass != "unknown":
            sentence = too_light(configured.mass, c.vehicle.arm)
            sentence = sentence or too_dense(configured.mass, lightest_density(c, numbers))
        sentence = sentence or outside_rotors(c, numbers)
        sentence = sentence or implausible_size(surest_gyration(c, numbers), c.vehicle.arm)
        if sentence is not None:
            raise FrameError(f"{c.name}: {sentence}").about(kind=kind)
    yield Finding(kind=kind, severity="passed")


def too_light(mass: float, arm: float) -> str | None:
    """Explain why a mass [kg] is implausible for an arm [m]; None if it is plausible."""
    if mass > LIGHTEST * arm**3:
        return None
    return (
        f"{mass:g} kg on arms of {arm:g} m would be lighter than air: the rotors' positions are "
        "too large (centimetres given as metres?); correct the unit"
    )


def lightest_density(configuration: JointConfiguration, numbers: Numbers) -> float | None:
    """Compute the density of a ball of the body's mass and spread, at the upper end of its inertia.

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
    """Explain why a mass [kg] is implausible for a density [kg/m^3]; None if it is plausible."""
    if density is None or density <= DENSEST:
        return None
    return (
        f"{mass:g} kg with the inertia found would be a body of {density:.0f} kg/m^3, denser than "
        "stone (multirotors have 10 to 450): the mass is too large (grams given as kilograms?) or "
        "the rotors' positions are too small; correct their unit"
    )


def unusual_size(fit: Fit) -> Iterator[Finding]:
    """Check density and disk loading against those of multirotors, where the mass is known."""
    if fit.mass_known:
        density = unusual_density(fit.configurations, fit.numbers)
        yield doubt_or_passed("unusual-density", density)
        yield doubt_or_passed("unusual-loading", unusual_loading(fit.dataset))


def unusual_density(joint: Sequence[JointConfiguration], numbers: Numbers) -> str | None:
    """Explain that a body is denser than a multirotor; None if no body is."""
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
    """Explain that the whole interval of the CoM is outside the rotors; None if it is not."""
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
                f"the centre of mass would be {with_half(1e3 * value, 1e3 * half)} mm along "
                f"{axis}, outside the rotors ({1e3 * low:.0f} to {1e3 * high:.0f} mm), where "
                "nothing hovers: rotor speeds of one side have another scale, or the rotors' "
                "positions or order are wrong"
            )
    return None


def surest_gyration(configuration: JointConfiguration, numbers: Numbers) -> float | None:
    """Estimate the radius of gyration over the arm, at its end nearest to usual; None if open."""
    ratios: list[float] = []
    for name in ("Ixx_com", "Iyy_com"):
        interval = numbers.interval(f"{name}@{configuration.name}")
        if not np.isfinite(interval).all():
            return None
        ends = np.sqrt(np.maximum(interval, 0.0) / configuration.mass)
        ratios.append(float(np.clip(USUAL, *(ends / configuration.vehicle.arm))))
    # Of roll and pitch the one nearer to usual.
    return min(ratios, key=lambda ratio: abs(np.log(max(ratio, _TINY) / USUAL)))


REFUSALS: Final = (refuse_impossible_size,)
CHECKS: Final = (unusual_size,)
