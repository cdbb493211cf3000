"""An autopilot that answers gusts and the noise of its gyro is not taken for the motors' delay."""

import numpy as np
import pytest

import flown
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, write_flight_table

SEEDS, FIRST = range(1, 6), 2


def fly_and_identify(folder, seeds):
    return flown.runs(
        folder,
        "disturbed",
        seeds=seeds,
        seconds=60.0,
        gyro_noise_in_loop=True,
        physics_rate=200.0,
    )


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return fly_and_identify(tmp_path_factory.mktemp("first"), SEEDS[:FIRST])


@pytest.fixture(scope="module")
def five_runs(runs, tmp_path_factory):
    return runs + fly_and_identify(tmp_path_factory.mktemp("rest"), SEEDS[FIRST:])


@pytest.mark.slow
def test_the_delay_is_not_that_of_the_autopilot_s_response(five_runs):
    """Over all frequencies the likelihood is highest at 8 ms; in truth there is none."""
    delays = np.array([result.parameter("motor_delay").value for _, result in five_runs])
    assert abs(delays.mean()) < 1.5e-3
    assert np.abs(delays).max() < 4e-3


def test_intervals_hold_what_the_autopilot_s_response_would_hide(runs):
    held = [
        interval[0] <= true <= interval[1]
        for flight, result in runs
        for interval, true in (
            (result.derived_value("Ixx_com").interval, flight.truth.com_inertia[0, 0]),
            (result.derived_value("Iyy_com").interval, flight.truth.com_inertia[1, 1]),
            (result.parameter("motor_delay").interval, flight.truth.motor_delay),
        )
    ]
    assert np.mean(held) >= 0.85


@pytest.fixture(scope="module")
def commanded(tmp_path_factory):
    """From commands alone: upwards of 8 Hz they are nothing but what the gyro's noise asks for."""
    folder = tmp_path_factory.mktemp("steered-commands")
    found = []
    for seed in (1, 2):
        flight = flown.simulated(
            "A", "real", seed=seed, seconds=45.0, gyro_noise_in_loop=True, physics_rate=200.0
        )
        log = folder / f"{seed}.csv"
        write_flight_table(flight, log, channels=IMU_AND_COMMAND)
        full = flight.max_speed
        path = flown.experiment_file(
            folder / f"{seed}.toml",
            flight.vehicle,
            [log],
            mass=flight.truth.mass,
            extra=f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0.0, {full!r}] }}\n',
        )
        found.append((flight, flown.quietly_identified(path)))
    return found


def test_response_to_gyro_noise_is_not_mistaken_for_motor_delay(commanded):
    """That would be a lag of 4 to 10 ms and a delay of 30, with deviations of half of one."""
    for flight, result in commanded:
        lag = result.parameter("motor_lag")
        assert abs(lag.value - flight.truth.motor_lag) < 0.015
        kt = result.parameter("kt")
        assert kt.interval[0] <= flight.truth.kt <= kt.interval[1]
