"""The lateness of an accelerometer's low-pass, which is taken off before the motors are timed."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fast_worlds import draw_world, experiment_text

import made_fit
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.reduction.bandwidth import Bandwidth
from rotorfit.fit.timing.sensor_bandwidth import measure_bandwidths, take_off_lateness
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.identification import identify_flights
from rotorfit.simulation import simulate_flight, write_flight_table
from rotorfit.simulation.experiment_files import true_parameters

CUTOFF = 4.8


@pytest.fixture(scope="module")
def filtered(tmp_path_factory):
    """A fast flight behind a low-pass that makes forces 47 ms late; what is found, and its J_r."""
    folder, world = tmp_path_factory.mktemp("late"), draw_world(90431, 35, seconds=25.0)
    assert world.scenario.sensors.accel_cutoff == pytest.approx(CUTOFF, abs=0.01)
    flight = simulate_flight(world.truth, world.vehicle, world.scenario, seed=world.index)
    channels = ("gyro", "accel", "rotor_speed", "velocity")
    write_flight_table(flight, folder / "flight.csv", channels=channels)
    (folder / "world.toml").write_text(experiment_text(world), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = identify_flights(load_experiment(folder / "world.toml"))
    return found, true_parameters(world.truth, rotors=4)["Jr_over_Izz"]


def test_a_late_accelerometer_does_not_time_the_motors(filtered):
    """Of nine such worlds the delay is within 3 ms; it was 9 to 50 ms, as late as the force."""
    found, _ = filtered
    timing = found.dataset.motor_timing
    assert timing is not None
    assert abs(timing.response.delay) < 0.004


def test_the_rotors_inertia_does_not_make_up_for_it(filtered):
    found, truth = filtered
    (ratio,) = (n for n in found.result.derived if n.name == "Jr_over_Izz")
    assert ratio.interval[0] < truth < ratio.interval[1]
    assert ratio.verdict == "identified"


def test_a_low_pass_that_was_taken_off_is_named(filtered, assert_wording):
    """A Butterworth delays slow motion by the root of 2 over 2 pi times its cut-off: 47 ms."""
    found, _ = filtered
    (said,) = (one for one in found.result.findings if one.kind == "accelerometer-filtered")
    assert said.severity == "note"
    assert said.flights == ("flight.csv",)
    assert said.evidence[0].value == pytest.approx(CUTOFF, rel=0.1)
    assert "47 ms" in said.sentence
    assert_wording(said.sentence)


def test_a_low_pass_that_was_taken_off_is_not_measured_again(filtered):
    found, _ = filtered
    (flight,) = found.dataset.configurations[0].flights
    low_pass = flight.bandwidths["accel"]
    assert low_pass.taken_off
    assert low_pass.cutoff == pytest.approx(CUTOFF, rel=0.1)
    again = measure_bandwidths(found.dataset)
    assert again.configurations[0].flights[0].bandwidths["accel"] is low_pass
    assert take_off_lateness(again) is again


@pytest.mark.parametrize(
    ("shape", "source", "is_moved"),
    [
        ("first order", "imu", True),
        ("second order", "imu", True),
        ("smoothed", "imu", False),
        ("second order", "mocap", False),
    ],
)
def test_only_an_imu_behind_a_filter_on_board_is_late(shape, source, is_moved):
    low_pass = Bandwidth(shape=shape, cutoff=5.0, interval=(4.0, 6.0), delay=0.0, gain=100.0)
    dataset = TimedDataset.of(made_fit.dataset(made_fit.prepared()))
    (configuration,) = dataset.configurations
    flights = [replace(one, bandwidths={"accel": low_pass}) for one in configuration.flights]
    dataset = replace(
        dataset, source=source, configurations=(replace(configuration, flights=flights),)
    )
    moved = take_off_lateness(dataset)
    before, after = (
        one.configurations[0].flights[0].prepared.data.specific_force for one in (dataset, moved)
    )
    assert np.array_equal(before, after) is not is_moved
    assert (moved is dataset) is not is_moved
