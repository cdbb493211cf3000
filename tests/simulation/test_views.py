import csv
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.flight.flight_data import Segment
from rotorfit.simulation import (
    Sensors,
    exact_flight_data,
    flight_table,
    measure,
    paper_vehicle,
    sampled_flight_data,
    to_flight_log,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import runs


def test_exact_data_are_the_states_at_the_origin_or_at_the_imu(rough_flight):
    flight = rough_flight
    data = exact_flight_data(flight, flight.vehicle)
    assert data.differentiation == "exact"
    assert data.segments == (Segment(start=0, stop=flight.time.size),)
    np.testing.assert_array_equal(data.specific_force, flight.specific_force)
    np.testing.assert_array_equal(data.angular_acceleration, flight.angular_acceleration)
    np.testing.assert_array_equal(data.rotor_acceleration, flight.rotor_acceleration)
    at_imu = exact_flight_data(flight, flight.vehicle, specific_force_at="imu")
    np.testing.assert_allclose(at_imu.specific_force, flight.specific_force_imu, rtol=1e-13)


def test_exact_data_refuse_another_vehicle(rough_flight):
    with pytest.raises(ExperimentError, match="has 6 rotors, the vehicle 4"):
        exact_flight_data(rough_flight, paper_vehicle("A").vehicle)


def test_sampled_data_difference_over_two_samples(rough_flight):
    data, dt = sampled_flight_data(rough_flight), 1 / rough_flight.sample_rate
    w = rough_flight.angular_velocity
    assert data.differentiation == "central"
    assert data.segments == (Segment(start=1, stop=w.shape[0] - 1),)
    np.testing.assert_allclose(data.angular_acceleration[7], (w[8] - w[6]) / (2 * dt))
    O = rough_flight.rotor_speed
    np.testing.assert_allclose(data.rotor_acceleration[7], (O[8] - O[6]) / (2 * dt))
    np.testing.assert_array_equal(data.specific_force, rough_flight.specific_force_imu)
    assert data.rotor_speed_std == 0.0


def test_sampled_data_of_the_sensors(rough_flight):
    sensors = Sensors(gyro_std=0.02, rotor_speed_std=3.0, rotor_speed_resolution=4.0 * 12**0.5)
    noisy = measure(rough_flight, sensors, seed=1)
    data = sampled_flight_data(noisy, signals="measured")
    np.testing.assert_array_equal(data.angular_velocity, noisy.gyro)
    np.testing.assert_array_equal(data.rotor_speed, noisy.rotor_speed_measured)
    assert data.rotor_speed_std == pytest.approx(5.0)
    assert sampled_flight_data(noisy).rotor_speed_std == 0.0


def test_velocity_is_in_body_axes(rough_flight):
    data = exact_flight_data(rough_flight, rough_flight.vehicle)
    assert data.velocity is not None
    back = rough_flight.rotation_body_to_world.apply(data.velocity)
    np.testing.assert_allclose(back, rough_flight.velocity, atol=1e-14)


def test_only_airborne_samples_are_in_a_segment(ground_flight):
    (exact,) = exact_flight_data(ground_flight, ground_flight.vehicle).segments
    (sampled,) = sampled_flight_data(ground_flight).segments
    assert ground_flight.airborne[exact.start : exact.stop].all()
    assert not ground_flight.airborne[[exact.start - 1, exact.stop]].any()
    assert (sampled.start, sampled.stop) == (exact.start + 1, exact.stop - 1)


def test_runs_of_true():
    found = runs(np.array([True, False, True, True, False, False, True]))
    assert [(run.start, run.stop) for run in found] == [(0, 1), (2, 4), (6, 7)]
    assert runs(np.zeros(3, dtype=bool)) == ()


def test_log_in_memory_has_the_measured_channels(rough_flight):
    noisy = measure(rough_flight, Sensors(gyro_resolution=1e-3), seed=1)
    log = to_flight_log(noisy)
    assert list(log.channels) == ["gyro", "accel", "rotor_speed", "command"]
    np.testing.assert_array_equal(log.channels["gyro"].values, noisy.gyro)
    assert log.channels["gyro"].resolution == 1e-3
    assert log.channels["accel"].resolution is None
    command = log.channels["command"].values
    np.testing.assert_allclose(command * noisy.max_speed, noisy.commanded_speed)
    assert 0 < command.min() < command.max() <= 1
    assert log.seconds == pytest.approx(10 - 0.005)
    assert log.sha256 != to_flight_log(rough_flight).sha256
    pose = to_flight_log(noisy, channels=("position", "attitude", "velocity"))
    assert [c.values.shape[1] for c in pose.channels.values()] == [3, 4, 3]


def test_table_holds_the_flight_to_twelve_digits(rough_flight):
    channels = ("gyro", "accel", "rotor_speed", "command", "velocity", "reference")
    channels += ("position", "attitude")
    rows = list(csv.reader(StringIO(flight_table(rough_flight, channels=channels))))
    numbers = [f"rotor_{i}" for i in range(1, 7)] + [f"command_{i}" for i in range(1, 7)]
    assert rows[0] == [
        *("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", *numbers),
        *("vel_x", "vel_y", "vel_z", "ref_x", "ref_y", "ref_z", "pos_x", "pos_y", "pos_z"),
        *("quat_w", "quat_x", "quat_y", "quat_z"),
    ]
    values = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    np.testing.assert_allclose(values["time"], rough_flight.time, atol=1e-12)
    np.testing.assert_allclose(values["accel_z"], rough_flight.accel[:, 2], rtol=1e-11)
    np.testing.assert_allclose(values["rotor_6"], rough_flight.rotor_speed[:, 5], rtol=1e-11)
    np.testing.assert_allclose(values["ref_y"], rough_flight.reference[:, 1], atol=1e-11)
    np.testing.assert_allclose(values["quat_x"], rough_flight.attitude_wxyz[:, 1], atol=1e-11)


def test_table_is_written_once(rough_flight, tmp_path):
    path = tmp_path / "flight.csv"
    write_flight_table(rough_flight, path)
    assert path.read_text(encoding="utf-8").startswith("time,gyro_x,gyro_y,gyro_z,accel_x")
    with pytest.raises(OutputError, match="exists"):
        write_flight_table(rough_flight, path)
    with pytest.raises(OutputError, match="cannot be written: No such file"):
        write_flight_table(rough_flight, tmp_path / "absent" / "flight.csv")


def test_quaternions_keep_a_positive_scalar(rough_flight):
    flipped = replace(rough_flight, attitude_wxyz=-rough_flight.attitude_wxyz)
    again = measure(flipped, Sensors(), seed=1)
    np.testing.assert_allclose(
        again.attitude_wxyz_measured, rough_flight.attitude_wxyz_measured, atol=1e-14
    )
    assert again.attitude_wxyz_measured[:, 0].min() > 0


def test_motion_capture_leaves_cells_empty_between_its_frames(rough_flight):
    """At 150 Hz beside a log at 200 Hz, every third frame meets a row of the log."""
    flight = measure(rough_flight, Sensors(pose_rate=150.0), seed=1)
    rows = list(csv.reader(StringIO(flight_table(flight, channels=("gyro", "position")))))
    values = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    seen, flown = np.isfinite(values["pos_x"]), np.isfinite(values["gyro_x"])
    np.testing.assert_allclose(values["time"][seen], flight.pose_time, atol=1e-12)
    np.testing.assert_allclose(values["time"][flown], flight.time, atol=1e-12)
    np.testing.assert_allclose(values["pos_y"][seen], flight.position_measured[:, 1], atol=1e-11)
    log = to_flight_log(flight, channels=("gyro", "position", "attitude"))
    assert len(log.channels["attitude"].time) == len(flight.pose_time)
