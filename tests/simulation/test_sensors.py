from dataclasses import replace

import numpy as np
import pytest

from rotorfit.simulation import Sensors, measure
from rotorfit.simulation.sensors import at_place, gauss_markov, low_passed, measured


def test_noise_and_bias_have_their_sizes():
    rng = np.random.default_rng(1)
    values = measured(np.zeros((100_000, 3)), std=0.4, rng=rng, bias=(0.1, 0.0, -0.1))
    np.testing.assert_allclose(values.mean(axis=0), [0.1, 0.0, -0.1], atol=5e-3)
    np.testing.assert_allclose(values.std(axis=0), 0.4, rtol=0.01)


def test_resolution_rounds_to_the_nearest_step():
    exact = np.array([[0.24, 0.26, -0.9]])
    logged = measured(exact, std=0.0, rng=np.random.default_rng(1), resolution=0.25)
    np.testing.assert_array_equal(logged, [[0.25, 0.25, -1.0]])


def test_a_low_pass_halves_the_power_at_its_cutoff():
    time = np.arange(4000) / 200.0
    wave = np.column_stack([5.0 + np.sin(2.0 * np.pi * f * time) for f in (1.0, 10.0, 40.0)])
    filtered = low_passed(wave, cutoff=10.0, sample_rate=200.0)
    gains = (filtered - 5.0)[2000:].std(axis=0) * 2.0**0.5
    np.testing.assert_allclose(gains[:2], [1.0, 0.5**0.5], rtol=1e-3)
    assert gains[2] < 0.06  # 12 dB per octave
    np.testing.assert_allclose(filtered[0], wave[0])
    assert low_passed(wave, cutoff=0.0, sample_rate=200.0) is wave


def test_the_error_of_an_estimated_velocity_drifts_in_world_axes(paper_flight):
    flight = measure(paper_flight, Sensors(velocity_std=0.15, velocity_bandwidth=1.0), seed=1)
    error = flight.velocity_measured - flight.velocity_body
    assert error.std() == pytest.approx(0.15, rel=0.15)
    in_world = flight.rotation_body_to_world.apply(error)
    jumps = np.diff(in_world, axis=0).std() / in_world.std()
    assert jumps == pytest.approx((2.0 * (1.0 - np.exp(-2.0 * np.pi / 200.0))) ** 0.5, rel=0.05)
    np.testing.assert_allclose(
        paper_flight.velocity_measured, paper_flight.velocity_body, atol=1e-12
    )


def test_specific_force_of_a_point_on_a_turntable():
    zero, w, dw = np.zeros((1, 3)), np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 3.0]])
    found = at_place(zero, w, dw, position=(0.5, 0.0, 0.1))
    np.testing.assert_allclose(found, [[-4 * 0.5, 3 * 0.5, 0.0]])


def test_gauss_markov_has_its_size_and_correlation():
    values = gauss_markov(
        np.array([0.5, 2.0]),
        bandwidth=3.0,
        samples=200_000,
        sample_rate=200.0,
        rng=np.random.default_rng(1),
    )
    np.testing.assert_allclose(values.std(axis=0), [0.5, 2.0], rtol=0.03)
    for column in values.T:
        correlation = column[:-5] @ column[5:] / (column @ column)
        assert correlation == pytest.approx(np.exp(-2 * np.pi * 3 * 5 / 200), abs=0.02)


def test_accelerometer_feels_its_place(rough_flight):
    flight, r = rough_flight, np.array([0.02, -0.01, 0.03])
    w, dw = flight.angular_velocity, flight.angular_acceleration
    expected = flight.specific_force + np.cross(dw, r) + np.cross(w, np.cross(w, r))
    np.testing.assert_allclose(flight.specific_force_imu, expected, rtol=1e-12)
    assert np.abs(flight.accel - flight.specific_force).max() > 0.1


def test_another_measurement_leaves_the_flight_as_it_is(rough_flight):
    sensors = Sensors(
        gyro_std=0.02,
        gyro_bias=(0.01, 0.02, -0.01),
        accel_std=0.4,
        accel_bias=(0.1, 0.0, 0.0),
        rotor_speed_std=5.0,
        rotor_speed_resolution=1.0,
        position_std=1e-3,
        attitude_std=2e-3,
    )
    one, two = (measure(rough_flight, sensors, seed=seed) for seed in (1, 2))
    assert one.angular_velocity is rough_flight.angular_velocity
    assert np.abs(one.gyro - two.gyro).max() > 0.01
    error = one.gyro - one.angular_velocity
    np.testing.assert_allclose(error.mean(axis=0), sensors.gyro_bias, atol=2e-3)
    np.testing.assert_allclose(error.std(axis=0), 0.02, rtol=0.06)
    error = one.accel - one.specific_force_imu
    np.testing.assert_allclose(error.mean(axis=0), sensors.accel_bias, atol=0.04)
    np.testing.assert_allclose(error.std(axis=0), 0.4, rtol=0.06)
    error = one.rotor_speed_measured - one.rotor_speed
    np.testing.assert_allclose(error.std(axis=0), np.hypot(5.0, 12**-0.5), rtol=0.06)
    np.testing.assert_array_equal(one.rotor_speed_measured, np.round(one.rotor_speed_measured))
    np.testing.assert_allclose((one.position_measured - one.position).std(), 1e-3, rtol=0.06)
    q = replace(one, attitude_wxyz=one.attitude_wxyz_measured).rotation_body_to_world
    tilt = (one.rotation_body_to_world.inv() * q).as_rotvec()
    np.testing.assert_allclose(tilt.std(axis=0), 2e-3, rtol=0.06)


def test_perfect_sensors_log_the_truth(paper_flight):
    np.testing.assert_array_equal(paper_flight.gyro, paper_flight.angular_velocity)
    np.testing.assert_array_equal(paper_flight.accel, paper_flight.specific_force)
    np.testing.assert_array_equal(paper_flight.rotor_speed_measured, paper_flight.rotor_speed)


def test_motion_capture_has_its_own_clock_and_comes_late(rough_flight):
    flight = measure(rough_flight, Sensors(pose_rate=80.0, pose_delay=0.0175), seed=1)
    np.testing.assert_allclose(flight.pose_time, np.arange(len(flight.pose_time)) / 80.0)
    assert flight.pose_time[-1] == pytest.approx(rough_flight.time[-1], abs=1 / 80)
    # 0.55 s are at 0.5325 s of the flight: between two samples of its log, at 0.53 and 0.535 s.
    frame, row = 44, 106
    assert flight.pose_time[frame] == pytest.approx(0.55)
    middle = rough_flight.position[[row, row + 1]].mean(axis=0)
    np.testing.assert_allclose(flight.position_measured[frame], middle, atol=5e-5)
    middle = rough_flight.attitude_wxyz[[row, row + 1]].mean(axis=0)
    np.testing.assert_allclose(flight.attitude_wxyz_measured[frame], middle, atol=2e-4)
    np.testing.assert_allclose(flight.position_measured[0], rough_flight.position[0], atol=1e-12)


def test_motion_capture_of_every_sample_is_the_truth(rough_flight):
    np.testing.assert_array_equal(rough_flight.position_measured, rough_flight.position)
    np.testing.assert_array_equal(rough_flight.pose_time, rough_flight.time)
