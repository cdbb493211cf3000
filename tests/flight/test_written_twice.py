"""Rows that a recorder wrote twice stretch the clock; those in place of lost ones do not."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.flight.written_twice import WRITTEN_TWICE
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant


@pytest.fixture(scope="module")
def log():
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=16.0, ground_seconds=2.0, sensors=sensors)
    return to_flight_log(simulate_flight(*flown, scenario, seed=5))


def with_rows(log, rows_of):
    """Return the log with other rows, counted as time; all channels of one clock alike."""
    channels = {}
    for name, channel in log.channels.items():
        rows = rows_of(len(channel.time))
        step = float(np.median(np.diff(channel.time)))
        time = channel.time[0] + step * np.arange(len(rows))
        channels[name] = replace(channel, time=time, values=channel.values[rows])
    return replace(log, channels=channels)


def chosen(count, share, every=None):
    marked = np.random.default_rng(1).random(count) < share
    if every is not None:
        marked = np.arange(count) % every == every - 1
    marked[0] = False
    return marked


def inserted(count, share):
    return np.repeat(np.arange(count), 1 + chosen(count, share))


def in_place(count, share, every=None):
    return np.maximum.accumulate(np.where(chosen(count, share, every), 0, np.arange(count)))


def said(log):
    found = prepare(log, rotor_count=4, arm=0.25, motors=MotorModel(speed="measured"))
    return [one for one in found.findings if one.kind == WRITTEN_TWICE]


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_rows_that_are_counted_as_time_are_found(log, share, assert_wording):
    [found] = said(with_rows(log, lambda count: inserted(count, share)))
    assert found.evidence[0].value == pytest.approx(share / (1.0 + share), abs=0.01)
    assert_wording(found.sentence)


def noisy(log):
    gyro = log.channels["gyro"]
    noise = np.random.default_rng(2).normal(0.0, 3.0, gyro.values.shape)
    return replace(
        log, channels={**log.channels, "gyro": replace(gyro, values=gyro.values + noise)}
    )


def test_rows_that_noise_hides_are_doubted(log, assert_wording):
    [found] = said(with_rows(noisy(log), lambda count: inserted(count, 0.1)))
    assert " may " in found.doubtful_because
    assert_wording(found.sentence)


def test_a_sound_log_repeats_no_rows(log):
    assert said(log) == []


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_rows_in_place_of_lost_ones_keep_the_clock(log, share):
    assert said(with_rows(log, lambda count: in_place(count, share))) == []


def held(count, times):
    return np.arange(count) // times * times


@pytest.mark.parametrize("times", [2, 3, 5])
def test_a_slower_imu_keeps_the_clock(log, times):
    assert said(with_rows(log, lambda count: held(count, times))) == []


@pytest.mark.parametrize("every", [2, 3, 10])
def test_samples_held_in_a_rhythm_keep_the_clock(log, every):
    assert said(with_rows(log, lambda count: in_place(count, 0.0, every))) == []


def test_rounded_values_are_no_repeats(log):
    channels = dict(log.channels)
    for name, step in (("gyro", 0.02), ("accel", 0.5)):
        values = np.round(channels[name].values / step) * step
        channels[name] = replace(channels[name], values=values)
    assert said(replace(log, channels=channels)) == []
