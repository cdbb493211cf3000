"""Seconds in which the whole IMU repeats one sample are left out, and said."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.errors import FlightError
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant


@pytest.fixture(scope="module")
def log():
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=12.0, ground_seconds=2.0, sensors=sensors)
    return to_flight_log(simulate_flight(*flown, scenario, seed=5))


def hung(log, *stretches, names=("gyro", "accel")):
    """Repeat samples between some seconds since the first sample."""
    channels = dict(log.channels)
    for name in names:
        values = channels[name].values.copy()
        for begin, end in stretches:
            rows = np.flatnonzero((channels[name].time >= begin) & (channels[name].time < end))
            values[rows] = values[rows[0]]
        channels[name] = replace(channels[name], values=values)
    return replace(log, channels=channels)


def later(log):
    """Return the log by a clock that runs already."""
    channels = {name: replace(one, time=one.time + 700.0) for name, one in log.channels.items()}
    return replace(log, channels=channels)


def prepared(log):
    return prepare(log, rotor_count=4, arm=0.25, motors=MotorModel(speed="measured"))


def used_between(found, begin, end):
    time = found.data.time[found.data.used_rows]
    return int(((time > begin) & (time < end)).sum())


def test_a_sound_imu_is_used_throughout(log):
    found = prepared(log)
    assert "frozen-imu" not in [one.kind for one in found.findings]
    assert used_between(found, 6.0, 6.5) > 10


@pytest.mark.parametrize("stretches", [((6.0, 6.5),), ((5.0, 5.3), (8.0, 9.0))])
def test_a_frozen_imu_is_left_out_and_said(log, stretches):
    whole, found = prepared(log), prepared(hung(log, *stretches))
    [same] = [one for one in prepared(later(hung(log, *stretches))).findings if "imu" in one.kind]
    [said] = [one for one in found.findings if one.kind == "frozen-imu"]
    assert same.sentence == said.sentence
    for begin, end in stretches:
        assert f"{begin:.1f} to {end:.1f} s" in said.sentence
        assert used_between(found, begin, end) == 0
        assert used_between(whole, begin, end) > 10
    lost = whole.data.seconds_used - found.data.seconds_used
    assert lost == pytest.approx(sum(b - a for a, b in stretches), abs=0.1)


@pytest.mark.parametrize(
    ("name", "words", "begin"), [("gyro", "gyro", 7.0), ("accel", "accelerometer", 16.0)]
)
def test_a_sensor_that_dies_alone_is_left_out_and_said(log, name, words, begin):
    found = prepared(hung(log, (begin, 20.0), names=(name,)))
    [said] = [one for one in found.findings if one.kind == "frozen-imu"]
    assert f"the {words} alone" in said.sentence
    assert used_between(found, begin + 0.1, 20.0) == 0
    assert used_between(found, 5.0, begin) > 10


def test_a_sensor_that_stands_for_a_second_may_be_coarse(log):
    found = prepared(hung(log, (7.0, 8.0), names=("gyro",)))
    assert "frozen-imu" not in [one.kind for one in found.findings]


def drawn(log, rate, names=("gyro", "accel")):
    """Return the log with lines drawn between samples of the IMU at a rate [Hz]."""
    channels = dict(log.channels)
    for name in names:
        own = channels[name]
        t = np.arange(own.time[0], own.time[-1], 1.0 / rate)
        columns = [np.interp(own.time, t, np.interp(t, own.time, x)) for x in own.values.T]
        channels[name] = replace(own, values=np.column_stack(columns))
    return replace(log, channels=channels)


@pytest.mark.parametrize("rate", [20.0, 25.0])
def test_lines_between_slow_samples_of_the_imu_are_said(log, rate):
    assert "interpolated-imu" not in [one.kind for one in prepared(log).findings]
    [both] = [one for one in prepared(drawn(log, rate)).findings if one.kind == "interpolated-imu"]
    assert f"accelerometer came at {rate:.0f} Hz" in both.sentence
    one_alone = prepared(drawn(log, rate, names=("gyro",)))
    [said] = [one for one in one_alone.findings if one.kind == "interpolated-imu"]
    assert said.sentence.startswith("the gyro came at")


def test_an_accelerometer_of_few_rows_has_no_drawn_lines(log):
    own = log.channels["accel"]
    rare = replace(own, time=own.time[::8], values=own.values[::8])
    slow = prepared(replace(log, channels={**log.channels, "accel": rare}))
    assert "interpolated-imu" not in [one.kind for one in slow.findings]


def test_speeds_in_coarse_steps_are_refused_as_such(log):
    channel = log.channels["rotor_speed"]
    step = 2.0 * float(np.median(channel.values[channel.time > 2.5].std(axis=0)))
    coarse = replace(channel, values=step * np.round(channel.values / step))
    with pytest.raises(FlightError, match="come in steps of"):
        prepared(replace(log, channels={**log.channels, "rotor_speed": coarse}))


def test_one_axis_that_stands_still_is_refused(log):
    values = log.channels["accel"].values.copy()
    values[:, 2] = 9.81
    dead = replace(log.channels["accel"], values=values)
    with pytest.raises(FlightError, match="z of the accel channel is constant"):
        prepared(replace(log, channels={**log.channels, "accel": dead}))


def test_a_simulator_that_flies_in_one_plane_has_axes_at_zero(log):
    """Only pitch turns, and nothing pushes sideways: no sensor of it is dead."""
    plane = dict(log.channels)
    for name, axes in (("gyro", [0, 2]), ("accel", [1])):
        values = plane[name].values.copy()
        values[:, axes] = 0.0
        plane[name] = replace(plane[name], values=values)
    assert prepared(replace(log, channels=plane)).data.seconds_used > 8.0


def stuck_axis(log, axis, begin, end):
    """Return the log with an axis of the gyro that repeats its value between two times [s]."""
    gyro = log.channels["gyro"]
    values = gyro.values.copy()
    rows = np.flatnonzero((gyro.time >= begin) & (gyro.time < end))
    values[rows, axis] = values[rows[0], axis]
    return replace(log, channels={**log.channels, "gyro": replace(gyro, values=values)})


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_of_the_gyro_that_dies_alone_is_left_out(log, axis):
    found = prepared(stuck_axis(log, axis, 6.0, 9.0))
    [said] = [one for one in found.findings if one.kind == "frozen-imu"]
    assert f"the gyro's {'xyz'[axis]} axis alone" in said.sentence
    assert used_between(found, 6.1, 8.9) == 0
    assert used_between(found, 4.0, 6.0) > 10


def test_an_axis_of_a_coarse_gyro_in_calm_flight_is_used(log):
    """It reads one value in three seconds in which the rotors do not turn the vehicle about it."""
    rotors, gyro = log.channels["rotor_speed"], log.channels["gyro"]
    calm = (rotors.time >= 6.0) & (rotors.time < 9.0)
    speeds = rotors.values.copy()
    speeds[calm] = speeds[calm].mean(axis=1, keepdims=True)
    coarse = np.round(stuck_axis(log, 0, 6.0, 9.0).channels["gyro"].values, 2)
    channels = {
        "rotor_speed": replace(rotors, values=speeds),
        "gyro": replace(gyro, values=coarse),
    }
    found = prepared(replace(log, channels={**log.channels, **channels}))
    assert "frozen-imu" not in [one.kind for one in found.findings]
