"""Steady wind leans the vehicle: without its velocity, thrust and balance mislead."""

import dataclasses

import pytest

import flown
from rotorfit.simulation import Scenario, simulate_flight, variant


@pytest.fixture(scope="module", params=[1, 2])
def result(request, tmp_path_factory):
    """Identify a flight in wind of 8 m/s, its velocity not logged."""
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("quad-x"), "real")
    truth = dataclasses.replace(
        truth, wind=(8.0, 2.0, 0.0), rotor_drag=2e-5, drag=(0.15, 0.15, 0.05)
    )
    flight = simulate_flight(
        truth, vehicle, Scenario(seconds=40.0, sensors=sensors), seed=request.param
    )
    return flown.identified(tmp_path_factory.mktemp("wind"), [flight])


def test_numbers_that_lean_are_doubtful(result):
    """k_t was two half-widths off and `identified` (rms of six flights)."""
    [lean] = [one for one in result.findings if one.kind == "imu-leans"]
    assert lean.severity == "doubt"
    verdicts = {name: result.parameter(name).verdict for name in ("kt", "kd", "msx", "msy")}
    assert set(verdicts.values()) == {"doubtful"}


def test_inertia_of_roll_and_pitch_is_not(result):
    assert result.parameter("Ixx").verdict == "identified"
    assert result.parameter("Iyy").verdict == "identified"
