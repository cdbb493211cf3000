"""Manoeuvres flown at once are those of the simulator that flies one at a time."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.errors import ExperimentError
from rotorfit.simulation import Scenario, Truth, calm_flights, paper_vehicle, simulate_flight
from rotorfit.simulation.calm_flights import simulate_calm_flights
from rotorfit.simulation.pilot import MANOEUVRES
from rotorfit.tools.planning.after import PRACTICE

PAPER = paper_vehicle("A")
TRUTH = Truth(
    mass=1.285,
    first_moments=(0.003, -0.004, -0.012),
    inertia=(0.0101, 0.0113, 0.0174, 2e-4, -1e-4, 3e-4),
    kt=1.5e-5,
    kd=2.2e-7,
    Jr=1.7e-5,
    kt_spread=(1.02, 0.99, 1.01, 0.98),
    motor_lag=0.035,
)
SIGNALS = (
    *("angular_velocity", "angular_acceleration", "specific_force", "rotor_speed"),
    *("rotor_acceleration", "commanded_speed", "position", "velocity", "reference"),
)


def test_calm_flights_are_those_of_the_general_simulator() -> None:
    scenario = Scenario(seconds=6.0, sample_rate=100.0)
    sticks = [MANOEUVRES[manoeuvre] for manoeuvre in PRACTICE]
    together = simulate_calm_flights(TRUTH, PAPER.vehicle, scenario, sticks=sticks, seed=3)
    for stick, flight in zip(sticks, together, strict=True):
        alone = simulate_flight(TRUTH, PAPER.vehicle, replace(scenario, sticks=stick), seed=3)
        for name in SIGNALS:
            found, right = getattr(flight, name), getattr(alone, name)
            assert np.abs(found - right).max() < 0.01 * np.abs(right).max(), name


def test_the_error_falls_with_the_square_of_the_step() -> None:
    def error(rate: float) -> float:
        scenario = Scenario(seconds=4.0, sample_rate=rate, sticks=MANOEUVRES["turns"])
        flight = simulate_calm_flights(
            TRUTH, PAPER.vehicle, scenario, sticks=[scenario.sticks], seed=3
        )[0]
        alone = simulate_flight(TRUTH, PAPER.vehicle, scenario, seed=3)
        return float(np.abs(flight.angular_velocity - alone.angular_velocity).max())

    assert error(400.0) < 0.1 * error(100.0)


def test_pieces_fly_as_the_whole_does(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = Scenario(seconds=12.0, sample_rate=100.0)
    sticks = [MANOEUVRES[manoeuvre] for manoeuvre in PRACTICE]
    whole = simulate_calm_flights(TRUTH, PAPER.vehicle, scenario, sticks=sticks, seed=3)
    steps: list[int] = []
    advance = calm_flights._advance_step

    def counted(*given: object) -> None:
        steps.append(1)
        advance(*given)

    monkeypatch.setattr(calm_flights, "_advance_step", counted)
    pieces = simulate_calm_flights(TRUTH, PAPER.vehicle, scenario, sticks=sticks, seed=3, piece=2.0)
    assert len(steps) == round((2.0 + calm_flights.SETTLING) * 100.0)
    rates = [(p.angular_velocity, q.angular_velocity) for p, q in zip(whole, pieces, strict=True)]
    usual = max(float(np.linalg.norm(right)) for right, _ in rates)
    for right, found in rates:
        assert np.linalg.norm(found - right) < 0.06 * usual


@pytest.mark.parametrize(
    "change",
    [{"motor_lag": 0.0, "Jr": 0.0}, {"motor_delay": 0.01}, {"drag": (0.1, 0.1, 0.0)}],
)
def test_what_a_calm_flight_leaves_out_is_refused(change: dict[str, object]) -> None:
    truth = replace(TRUTH, **change)
    scenario = Scenario(seconds=1.0, sample_rate=100.0)
    with pytest.raises(ExperimentError):
        simulate_calm_flights(truth, PAPER.vehicle, scenario, sticks=[scenario.sticks], seed=1)
