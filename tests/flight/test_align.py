"""Motion capture on a clock and in axes of its own, aligned to the gyro by the rates."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError, LogError
from rotorfit.flight.mocap.align import align, with_poses
from rotorfit.simulation import Scenario, Sticks, paper_vehicle, simulate_flight, to_flight_log

MOUNTING = Rotation.from_euler("ZYX", [170.0, -4.0, 7.0], degrees=True)
"""From the tracked body's axes to the vehicle's."""
START = 1234.5678
DRIFT = 40e-6


@pytest.fixture(scope="module")
def flight():
    return flown(seconds=40.0)


def flown(*, seconds, seed=5, sticks=None, **errors):
    truth, vehicle = paper_vehicle("A")
    scenario = Scenario(seconds=seconds, sticks=sticks or Sticks())
    sensors = dataclasses.replace(
        scenario.sensors,
        **{
            "gyro_std": 0.02,
            "gyro_bias": (0.05, -0.03, 0.02),
            "position_std": 3e-4,
            "attitude_std": 2e-3,
            "pose_rate": 100.0,
            **errors,
        },
    )
    return simulate_flight(
        truth, vehicle, dataclasses.replace(scenario, sensors=sensors), seed=seed
    )


def imu(flight):
    return to_flight_log(flight, channels=("gyro", "accel", "rotor_speed"))


def recording(flight, *, start=START, drift=0.0, mounting=MOUNTING, keep=(0.0, np.inf)):
    """The pose on another clock, of a body that is mounted turned, from and until some second."""
    log = to_flight_log(flight, channels=("position", "attitude"))
    t = log.channels["attitude"].time
    kept = (t >= keep[0]) & (t <= keep[1])
    attitude = Rotation.from_quat(np.roll(log.channels["attitude"].values, -1, axis=1)) * mounting
    values = {
        "position": log.channels["position"].values,
        "attitude": np.roll(attitude.as_quat(), 1, axis=1),
    }
    clock = (1.0 - drift) * t + start
    channels = {
        name: dataclasses.replace(log.channels[name], time=clock[kept], values=value[kept])
        for name, value in values.items()
    }
    return dataclasses.replace(log, channels=channels)


def turn(a, b):
    """Angle between two rotations [degrees]."""
    return np.degrees((Rotation.from_matrix(a) * b.inv()).magnitude())


def test_offset_drift_and_mounting_are_found(flight):
    found = align(recording(flight, drift=DRIFT), imu(flight).channels["gyro"])
    t = np.array([0.0, 20.0, 40.0])
    # A frame comes every 10 ms; the clocks are brought together to a twentieth of that.
    np.testing.assert_allclose(found.log_time((1.0 - DRIFT) * t + START), t, atol=5e-4)
    assert turn(found.rotation_marker_to_body, MOUNTING) < 0.15
    assert found.drift == pytest.approx(DRIFT, abs=3e-5)
    assert found.correlation > 0.99
    assert 2e-5 < found.offset_std < 5e-4


def test_a_part_of_the_flight_is_enough(flight):
    part = recording(flight, keep=(12.0, 22.0))
    found = align(part, imu(flight).channels["gyro"])
    np.testing.assert_allclose(found.log_time(np.array([17.0 + START])), [17.0], atol=4e-4)
    assert turn(found.rotation_marker_to_body, MOUNTING) < 0.3


def test_lost_frames_and_samples_leave_runs_of_any_length(flight):
    def with_holes(channel, *holes):
        lost = np.any([(channel.time > a) & (channel.time < b) for a, b in holes], axis=0)
        return dataclasses.replace(channel, time=channel.time[~lost], values=channel.values[~lost])

    whole = recording(flight, start=0.0)
    holes = ((3.0, 3.5), (9.0, 10.0), (18.0, 18.3), (31.0, 33.0))
    pose = {name: with_holes(channel, *holes) for name, channel in whole.channels.items()}
    gyro = with_holes(imu(flight).channels["gyro"], (7.0, 7.5), (14.0, 16.0), (24.0, 24.5))
    found = align(dataclasses.replace(whole, channels=pose), gyro)
    np.testing.assert_allclose(found.log_time(np.array([5.0, 20.0])), [5.0, 20.0], atol=5e-4)
    assert turn(found.rotation_marker_to_body, MOUNTING) < 0.2


def test_stated_deviations_hold(flight):
    """Over other noise, errors are of the size that is stated."""
    errors = []
    for seed in range(8):
        other = flown(seconds=15.0, seed=seed)
        found = align(recording(other), imu(other).channels["gyro"])
        at = found.log_time(np.array([found.origin + START]))[0] - found.origin
        rotation = np.radians(turn(found.rotation_marker_to_body, MOUNTING))
        errors.append((at / found.offset_std, rotation / found.rotation_std))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.3 < rms[0] < 2.0
    assert 0.2 < rms[1] < 2.5  # of the whole turn, over the least certain of three axes


def test_the_pose_becomes_that_of_the_vehicle(flight, assert_wording):
    log = with_poses(imu(flight), recording(flight))
    attitude = log.channels["attitude"]
    np.testing.assert_allclose(attitude.time, flight.pose_time, atol=3e-4)
    read = Rotation.from_quat(np.roll(attitude.values, -1, axis=1))
    true = Rotation.from_quat(np.roll(flight.attitude_wxyz_measured, -1, axis=1))
    assert np.degrees((read * true.inv()).magnitude().max()) < 0.15
    np.testing.assert_array_equal(log.channels["position"].values, flight.position_measured)
    assert set(log.channels) == {"gyro", "accel", "rotor_speed", "position", "attitude"}
    assert "(correlation 0.99" in log.notes[-1]
    assert_wording(log.notes[-1])
    assert "yaw 170" in log.notes[-1]
    assert log.warnings == ()


def test_another_flight_is_refused(flight):
    other = flown(seconds=40.0, seed=6)
    with pytest.raises(FlightError, match=r"do not go together \(correlation 0\.\d\d at best"):
        with_poses(imu(flight), recording(other))


def test_a_mirrored_body_is_refused(flight):
    log = recording(flight, mounting=Rotation.identity())
    values = log.channels["attitude"].values * np.array([1.0, -1.0, 1.0, 1.0])
    attitude = dataclasses.replace(log.channels["attitude"], values=values)
    mirrored = dataclasses.replace(log, channels={**log.channels, "attitude": attitude})
    with pytest.raises(FlightError, match="right-handed with z up"):
        align(mirrored, imu(flight).channels["gyro"])


def test_a_body_that_stands_is_refused(flight):
    log = recording(flight)
    attitude = log.channels["attitude"]
    still = dataclasses.replace(attitude, values=np.tile([1.0, 0, 0, 0], (len(attitude.time), 1)))
    standing = dataclasses.replace(log, channels={**log.channels, "attitude": still})
    with pytest.raises(FlightError, match=r"turns by 0\.000 rad/s rms, where 0\.05 are needed"):
        align(standing, imu(flight).channels["gyro"])


def test_turning_about_one_axis_leaves_the_mounting_open():
    t = np.arange(4000) / 100.0
    noise = np.random.default_rng(2).normal(size=len(t))
    angle = np.convolve(noise, np.hanning(80) / 20.0, mode="same")
    flight = flown(seconds=3.0)
    log, pose = imu(flight), recording(flight)
    rate = np.gradient(angle, t)
    gyro = dataclasses.replace(
        log.channels["gyro"], time=t, values=np.stack([rate, 0.0 * t, 0.0 * t], axis=1)
    )
    wobble = np.random.default_rng(1).normal(size=(len(t), 3)) * 0.05
    gyro = dataclasses.replace(gyro, values=gyro.values + wobble)
    attitude = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0.0 * t, 0.0 * t], axis=1)
    channels = {
        "position": dataclasses.replace(
            pose.channels["position"], time=t, values=np.stack([t, t, t], axis=1)
        ),
        "attitude": dataclasses.replace(pose.channels["attitude"], time=t, values=attitude),
    }
    with pytest.raises(FlightError, match="about one axis"):
        align(dataclasses.replace(pose, channels=channels), gyro)


def test_a_flight_that_repeats_itself_is_refused():
    t = np.arange(6000) / 100.0
    rates = np.stack([np.sin(3.0 * t), np.cos(3.0 * t), np.sin(6.0 * t)], axis=1)
    steps = Rotation.from_rotvec(rates / 100.0).as_quat()
    attitude = [Rotation.identity()]
    for step in steps[:-1]:
        attitude.append(attitude[-1] * Rotation.from_quat(step))
    flight = flown(seconds=3.0)
    log, pose = imu(flight), recording(flight)
    gyro = dataclasses.replace(log.channels["gyro"], time=t, values=rates)
    q = np.roll(np.array([a.as_quat() for a in attitude]), 1, axis=1)
    channels = {
        "position": dataclasses.replace(pose.channels["position"], time=t, values=rates),
        "attitude": dataclasses.replace(pose.channels["attitude"], time=t, values=q),
    }
    with pytest.raises(FlightError, match="the flight repeats itself"):
        align(dataclasses.replace(pose, channels=channels), gyro)


def test_a_log_without_gyro_is_refused(flight):
    log = to_flight_log(flight, channels=("rotor_speed",))
    with pytest.raises(LogError, match=r"has no gyro \(it has rotor_speed\)"):
        with_poses(log, recording(flight))
