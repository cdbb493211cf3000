"""The thrust that an estimate gives in hover, over the weight: of each flight, and over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.distributions import student_quantile
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.carried_weight import needed_stretches
from rotorfit.fit.dataset.weight_balance import Held
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.weight.estimated_air import estimated_air_force
from rotorfit.fit.weight.kt_from_weight import bias_and_velocity_std, pooled_weight
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight
    from rotorfit.fit.experiment.flight_entries import Source
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.signals import SignalLayout
    from rotorfit.model.vehicle import Vehicle

BATCH = 2.0
"""Length of a batch [s]: gusts and climbs are forgotten from one to the next."""
FEWEST_BATCHES = 4
"""Fewest batches of a half whose scatter is informative."""


@frozen_dataclass
class HoverThrust:
    """The estimated thrust over the weight in one flight.

    - `thrust`: mean upward thrust over the weight.
    - `sag`: the same in the second half of the flight over the first, less one; None of short ones.
    """

    configuration: str
    flight: str
    thrust: Held
    sag: float | None
    sag_std: float


def hover_thrusts(
    configurations: Sequence[ConfigurationData],
    numbers: Numbers,
    vehicle: Vehicle,
    *,
    layout: SignalLayout,
    timing: MotorResponse | None = None,
    source: Source = "imu",
) -> list[HoverThrust]:
    """Estimate the thrust that holds each flight up, over its weight.

    `layout`: of the model, whose air forces help to carry. `timing`: of the motors, where it was
    found; `source`: of the accelerations.
    """
    kt = numbers.values[numbers.index("kt")]
    own = [f"kt_{i + 1}" for i in range(len(vehicle.rotors))]
    each = np.array([numbers.values[numbers.index(n)] if n in numbers.names else kt for n in own])
    found: list[HoverThrust] = []
    for configured in configurations:
        for flight in configured.flights:
            data = retimed(flight.prepared, timing)
            thrust = (data.rotor_speed**2 * each) @ vehicle.axes
            air = estimated_air_force(data, numbers, configured.entry.name, (vehicle, layout))
            force = (thrust + air) / configured.mass
            whole = thrust_over_weight(flight, data, force, source)
            if whole is None:
                continue
            sag = thrust_sag(data, force)
            found.append(
                HoverThrust(
                    configuration=configured.entry.name,
                    flight=flight.entry.file,
                    thrust=whole,
                    sag=None if sag is None else sag.value,
                    sag_std=np.inf if sag is None else sag.std,
                )
            )
    return found


def thrust_over_weight(
    flight: LoadedFlight, data: FlightData, force: Float[np.ndarray, "n 3"], source: Source
) -> Held | None:
    """Compute mean thrust over mass [m/s^2] over gravity; what a throw or landing gains is off."""
    bias, velocity_std = bias_and_velocity_std(flight, source)
    found = [*needed_stretches(data, flight.turning, force, bias=bias, velocity_std=velocity_std)]
    needed = pooled_weight(found)
    if needed is None:
        return None
    seconds = sum(one.seconds for one in found)
    return Held(ratio=1.0 / needed.value, std=needed.std / needed.value**2, seconds=seconds)


def thrust_sag(data: FlightData, force: Float[np.ndarray, "n 3"]) -> Measured | None:
    """Measure the change of a force, over the felt one, from early to late in a flight.

    The accelerometer feels what lifts, whatever the vehicle does, and its bias is the same in both
    halves. Chance is what scatters among batches about a steady change over the flight: a battery
    that sags is a trend within each half, too, and no chance.

    Parameters
    ----------
    force
        Thrust and air force over mass by an estimate, of every sample [m/s^2].

    Returns
    -------
    Measured
        None of a flight that is too short.
    """
    rows = data.used_rows
    step = round(BATCH * data.sample_rate)
    if len(rows) < 2 * FEWEST_BATCHES * step:
        return None
    mean = force[rows].mean(axis=0)
    along = mean / np.linalg.norm(mean)
    felt, made = data.specific_force[rows] @ along, force[rows] @ along
    batches = np.array_split(np.arange(len(rows)), 2 * (len(rows) // (2 * step)))
    ratios = np.array([made[own].mean() / felt[own].mean() for own in batches])
    n = len(ratios)
    early, late = ratios[: n // 2].mean(), ratios[n // 2 :].mean()
    trend = np.polynomial.Polynomial.fit(np.arange(n), ratios, 1)
    left = ratios - trend(np.arange(n))
    few = float(student_quantile(0.975, n - 2)) / 1.96
    # A mean of n / 2 batches has 2 / n of their variance, a difference of two of them 4 / n.
    std = few * 2.0 * float(np.sqrt(left @ left / (n - 2) / n)) / early
    return Measured(value=float(late / early) - 1.0, std=std)
