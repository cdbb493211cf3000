"""Where a smoothed accelerometer is from the centre of mass: found by the measured turns."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fast_worlds import draw_world, experiment_text
from scipy.ndimage import gaussian_filter1d

from rotorfit.fit.dataset.load import ignore_progress, load_dataset
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.joint.joint_problem import COM_HEIGHT
from rotorfit.fit.reduction.bandwidth import Bandwidth
from rotorfit.fit.sensors.sensor_place import (
    SensorPlace,
    is_off_centre,
    measure_place,
    place_sensor,
)
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.simulation import simulate_flight, write_flight_table

CUTOFF = 3.0
SMOOTHING = Bandwidth(
    shape="smoothed", cutoff=CUTOFF, interval=(CUTOFF, CUTOFF), delay=0.0, gain=100.0
)


@pytest.fixture(scope="module")
def smoothed(tmp_path_factory):
    """A fast flight, its IMU at an undeclared place and smoothed; and the true place."""
    folder, world = tmp_path_factory.mktemp("smoothed"), draw_world(11, 7, seconds=25.0)
    arm = world.vehicle.arm
    vehicle = replace(world.vehicle, imu_position=(-0.2 * arm, 0.25 * arm, 0.2 * arm))
    sensors = replace(world.scenario.sensors, accel_cutoff=0.0)
    flight = simulate_flight(world.truth, vehicle, replace(world.scenario, sensors=sensors), seed=7)
    channels = ("gyro", "accel", "rotor_speed", "velocity")
    # A Gaussian whose gain is .71 at the cut-off.
    width = np.sqrt(np.log(2.0)) / (2.0 * np.pi * CUTOFF) * flight.sample_rate
    smooth = gaussian_filter1d(flight.accel, width, axis=0)
    write_flight_table(replace(flight, accel=smooth), folder / "flight.csv", channels=channels)
    lines = experiment_text(world).splitlines()
    text = "\n".join(line for line in lines if not line.startswith("imu"))
    (folder / "world.toml").write_text(text, encoding="utf-8")
    experiment = load_experiment(folder / "world.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = TimedDataset.of(load_dataset(experiment, ignore_progress))
    com = np.array(world.truth.first_moments) / world.truth.mass
    return experiment, dataset, np.array(vehicle.imu_position) - com


def with_bandwidth(dataset, found):
    (configuration,) = dataset.configurations
    flights = [replace(f, bandwidths=found) for f in configuration.flights]
    return replace(dataset, configurations=(replace(configuration, flights=flights),))


def test_turns_show_where_a_smoothed_accelerometer_is(smoothed):
    experiment, dataset, true = smoothed
    dataset = with_bandwidth(dataset, {"accel": SMOOTHING})
    place = measure_place(dataset)
    assert place.position == pytest.approx(true, abs=0.012)
    assert np.abs(place.position - true).max() < 2.5 * place.position_std
    declared, moved, (finding,) = place_sensor(experiment, dataset)
    assert declared.airframe.imu.position == pytest.approx(place.position, abs=1e-4)
    assert moved.vehicle.imu_position == pytest.approx(place.position, abs=1e-4)
    assert moved.vehicle.tolerances[COM_HEIGHT] == pytest.approx(0.2 * dataset.vehicle.arm)
    assert finding.kind == "sensor-place"


def test_the_place_is_declared_in_the_axes_of_the_airframe(smoothed):
    experiment, dataset, _ = smoothed
    dataset = with_bandwidth(dataset, {"accel": SMOOTHING})
    forward, left, up = measure_place(dataset).position
    airframe = experiment.airframe.model_copy(update={"axes": "FRD"})
    frd = experiment.model_copy(update={"airframe": airframe})
    declared = place_sensor(frd, dataset)[0]
    assert declared.airframe.imu.position == pytest.approx((forward, -left, -up), abs=1e-4)


def test_an_accelerometer_that_shows_turns_is_left_to_the_fit(smoothed):
    experiment, dataset, _ = smoothed
    fast = replace(SMOOTHING, cutoff=30.0, interval=(30.0, 30.0))
    on_board = replace(SMOOTHING, shape="second order")
    for found in ({}, {"accel": fast}, {"accel": on_board}):
        other = with_bandwidth(dataset, found)
        assert place_sensor(experiment, other) == (experiment, other, ())


@pytest.mark.parametrize(
    ("height", "std", "explained", "beside"),
    [
        (0.03, 0.002, 0.5, True),
        (0.03, 0.01, 0.5, False),
        (0.01, 0.001, 0.5, False),
        (0.03, 0.002, 0.1, False),
    ],
)
def test_a_place_counts_where_it_is_sure_and_far(height, std, explained, beside):
    place = SensorPlace(
        position=np.array([0.0, 0.0, height]), std=np.full(3, std), explained=explained
    )
    assert is_off_centre(place, 0.2) is beside
