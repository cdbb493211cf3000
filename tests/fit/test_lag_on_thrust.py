"""What the motors' lag acts on, their speed or their thrust: by the flight where nobody says it."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, write_flight_table
from rotorfit.simulation.pilot import Stick, Sticks

LAG = 0.04
BRISK = Stick(band=(0.3, 3.0), rms=0.3)


@pytest.fixture(scope="module")
def lagging_thrust():
    """Return a flight with the commands that motors whose thrust lags would have had.

    They are made of the speeds that were flown: T' = (u^2 - T) / lag over each sample.
    """
    flight = flown.simulated(
        "quad-x", "noisy", seed=4, seconds=20.0, sticks=Sticks(roll=BRISK, pitch=BRISK)
    )
    kept = np.exp(-float(np.diff(flight.time[:2])[0]) / LAG)
    thrust = flight.rotor_speed**2
    command = thrust.copy()
    command[:-1] = (thrust[1:] - kept * thrust[:-1]) / (1.0 - kept)
    return replace(flight, commanded_speed=np.sqrt(np.maximum(command, 0.0)))


def identified(folder, flight, motors=""):
    table = folder / "flight.csv"
    table.unlink(missing_ok=True)
    write_flight_table(flight, table, channels=IMU_AND_COMMAND)
    law = f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0, {flight.max_speed}] }}\n'
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [table],
        mass=flight.truth.mass,
        extra=law + motors,
    )
    return flown.quietly_identified(path)


def said(result):
    return [one for one in result.findings if one.kind == "lag-on-thrust"]


def test_lag_of_thrust_is_found_by_the_flight(tmp_path, lagging_thrust):
    flight = lagging_thrust
    result = identified(tmp_path, flight)
    (found,) = said(result)
    assert "acts on their thrust" in found.sentence
    assert found.evidence[0].value > 50.0
    assert result.parameter("motor_lag").value == pytest.approx(LAG, abs=0.002)
    for name, true in zip(
        ("Ixx_com", "Iyy_com"), np.diagonal(flight.truth.com_inertia), strict=False
    ):
        number = result.derived_value(name)
        assert number.value == pytest.approx(true, rel=0.01)
        assert number.interval[0] < true < number.interval[1]


def test_what_is_declared_stands(tmp_path, lagging_thrust):
    declared = identified(tmp_path, lagging_thrust, 'lag_on = "speed"\n')
    assert not said(declared)
    assert declared.parameter("motor_lag_down").value > declared.parameter("motor_lag_up").value
    told = identified(tmp_path, lagging_thrust, 'lag_on = "thrust"\n')
    assert not said(told)
    assert told.parameter("motor_lag").value == pytest.approx(LAG, abs=0.002)


@pytest.mark.parametrize("down", [None, 0.06])
def test_lag_of_speed_stays_one(tmp_path, down):
    flown_by, sensors = flown.variant(flown.simulated_vehicle("quad-x"), "noisy")
    truth, vehicle = flown_by
    truth = replace(truth, motor_lag=LAG, motor_lag_down=down)
    sticks = Sticks(roll=BRISK, pitch=BRISK)
    scenario = flown.Scenario(seconds=20.0, sensors=sensors, sticks=sticks)
    result = identified(tmp_path, flown.simulate_flight(truth, vehicle, scenario, seed=4))
    assert not said(result)
    if down is not None:
        assert result.parameter("motor_lag_down").value == pytest.approx(down, abs=0.005)
