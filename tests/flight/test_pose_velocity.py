"""The velocity of a pose beside the IMU, in body axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flown
from hand_made_logs import channel, flight_log
from rotorfit.errors import FlightError
from rotorfit.flight.mocap.pose_velocity import velocity_of_pose
from rotorfit.flight.prepare import prepare
from rotorfit.logs import read_log
from rotorfit.simulation import write_flight_table

RATE = 100.0
TIME = 7.0 + np.arange(2000) / RATE


def motion(time):
    """Return place, velocity in the world, and attitude of a body that swings and turns."""
    s = time - 7.0
    place = np.stack([np.sin(s), 0.5 * np.cos(2.0 * s), 0.1 * s], axis=1)
    velocity = np.stack([np.cos(s), -np.sin(2.0 * s), 0.1 + 0.0 * s], axis=1)
    turned = Rotation.from_euler("ZYX", np.stack([0.7 * s, 0.2 * np.sin(s), 0.3 * s], axis=1))
    return place, velocity, turned


def log_of(time=TIME, *, attitude_time=None, keep=slice(None)):
    place, _, _ = motion(time)
    other = time if attitude_time is None else attitude_time
    q = motion(other)[2].as_quat(scalar_first=True)
    return flight_log(position=channel(time[keep], place[keep]), attitude=channel(other, q))


def assert_true(found, *, within=2e-3):
    _, velocity, turned = motion(found.time)
    np.testing.assert_allclose(found.values, turned.apply(velocity, inverse=True), atol=within)


def test_position_is_differentiated_and_turned_into_the_body():
    found = velocity_of_pose(log_of())
    assert found.time[0] == pytest.approx(7.1)
    assert len(found.time) == 2000 - 2 * 10
    assert_true(found)


def test_attitude_may_have_instants_of_its_own():
    assert_true(velocity_of_pose(log_of(attitude_time=6.9 + np.arange(5100) / 250.0)))


def test_only_a_short_loss_of_frames_is_interpolated():
    keep = np.ones(2000, dtype=bool)
    keep[800:803] = keep[1200:1260] = False
    found = velocity_of_pose(log_of(keep=keep))
    steps = np.diff(found.time)
    (long,) = np.flatnonzero(steps > 0.05)
    assert found.time[long] == pytest.approx(7.0 + 11.89, abs=0.011)
    assert_true(found, within=0.03)


def test_no_velocity_without_attitude_refused_without_a_clock():
    assert velocity_of_pose(flight_log(position=log_of().channels["position"])) is None
    late = TIME + 0.006 * np.random.default_rng(0).random(2000)
    with pytest.raises(FlightError, match="irregular times"):
        velocity_of_pose(log_of(np.sort(late)))


def test_a_table_with_pose_and_imu_has_its_velocity(tmp_path):
    flight = flown.simulated(
        "quad-x", "noisy", seed=2, seconds=12.0, ground_seconds=2.0, physics_rate=200.0
    )
    names = ("gyro", "accel", "rotor_speed", "position", "attitude")
    write_flight_table(flight, tmp_path / "flight.csv", channels=names)
    data = prepare(read_log(tmp_path / "flight.csv"), rotor_count=4, arm=0.25).data
    rows = slice(data.segments[0].start + 50, data.segments[-1].stop - 50)
    true = np.column_stack(
        [np.interp(data.time[rows], flight.time, v) for v in flight.velocity_body.T]
    )
    assert np.sqrt(np.mean((data.velocity[rows] - true) ** 2)) < 0.1 * true.std()
