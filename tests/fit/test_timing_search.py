"""Lag and delay of commanded motors are found from the flight, without being told."""

import warnings
from dataclasses import replace
from functools import cache

import pytest

import flown
from rotorfit.checks.verdicts.parameters import motor_parameters
from rotorfit.errors import FlightWarning
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import MotorsEntry, load_experiment
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import find_timing
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.identification import identify
from rotorfit.results.validation.validate import fitted_response, validate_file
from rotorfit.simulation import (
    STILL,
    Scenario,
    Sensors,
    Sticks,
    paper_vehicle,
    simulate_flight,
    variant,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import experiment_files
from rotorfit.simulation.experiments import plan_experiment


@pytest.fixture(scope="module")
def flown_on_commands(tmp_path_factory):
    """Return the folder of a flight on commands, and what is identified from it."""
    folder = tmp_path_factory.mktemp("commands")
    plan = plan_experiment("single", "noisy", seed=4, seconds=20.0)
    for name, text in experiment_files(plan).items():
        (folder / name).write_text(text, newline="\n")
    assert "lag =" not in (folder / "experiment.toml").read_text()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return folder, identify(load_experiment(folder / "experiment.toml"))


def test_lag_plus_delay_is_sharp(flown_on_commands):
    _, result = flown_on_commands
    total = result.derived_value("motor_lag_total")
    assert total.value == pytest.approx(0.050, abs=1e-3)
    low, high = total.interval
    assert low < 0.050 < high


def test_the_split_is_found_too(flown_on_commands):
    _, result = flown_on_commands
    assert result.parameter("motor_lag").value == pytest.approx(0.040, abs=0.004)
    assert result.parameter("motor_delay").value == pytest.approx(0.010, abs=0.004)


def test_validation_uses_the_lag_that_was_found(flown_on_commands):
    folder, result = flown_on_commands
    comparison = validate_file(result, folder / "A2.csv")
    # Without the lag these are a third of the wrench and more.
    assert comparison.relative_error["Mx"] < 0.05
    assert comparison.relative_error["My"] < 0.05


@pytest.fixture(scope="module")
def slow_to_fall():
    """Return a flight whose rotors fall at half the rate at which they rise."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")
    truth = replace(truth, motor_lag=0.03, motor_lag_down=0.06, motor_delay=0.01)
    scenario = Scenario(seconds=20.0, ground_seconds=2.0, sensors=sensors, physics_rate=400.0)
    return simulate_flight(truth, vehicle, scenario, seed=8)


def commanded(folder, flight, motors):
    write_flight_table(flight, folder / "flight.csv", channels=("gyro", "accel", "command"))
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [folder / "flight.csv"],
        mass=flight.truth.mass,
        extra=f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0, {flight.max_speed}] }}\n'
        + motors,
    )
    return flown.quietly_identified(path)


def test_different_rising_and_falling_lags_are_separated(tmp_path, slow_to_fall):
    result = commanded(tmp_path, slow_to_fall, "")
    assert result.parameter("motor_lag_up").value == pytest.approx(0.03, abs=0.005)
    assert result.parameter("motor_lag_down").value == pytest.approx(0.06, abs=0.005)
    assert result.parameter("motor_lag").value == pytest.approx(0.045, abs=0.004)
    # The log holds a command for one sample of 5 ms before the gyro shows anything of it.
    assert result.derived_value("motor_lag_total").value == pytest.approx(0.055, abs=3e-3)
    Ixx = result.derived_value("Ixx_com")
    assert Ixx.value == pytest.approx(slow_to_fall.truth.com_inertia[0, 0], rel=0.01)
    assert Ixx.interval[0] < slow_to_fall.truth.com_inertia[0, 0] < Ixx.interval[1]


def test_equal_lags_are_reported_as_one(flown_on_commands):
    _, result = flown_on_commands
    assert not [p.name for p in result.parameters if p.name in ("motor_lag_up", "motor_lag_down")]


def test_a_bench_lag_is_a_prior_or_a_fact(flown_on_commands):
    """As far as the timing goes: what is fitted with it is the same as ever."""
    folder, free = flown_on_commands
    loaded = TimedDataset.of(
        load_dataset(load_experiment(folder / "experiment.toml"), lambda words: None)
    )

    def with_motors(**said):
        motors = MotorsEntry(speed="commanded", law=loaded.motors.law, **said)
        timing = find_timing(replace(loaded, motors=motors))
        return timing, {p.name: p for p in motor_parameters(motors, timing)}

    timing, prior = with_motors(lag=0.030, lag_std=0.0005)
    lag = prior["motor_lag"]
    assert 0.030 < lag.value < 0.5 * (0.030 + free.parameter("motor_lag").value)
    assert lag.verdict == "identified"
    assert timing.response.lag + timing.response.delay == pytest.approx(0.050, abs=2e-3)
    _, fact = with_motors(lag=0.030)
    assert fact["motor_lag"].verdict == "given"
    assert fact["motor_delay"].value == pytest.approx(0.020, abs=2e-3)
    _, known = with_motors(delay=0.010)
    assert known["motor_delay"].verdict == "given"
    assert known["motor_lag"].value == pytest.approx(0.040, abs=1e-3)


@pytest.fixture(scope="module")
def hovered_in_gusts():
    """Return a hover whose rotors do nothing but answer gusts and the noise of the gyro."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(
        seconds=30.0, ground_seconds=2.0, sensors=sensors, sticks=STILL, gyro_noise_in_loop=True
    )
    return simulate_flight(truth, vehicle, scenario, seed=12)


