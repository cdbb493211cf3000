"""Flights that hardly turn leave inertia open, and nothing else with it."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.flight.flight_data import FlightData

MASS, KT, RATE = 1.4, 2e-6, 100.0
NOTHING: tuple[str, ...] = ()


def climbs_without_turns(seed):
    """Return 40 s of thrust steps; turns and differences between the rotors are noise alone."""
    time = np.arange(round(40 * RATE)) / RATE
    rng = np.random.default_rng(seed)
    hover = MASS * 9.80665 / (4 * KT)
    alike = 1.0 + 0.1 * np.cos(2 * np.pi * 0.83 * time)[:, None]
    squares = hover * alike * (1.0 + rng.normal(scale=0.002, size=(len(time), 4)))
    noise = rng.normal(scale=0.1, size=(len(time), 3))
    level = np.stack([0 * time, 0 * time, KT * squares.sum(axis=1) / MASS], axis=1)
    data = FlightData(
        sample_rate=RATE,
        time=time,
        specific_force=level + rng.normal(scale=0.05, size=(len(time), 3)),
        angular_velocity=np.cumsum(noise, axis=0) / RATE,
        angular_acceleration=noise,
        rotor_speed=np.sqrt(squares),
        rotor_acceleration=np.gradient(np.sqrt(squares), axis=0) * RATE,
        differentiation="exact",
        segments=made_fit.prepared(seconds=40.0).data.segments,
    )
    flight = replace(
        made_fit.prepared(seconds=40.0),
        data=data,
        phases=data.segments,
        motor_channel=data.rotor_speed,
    )
    return made_fit.dataset(flight, mass=MASS, motors=MotorsEntry(speed="measured", delay=0.0))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_open_inertia_leaves_thrust_to_no_rounding(seed):
    """An endless inertia had a condition number of 2e15: rounding decided about k_t's interval."""
    fit = fit_flights(climbs_without_turns(seed), NOTHING)
    assert fit.estimate.estimate.condition_number < 1e10
    kt, half = fit.numbers.number("kt")
    assert abs(kt - KT) < half < 0.05 * KT
    # Inertia stays open: the prior is a hundred bodies wide.
    assert fit.estimate.estimate.std[fit.estimate.estimate.names.index("Ixx@A")] > MASS * 0.25**2
