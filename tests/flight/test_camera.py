"""Frames: frozen, lost, jumping, late ones."""

import numpy as np
import pytest

from hand_made_logs import channel, flight_log
from rotorfit.errors import FlightError, LogError
from rotorfit.flight.mocap.camera import camera_clock, poses, tracked

RATE = 120.0
TIME = 50.0 + np.arange(600) / RATE


def pose_log(time=TIME, *, change=None):
    s = time - 50.0
    position = np.stack([np.sin(s), np.cos(1.3 * s), 1 + 0.1 * s], axis=1)
    half = 0.1 * np.sin(2 * s)
    attitude = np.stack([np.cos(half), np.sin(half), 0 * s, 0 * s], axis=1)
    if change is not None:
        change(position, attitude)
    return flight_log(position=channel(time, position), attitude=channel(time, attitude))


def test_every_frame_of_a_good_recording_is_kept():
    pose = poses(pose_log())
    assert len(pose.time) == 600
    assert pose.values.shape == (600, 7)
    clock = camera_clock(pose.time)
    assert clock.rate == pytest.approx(RATE)
    assert clock.runs == ((0, 600),)
    assert clock.jitter < 1e-9
    np.testing.assert_allclose(clock.time, TIME, atol=1e-9)


def test_repeated_frames_of_a_faster_log_are_one_frame():
    """A log at 500 Hz that holds each pose of the cameras at 120 Hz."""
    time = 50.0 + np.arange(2500) / 500.0
    seen = 50.0 + np.floor((time - 50.0) * RATE + 1e-9) / RATE
    held = pose_log(seen)
    log = flight_log(
        position=channel(time, held.channels["position"].values),
        attitude=channel(time, held.channels["attitude"].values),
    )
    clock = camera_clock(poses(log).time)
    assert clock.rate == pytest.approx(RATE, rel=1e-3)
    assert 0.02 < clock.jitter < 0.1
    assert clock.runs == ((0, 600),)
    # Held, a pose is logged half a sample late in the mean, and regularly so.
    late = clock.time - (50.0 + np.arange(600) / RATE)
    assert np.ptp(late) < 2e-3
    assert late.mean() == pytest.approx(1e-3, abs=2e-4)


def test_frozen_and_missing_frames_are_cut_not_bridged():
    def change(position, attitude):
        position[100:140], attitude[100:140] = position[99], attitude[99]
        position[300:310, 1] = np.nan
        attitude[450] = np.nan

    pose = poses(pose_log(change=change))
    assert len(pose.time) == 600 - 40 - 10 - 1
    runs = [
        tuple(np.round((pose.time[[a, b - 1]] - 50) * RATE))
        for a, b in camera_clock(pose.time).runs
    ]
    assert runs == [(0, 99), (140, 299), (310, 449), (451, 599)]


def test_a_single_frame_that_jumps_is_put_back():
    def change(position, attitude):
        position[200] += 0.03
        attitude[400] = [0.8, 0.0, 0.6, 0.0]

    seen = tracked(pose_log(change=change))
    assert seen.mended == 2
    assert len(seen.pose.time) == 600
    as_flown = poses(pose_log()).values
    np.testing.assert_allclose(seen.pose.values, as_flown, atol=1e-7)


def test_a_marker_swap_of_some_frames_is_cut():
    def change(position, attitude):
        position[200:203] += 0.03

    kept = np.round((poses(pose_log(change=change)).time - 50) * RATE)
    assert {199, 200, 202, 203}.isdisjoint(kept.astype(int).tolist())
    runs = camera_clock(poses(pose_log(change=change)).time).runs
    assert [b - a for a, b in runs] == [199, 396]


def test_flips_of_the_sign_are_no_jumps():
    def change(position, attitude):
        attitude[200:] *= -1

    assert len(poses(pose_log(change=change)).time) == 600


def test_random_jitter_is_mended():
    jitter = 0.08 / RATE * np.random.default_rng(1).normal(size=600)
    clock = camera_clock(TIME + jitter)
    assert clock.jitter == pytest.approx(0.08, rel=0.1)
    np.testing.assert_allclose(clock.time, TIME, atol=1.5e-4)


@pytest.mark.parametrize("size", [0.2, 0.6])
def test_more_jitter_is_refused(size):
    jitter = size / RATE * np.random.default_rng(1).normal(size=600)
    with pytest.raises(FlightError, match="these are times of receipt over a network"):
        camera_clock(np.sort(TIME + jitter))


def test_times_off_by_a_sixth_of_a_period_are_refused():
    with pytest.raises(FlightError, match="irregular times"):
        camera_clock(TIME + np.resize([0.155, 0.155, -0.155, -0.155], 600) / RATE)


@pytest.mark.parametrize("late", [0.6, 0.98, -0.7])
def test_a_single_stamp_that_misses_its_frame_is_no_gap(late):
    time = TIME.copy()
    time[[100, 200, 201, 350]] += late / RATE
    clock = camera_clock(time)
    assert clock.runs == ((0, 600),)
    np.testing.assert_allclose(clock.time, TIME, atol=1e-6)


def test_a_lost_frame_next_to_a_late_stamp_is_still_lost():
    time = np.delete(TIME, 300)
    time[250] += 0.7 / RATE
    assert camera_clock(time).runs == ((0, 300), (300, 599))


def test_jitter_of_a_queue_is_refused():
    slow = 0.09 / RATE * np.sqrt(2) * np.sin(np.arange(600) / 10)
    with pytest.raises(FlightError, match="irregular times"):
        camera_clock(TIME + slow)


def test_a_slow_clock_is_followed():
    clock = camera_clock(50.0 + (TIME - 50.0) * 1.0001)
    assert clock.rate == pytest.approx(RATE / 1.0001, rel=1e-9)


def test_frames_that_are_lost_all_the_time_are_refused():
    keep = np.arange(600) % 6 < 4
    with pytest.raises(FlightError, match="never 8 follow each other without loss"):
        camera_clock(TIME[keep])


def test_a_log_without_pose():
    log = pose_log()
    with pytest.raises(LogError, match=r"no attitude from motion capture \(it has position\)"):
        poses(flight_log(position=log.channels["position"]))
    with pytest.raises(LogError, match="no position from motion capture"):
        poses(flight_log(attitude=log.channels["attitude"]))


def test_position_and_attitude_of_different_frames():
    log = pose_log()
    other = channel(TIME + 1e-3, log.channels["attitude"].values)
    with pytest.raises(FlightError, match="position and attitude share 0 of 600 times"):
        poses(flight_log(position=log.channels["position"], attitude=other))


def test_a_body_that_was_never_tracked():
    def change(position, attitude):
        position[:], attitude[:] = position[0], attitude[0]

    with pytest.raises(FlightError, match="the pose changes in only 1 of 600 frames"):
        poses(pose_log(change=change))