@pytest.fixture(scope="module")
def of_the_hover(tmp_path_factory, hovered_in_gusts):
    """Return what is identified of it."""
    return commanded(tmp_path_factory.mktemp("hover"), hovered_in_gusts, "")


def test_a_hover_on_commands_does_not_show_lag_nor_delay(
    of_the_hover, hovered_in_gusts, assert_wording
):
    """What the autopilot answers comes after the gust: it looks like motors that are late."""
    result = of_the_hover
    for name in ("motor_lag", "motor_delay"):
        time = result.parameter(name)
        assert (time.value, time.interval, time.verdict) == (None, None, "not-identified")
        assert "20 s" in time.advice
        assert_wording(time.advice)
    assert result.derived_value("motor_lag_total").value is None
    kt, truth = result.parameter("kt"), hovered_in_gusts.truth
    assert kt.interval[0] < truth.kt < kt.interval[1]


@pytest.mark.parametrize("seed", [pytest.param(13, marks=pytest.mark.slow), 15])
def test_hovers_that_do_not_settle_show_nothing_either(tmp_path, seed):
    """One fit runs away to bodies without end, which no rotor moves; the other to late motors."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(
        seconds=30.0, ground_seconds=2.0, sensors=sensors, sticks=STILL, gyro_noise_in_loop=True
    )
    result = commanded(tmp_path, simulate_flight(truth, vehicle, scenario, seed=seed), "")
    assert result.parameter("motor_lag").verdict == "not-identified"
    assert [p.name for p in result.parameters if p.name in ("Ixx", "Iyy", "Jr") and p.value] == []


def test_a_hover_is_validated_at_the_usual_lag(of_the_hover):
    assert fitted_response(of_the_hover) == MotorResponse(lag=LAG_PRIOR[0])


def test_how_long_a_command_held_is_in_the_intervals(tmp_path):
    """The log keeps every fifth command: at 100 Hz the delay comes out up to 5 ms small."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")
    truth = replace(truth, motor_lag=0.03, motor_delay=0.005)
    scenario = Scenario(seconds=20.0, ground_seconds=2.0, sensors=sensors)
    flight = simulate_flight(truth, vehicle, scenario, seed=9)
    write_flight_table(flight, tmp_path / "whole.csv", channels=("gyro", "accel", "command"))
    names, *rows = (tmp_path / "whole.csv").read_text().splitlines()
    (tmp_path / "flight.csv").write_text("\n".join([names, *rows[::2]]) + "\n")
    path = flown.experiment_file(
        tmp_path / "experiment.toml",
        flight.vehicle,
        [tmp_path / "flight.csv"],
        mass=truth.mass,
        extra=f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0, {flight.max_speed}] }}\n',
    )
    low, high = flown.quietly_identified(path).derived_value("motor_lag_total").interval
    assert low < 0.035 < high
    assert high - low < 0.016


