"""Exact flights give back exact parameters; sampled ones up to the error of a difference."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.least_squares import ordinary
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.fit.reduction.reduce import time_factors
from rotorfit.model.regressor import regressor
from rotorfit.simulation import (
    Scenario,
    exact_flight_data,
    sampled_flight_data,
    simulate_flight,
)

BODY = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
FREE = ("kt", "kd", "Jr", *BODY)


@pytest.fixture(scope="module")
def flights():
    """Return one exact flight of each vehicle, its rotors with inertia."""
    flights = {}
    for name in flown.VEHICLES:
        truth, vehicle = flown.simulated_vehicle(name)
        truth = replace(truth, Jr=2e-5)
        flights[name] = simulate_flight(truth, vehicle, Scenario(seconds=20.0), seed=4)
    return flights


def true_values(truth):
    return {
        **dict(zip(BODY, (*truth.first_moments, *truth.inertia), strict=True)),
        "kt": truth.kt,
        "kd": truth.kd,
        "Jr": truth.Jr,
    }


def solved(data, flight, free):
    model = regressor(flight.vehicle)
    problem = LinearProblem(
        factors=(time_factors(data, flight.vehicle),),
        tensors=(model.tensor,),
        map=parameter_map(
            model.names, {name: {(0, name): 1.0} for name in free}, {(0, "mass"): flight.truth.mass}
        ),
        weights=np.ones((1, 6)),
    )
    estimate = ordinary(problem)
    return dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def relative_errors(found, truth):
    """Return errors against the truth, products and first moments against their own scale."""
    true = true_values(truth)
    scale = {name: abs(value) for name, value in true.items()}
    scale |= dict.fromkeys(("Ixy", "Ixz", "Iyz"), true["Ixx"])
    scale |= dict.fromkeys(("msx", "msy", "msz"), 0.2 * truth.mass)
    return {name: abs(value - true[name]) / scale[name] for name, value in found.items()}


@pytest.mark.parametrize("name", flown.VEHICLES)
def test_exact_flights_are_recovered_to_rounding(flights, name):
    flight = flights[name]
    data = exact_flight_data(flight, flight.vehicle, specific_force_at="imu")
    errors = relative_errors(solved(data, flight, FREE), flight.truth)
    assert max(errors.values()) < 1e-9, errors


@pytest.mark.parametrize("name", flown.VEHICLES)
def test_central_differences_cost_little(flights, name):
    flight = flights[name]
    errors = relative_errors(solved(sampled_flight_data(flight), flight, FREE), flight.truth)
    assert errors["kt"] < 1e-5
    assert max(errors["Ixx"], errors["Iyy"]) < 2e-3
    assert errors["Izz"] < 1e-2


def test_a_wrong_arm_scales_moments_and_not_thrust(flights):
    flight = flights["A"]
    grown = [replace(r, position=tuple(1.1 * p for p in r.position)) for r in flight.vehicle.rotors]
    wrong = replace(flight, vehicle=replace(flight.vehicle, rotors=tuple(grown)))
    found = solved(exact_flight_data(wrong, wrong.vehicle), wrong, FREE)
    assert found["kt"] == pytest.approx(flight.truth.kt, rel=0.02)
    assert found["Ixx"] == pytest.approx(1.1 * flight.truth.inertia[0], rel=0.02)
