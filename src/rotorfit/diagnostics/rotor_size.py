r"""Can rotors that fit between one another lift that mass with that power? Momentum theory says.

The thrust of a rotor of radius R in hover takes at least the power :math:`T^{3/2} / \sqrt{2 \rho
\pi R^2}`; the share of it in what the motor gives, :math:`k_d \Omega^3`, is the figure of merit

.. math:: FM = \sqrt{k_t / (2 \pi \rho)} \, k_t / (k_d R),

free of the speed, below one of necessity and .4 to .75 of good propellers. Rotors do not overlap,
so that R is at most half the distance between two of them.
"""

from typing import Final

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.airborne import GRAVITY

AIR: Final = 1.2
"""Density of air [kg/m^3]."""
LEAST_MERIT: Final = 0.11
MOST_MERIT: Final = 0.68
"""With the largest rotors that fit; sound vehicles have 0.17 to 0.51."""
USUAL_MERIT: Final = 0.3
HEAVIEST: Final = 500.0
"""Weight over the area of the largest rotors that fit [N/m^2]; vehicles have 10 to 170."""
UNUSUAL_LOADING: Final = 200.0
"""From here on it is said; a Crazyflie of ten times its mass would have 270 [N/m^2]."""
MOST_THRUST: Final = 0.06
"""Thrust over air density, area and squared tip speed; sound vehicles have up to 0.017."""


def largest_radius(vehicle: Vehicle) -> float:
    """Return half the smallest distance between rotors that are not above one another [m]."""
    places = vehicle.positions[:, :2]
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    return 0.5 * float(distances[distances > 0.01 * vehicle.arm].min())


def impossible_rotors(dataset: Dataset, numbers: Numbers) -> str | None:
    """Return what rotors that fit cannot do, in words; None where nothing contradicts.

    Parameters
    ----------
    dataset
        Of masses that are known.
    numbers
        With their final intervals.
    """
    R, vehicle = largest_radius(dataset.vehicle), dataset.vehicle
    heaviest, loading = _heaviest(dataset)
    fit = f"rotors that fit between one another here are {1e3 * R:.0f} mm in radius at most"
    remedy = (
        f"the mass ({heaviest:g} kg) is too large, the rotors' distances are too small "
        f"(arm {vehicle.arm:.3g} m), or rotor speed has another scale (poles)"
    )
    if loading > HEAVIEST:
        return (
            f"{fit}, and would carry {loading:.0f} N on each square metre (multirotors: 10 to "
            f"170): {remedy}"
        )
    if dataset.motors.speed == "commanded" and dataset.motors.law_is_relative:
        return None if not dataset.speeds_commanded else _by_speed(numbers, R, fit, remedy)
    return _by_speed(numbers, R, fit, remedy)


def _heaviest(dataset: Dataset) -> tuple[float, float]:
    """Return the largest mass [kg], and its weight over the area of rotors that fit [N/m^2]."""
    places = dataset.vehicle.positions[:, :2].round(4).tolist()
    area = len({tuple(place) for place in places}) * np.pi * largest_radius(dataset.vehicle) ** 2
    heaviest = max(c.mass for c in dataset.configurations)
    return heaviest, heaviest * GRAVITY / area


def unusual_loading(dataset: Dataset) -> str | None:
    """Return that the mass is unusually large for rotors that fit between one another, in words."""
    heaviest, loading = _heaviest(dataset)
    if loading < UNUSUAL_LOADING:
        return None
    return (
        f"the largest rotors that fit between one another would carry {loading:.0f} N on each "
        f"square metre, where multirotors have 10 to 170: weigh the vehicle again (mass "
        f"{heaviest:g} kg), and measure the rotors' distances (arm {dataset.vehicle.arm:.3g} m)"
    )


def _by_speed(numbers: Numbers, R: float, fit: str, remedy: str) -> str | None:
    """Return the same by thrust and torque at a known speed."""
    low, _ = numbers.interval("kt")
    thrust = low / (AIR * np.pi * R**4)
    if np.isfinite(thrust) and thrust > MOST_THRUST:
        return (
            f"{fit}; their thrust coefficient would be {thrust:.2g} (up to 0.017 is usual): "
            f"{remedy}"
        )
    merit = figure_of_merit(numbers, R)
    if merit is None or LEAST_MERIT <= merit <= MOST_MERIT:
        return None
    size = "large" if merit < LEAST_MERIT else "small"
    other = "small" if merit < LEAST_MERIT else "large"
    return (
        f"{fit}; by thrust and torque they would turn {100 * merit:.0f} % of their power into lift "
        f"(17 to 51 % is usual of rotors that large): the rotors' distances are too {size} (a "
        f"diagonal given as arm?), the mass is too {other}, or rotor speed has another scale"
    )


def figure_of_merit(numbers: Numbers, radius: float) -> float | None:
    """Return the figure of merit, at the end of its interval nearest to the usual; None if unknown.

    Parameters
    ----------
    numbers
        With ``kt`` and ``kd``.
    radius
        Of the rotors [m].
    """
    (kt, kt_half), (kd, kd_half) = numbers.number("kt"), numbers.number("kd")
    if not (kt > 0 and kd > 0 and np.isfinite(kd_half) and kd_half < kd):
        return None
    merit = float(np.sqrt(kt / (2.0 * np.pi * AIR))) * kt / (kd * radius)
    spread = float(np.hypot(1.5 * kt_half / kt, kd_half / kd))
    return float(np.clip(USUAL_MERIT, merit * (1.0 - min(spread, 0.9)), merit * (1.0 + spread)))