def test_a_gentle_flight_in_gusts_does_not_make_its_speeds_late(tmp_path):
    """The autopilot's answer to gusts comes after them; 6 ms late without what it answers."""
    body, full = paper_vehicle("A"), Sticks()
    truth = replace(
        body.truth,
        disturbance_force_std=(0.1, 0.1, 0.1),
        disturbance_torque_std=(6e-3, 6e-3, 1.5e-3),
    )
    gentle = {
        name: replace(getattr(full, name), rms=0.25 * getattr(full, name).rms)
        for name in ("roll", "pitch", "yaw", "climb")
    }
    sensors = Sensors(gyro_std=0.02, accel_std=0.4, rotor_speed_std=1.0)
    scenario = Scenario(seconds=25.0, ground_seconds=2.0, sticks=Sticks(**gentle), sensors=sensors)
    flight = simulate_flight(truth, body.vehicle, scenario, seed=303)
    write_flight_table(flight, tmp_path / "flight.csv")
    path = tmp_path / "experiment.toml"
    flown.experiment_file(path, body.vehicle, [tmp_path / "flight.csv"], mass=truth.mass)
    delay = flown.quietly_identified(path).parameter("motor_delay")
    assert abs(delay.value) < 2e-3  # there is none
    assert delay.interval[0] < 0.0 < delay.interval[1]
    assert delay.interval[1] - delay.interval[0] < 8.5e-3


@cache
def late_flight(seed):
    """Return a flight of 20 s whose motors have a lag of 40 and a delay of 10 ms."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")
    truth = replace(truth, motor_lag=0.04, motor_delay=0.01)
    scenario = Scenario(seconds=20.0, ground_seconds=2.0, sensors=sensors)
    return simulate_flight(truth, vehicle, scenario, seed=seed)


def timing_of(folder, *, seed, channels, motors=""):
    """Return the timing of that flight as some channels show it."""
    flight = late_flight(seed)
    write_flight_table(flight, folder / "flight.csv", channels=channels)
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [folder / "flight.csv"],
        mass=flight.truth.mass,
        extra=motors and f"{motors}law = {{ linear = [0, {flight.max_speed}] }}\n",
    )
    return find_timing(TimedDataset.of(load_dataset(load_experiment(path), lambda words: None)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_lag_and_delay_of_commands_are_found_within_deviations(tmp_path, seed):
    """Their sum to .1 ms: the simulation holds every command as the log says."""
    commanded = '[motors]\nspeed = "commanded"\n'
    found = timing_of(tmp_path, seed=seed, channels=("gyro", "accel", "command"), motors=commanded)
    assert found.free == ("motor_lag", "motor_delay")
    response = found.response
    assert response.lag + response.delay == pytest.approx(0.050, abs=3e-4)
    assert abs(response.lag - 0.040) < 2.0 * found.lag_std < 3e-3
    assert abs(response.delay - 0.010) < 2.0 * found.delay_std < 4e-3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_measured_speeds_have_no_delay_beyond_its_deviation(tmp_path, seed):
    found = timing_of(tmp_path, seed=seed, channels=("gyro", "accel", "rotor_speed"))
    assert found.free == ("motor_delay",)
    assert abs(found.response.delay) < 2.0 * found.delay_std < 2e-3
