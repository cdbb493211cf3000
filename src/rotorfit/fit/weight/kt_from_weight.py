"""k_t by the weight that thrust carries in hover.

Every stretch of every flight in which thrust carries the weight (`carried_weight.py`) has its k_t;
stretches are pooled, by a random effect where they differ by more than chance.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.measured import (
    Measured,
    mean_scale,
)
from rotorfit.fit.dataset.carried_weight import carrying_stretches
from rotorfit.fit.dataset.plausible_units import gravity_at_rest
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.sensors.known_faults import ERROR, is_estimate
from rotorfit.flight.airborne import GRAVITY
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.terms.body import ACCEL_BIAS_STD
from rotorfit.model.terms.rotors import spread_std

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight
    from rotorfit.fit.dataset.weight_balance import Held
    from rotorfit.fit.experiment.flight_entries import Source
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.vehicle import Vehicle

    AirOverKt = Callable[[ConfigurationData, FlightData], Float[np.ndarray, "n 3"]]
    """Force of the air over k_t, of a flight of a configuration."""

REST_STD = 0.1
"""Deviation of an accelerometer's bias in flight from that at rest (vibration, heat) [m/s^2]."""
CAMERA_VELOCITY = 0.05
"""Deviation of a velocity by motion capture [m/s]."""
CARRIED_VELOCITY = 0.1
"""The same of one by rare positions, with the accelerometer between them [m/s]: 3 cm over .3 s."""
CAMERA_BIAS = Measured(value=0.0, std=0.01)
"""Bias of an acceleration by motion capture, over seconds [m/s^2]."""


@frozen_dataclass
class ThrustShares:
    """Each rotor's k_t over their mean, with its covariance by the fit and before it."""

    values: Float[np.ndarray, " N"]
    covariance: Float[np.ndarray, "N N"]
    prior: Float[np.ndarray, "N N"]

    def std_of_mean(self, load: Float[np.ndarray, " N"]) -> float:
        """Return the deviation of a mean with these weights; no flight makes it larger."""
        return float(np.sqrt(min(load @ self.covariance @ load, load @ self.prior @ load)))


@frozen_dataclass
class WeighedFlight:
    """What carries the weight in one flight.

    - `file`: name of the log.
    - `stretches`: k_t of each stretch of hover.
    - `squares`: sum of each rotor's squared speed over the flight.
    """

    file: str
    stretches: tuple[Held, ...]
    squares: Float[np.ndarray, " N"]


def kt_from_weight(
    configurations: Sequence[ConfigurationData],
    vehicle: Vehicle,
    *,
    source: Source = "imu",
    timing: MotorResponse | None = None,
    shares: ThrustShares | None = None,
) -> Measured | None:
    """Estimate the thrust coefficient that carries the weight; None if no flight is long enough.

    `timing`: of the motors, where it was found: commands that swing, as in a limit cycle, have
    larger squares than the speeds that lag behind them. `shares`: of the rotors, where they were
    found: with the centre of mass off the centre, some rotors carry more of the weight than others,
    and it is their k_t.
    """
    return kt_of_stretches(
        list(weighed_flights(configurations, vehicle, source=source, timing=timing)), shares
    )


def weighed_flights(
    configurations: Sequence[ConfigurationData],
    vehicle: Vehicle,
    *,
    source: Source,
    timing: MotorResponse | None,
    air: AirOverKt | None = None,
) -> Iterator[WeighedFlight]:
    """Yield the k_t that carries the weight in the stretches of every flight.

    `air`: force of the air over k_t, where a fit knows it: at speed rotors lose thrust to the air
    through them, and their drag carries a part of the weight.
    """
    for configured in configurations:
        for flight in configured.flights:
            data = retimed(flight.prepared, timing)
            bias, velocity_std = bias_and_velocity_std(flight, source)
            stretches = carrying_stretches(
                data,
                flight.turning,
                vehicle,
                mass=configured.mass,
                bias=bias,
                velocity_std=velocity_std,
                air=None if air is None else air(configured, data),
            )
            squares = np.square(data.rotor_speed[data.used_rows]).sum(axis=0)
            yield WeighedFlight(
                file=Path(flight.entry.file).name, stretches=tuple(stretches), squares=squares
            )


def kt_of_stretches(
    flights: Sequence[WeighedFlight], shares: ThrustShares | None
) -> Measured | None:
    """Average the k_t of the stretches of some flights, for the rotors' mean."""
    weight = pooled_weight([held for one in flights for held in one.stretches])
    if weight is None or shares is None:
        return weight
    squares = np.sum([one.squares for one in flights], axis=0)
    load = squares / squares.sum()
    kt = weight.value / float(load @ shares.values)
    return Measured(value=kt, std=float(np.hypot(weight.std, kt * shares.std_of_mean(load))))


def bias_and_velocity_std(flight: LoadedFlight, source: Source) -> tuple[Measured, float]:
    """Return the bias of a flight's vertical acceleration [m/s^2] and what its velocity is off."""
    data = flight.prepared.data
    bias = bias_at_rest(data) if source == "imu" else CAMERA_BIAS
    return bias, velocity_std_of(data, estimated=is_estimate(flight.log.format))


def velocity_std_of(data: FlightData, *, estimated: bool) -> float:
    """Return the deviation of `FlightData.any_velocity` [m/s].

    `estimated`: where the log's velocity is the autopilot's estimate.
    """
    if data.velocity is None:
        return CARRIED_VELOCITY
    return ERROR if estimated else CAMERA_VELOCITY


def thrust_shares(numbers: Numbers, vehicle: Vehicle) -> ThrustShares | None:
    """Return each rotor's share, by the fit; None if it has one k_t for all."""
    n = len(vehicle.rotors)
    names = [f"kt_{i + 1}" for i in range(n)]
    if not set(names) <= set(numbers.names):
        return None
    kt = np.array([numbers.number(name)[0] for name in names])
    # What all have in common is no share.
    centred = np.eye(n) - 1.0 / n
    known = numbers.covariance(names) / kt.mean() ** 2
    before = np.diag([spread_std(rotor) ** 2 for rotor in vehicle.rotors])
    return ThrustShares(
        values=kt / kt.mean(),
        covariance=centred @ known @ centred,
        prior=centred @ before @ centred,
    )


def pooled_weight(found: Sequence[Held]) -> Measured | None:
    """Average stretches that differ by chance, and by a random effect where they differ more.

    Batteries, air and propellers are not the same in every flight: then each counts alike.

    References
    ----------
    DerSimonian and Laird, Controlled Clinical Trials 7, 1986.
    """
    if not found:
        return None
    measured = [Measured(value=one.ratio, std=one.std) for one in found]
    log_kt = np.log([one.value for one in measured])
    weight = np.array([one.share**-2.0 for one in measured])
    left = float(weight @ (log_kt - weight @ log_kt / weight.sum()) ** 2) - (len(found) - 1)
    spare = float(weight.sum() - weight @ weight / weight.sum())
    effect = max(left / spare, 0.0) if len(found) > 1 else 0.0
    return mean_scale(measured, spread=effect**0.5)


def bias_at_rest(flight: FlightData) -> Measured:
    """Return the accelerometer's bias along the vertical, by its reading at rest [m/s^2]."""
    rest = gravity_at_rest(flight)
    before = Measured(value=0.0, std=ACCEL_BIAS_STD)
    if rest is None:
        return before
    return before.with_other(Measured(value=(rest - 1.0) * GRAVITY, std=REST_STD))
