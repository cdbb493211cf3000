"""Fewer samples say the same of every line up to 30 Hz, and nothing of what is beside a segment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import made_fit
from rotorfit.flight.decimate import as_recorded, decimated
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.motors.motor_model import MotorModel, MotorResponse, with_motors
from rotorfit.flight.signals import central_difference, saturation, thinning_low_pass

TOP = 30.0
MEASURED, COMMANDED = MotorModel(), MotorModel(speed="commanded")


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def flight(rate, values, *, time=None, segments=None, lag_on="speed"):
    """Return a prepared flight whose IMU reads the first columns, and whose motors the last."""
    values = np.asarray(values, dtype=float)
    gyro, n = values[:, :3], len(values)
    data = FlightData(
        sample_rate=rate,
        time=5.0 + np.arange(n) / rate if time is None else time,
        specific_force=gyro + 1.0,
        angular_velocity=gyro,
        angular_acceleration=central_difference(gyro, rate),
        rotor_speed=values[:, 3:],
        rotor_acceleration=central_difference(values[:, 3:], rate),
        differentiation="central",
        segments=segments or (Segment(start=1, stop=n - 1),),
        velocity=2.0 * gyro,
        climb=gyro[:, 2],
        reference=-gyro,
        lag_on=lag_on,
    )
    return made_fit.as_prepared(data, motor_rate=rate)


def slow_noise(rng, n, rate, columns, *, top=TOP):
    """Return noise of all lines up to `top`, its standard deviation 1."""
    lines = np.zeros((n // 2 + 1, columns), dtype=complex)
    used = np.arange(1, int(top * n / rate))
    lines[used] = rng.normal(size=(len(used), columns)) + 1j * rng.normal(size=(len(used), columns))
    values = np.fft.irfft(lines, n, axis=0)
    return values / values.std()


@pytest.mark.parametrize(("rate", "step"), [(480.0, 2), (504.3, 2), (1000.0, 4), (8000.0, 33)])
def test_the_filter_is_flat_where_used_and_nothing_folds_back(rate, step):
    weights = thinning_low_pass(rate, step, TOP)
    assert len(weights) % 2 == 1
    f, gain = signal.freqz(weights, worN=8192, fs=rate)
    assert np.abs(gain)[f <= 40.0] == pytest.approx(1.0, abs=1e-4)
    folded = np.abs((f + 0.5 * rate / step) % (rate / step) - 0.5 * rate / step)
    assert np.abs(gain)[(folded <= 40.0) & (f > 60.0)].max() < 1e-4


@pytest.mark.parametrize("rate", [50.0, 250.0, 400.0, 479.0])
def test_a_slow_log_stays_as_it_is(rate):
    prepared = flight(rate, np.ones((100, 7)))
    assert decimated(prepared, MEASURED, top=TOP) is prepared


@pytest.mark.parametrize(("rate", "kept"), [(499.9, 249.95), (800.0, 800 / 3), (1000.0, 250.0)])
def test_slow_signals_are_unchanged_at_the_kept_times(rate, kept):
    n = 6000
    at = np.arange(n)[:, None] / rate
    prepared = flight(rate, 100.0 + np.sin(2.0 * np.pi * np.arange(1.0, 29.0, 4.0) * at))
    found = decimated(prepared, MEASURED, top=TOP).data
    assert found.sample_rate == pytest.approx(kept)
    rows = slice(found.segments[0].start + 10, found.segments[0].stop - 10)
    place = (found.time[rows] - 5.0) * rate
    assert place == pytest.approx(np.round(place), abs=1e-6)
    for name in (
        "specific_force", "angular_velocity", "rotor_speed", "velocity", "climb", "reference",
    ):  # fmt: skip
        was = getattr(prepared.data, name)[np.round(place).astype(int)]
        assert getattr(found, name)[rows] == pytest.approx(was, abs=1e-4), name
    assert found.angular_acceleration == pytest.approx(
        central_difference(found.angular_velocity, found.sample_rate)
    )
    assert found.seconds_used == pytest.approx(prepared.data.seconds_used, abs=2.0 / kept)


@pytest.mark.parametrize("rate", [500.0, 1000.0, 2100.0])
@pytest.mark.parametrize(
    "response",
    [MotorResponse(lag=0.02), MotorResponse(lag=0.02, delay=0.0034),
     MotorResponse(lag=0.1, delay=-0.004), MotorResponse(lag=0.05, delay=0.012),
     MotorResponse(), MotorResponse(delay=0.003), MotorResponse(lag=0.03, lag_down=0.05)],
    ids=str,
)  # fmt: skip
def test_rotors_follow_means_of_commands_as_every_command(rng, rate, response):
    n = int(8.0 * rate)
    held = 1000.0 + 100.0 * slow_noise(rng, n, rate, 4)
    prepared = flight(rate, np.column_stack([np.zeros((n, 3)), held]))
    assert error_of_decimation(prepared, response) < 1e-4


def test_lagging_thrust_is_made_of_every_command(rng):
    held = 1000.0 + 100.0 * slow_noise(rng, 8000, 1000.0, 4)
    prepared = flight(1000.0, np.column_stack([np.zeros((8000, 3)), held]), lag_on="thrust")
    assert error_of_decimation(prepared, MotorResponse(lag=0.03)) < 1e-4


def error_of_decimation(prepared, response):
    """Compute the error of speeds made of means of commands, over the changes of the speeds."""
    data = prepared.data
    every = with_motors(data, data.rotor_speed, response).rotor_speed
    wanted = decimated(replace(prepared, motor_channel=every), MEASURED, top=TOP).data.rotor_speed
    fewer = decimated(prepared, COMMANDED, top=TOP)
    found = with_motors(fewer.data, fewer.motor_channel, response).rotor_speed
    inner = slice(len(found) // 4, -len(found) // 4)
    changes = wanted[inner] - wanted[inner].mean(axis=0)
    error = found[inner] - wanted[inner]
    return np.linalg.norm(error) / np.linalg.norm(changes)


def test_a_declared_lag_is_in_the_rotor_columns(rng):
    held = 1000.0 + 100.0 * slow_noise(rng, 4000, 1000.0, 4)
    model = MotorModel(speed="commanded", lag=0.04, delay=0.006)
    found = decimated(flight(1000.0, np.column_stack([held[:, :3], held])), model, top=TOP)
    again = with_motors(found.data, found.motor_channel, model.response)
    assert found.data.rotor_speed == pytest.approx(again.rotor_speed, rel=1e-12)
    assert found.data.rotor_acceleration == pytest.approx(again.rotor_acceleration, rel=1e-12)


def test_white_noise_of_measured_speeds_keeps_its_density(rng):
    noise = 3.0 * rng.normal(size=(20_000, 7))
    prepared = flight(1000.0, noise)
    prepared = replace(prepared, data=replace(prepared.data, rotor_speed_std=3.0))
    data = decimated(prepared, MEASURED, top=TOP).data
    assert data.rotor_speed_std == 1.5
    lines = np.fft.rfft(data.rotor_speed, axis=0, norm="ortho")
    used = np.fft.rfftfreq(len(data.rotor_speed), 1.0 / data.sample_rate) < TOP
    assert (np.abs(lines[used]) ** 2).mean() == pytest.approx(data.rotor_speed_std**2, rel=0.1)


GAPS = (
    Segment(start=51, stop=1501),
    Segment(start=1507, stop=2999),
    Segment(start=3001, stop=3999),
)
"""At 1 kHz: the first two with a gap of one channel between them, the last behind lost samples."""


def with_gaps(values):
    late = np.arange(4000) >= 3000
    return flight(1000.0, values, time=np.arange(4000) / 1000.0 + 0.0031 * late, segments=GAPS)


def test_nothing_next_to_a_segment_comes_into_it(rng):
    values = slow_noise(rng, 4000, 1000.0, 7)
    spoilt = np.full(values.shape, 1e6)
    for s in GAPS:
        spoilt[s.start - 1 : s.stop + 1] = values[s.start - 1 : s.stop + 1]
    sound, other = (decimated(with_gaps(v), MEASURED, top=TOP) for v in (values, spoilt))
    for s in sound.data.segments:
        for name in ("angular_velocity", "specific_force", "rotor_speed", "velocity"):
            one, two = (getattr(p.data, name)[s.start : s.stop] for p in (sound, other))
            assert np.array_equal(one, two), name


def test_the_segments_are_where_they_were_between_any_gaps():
    prepared = with_gaps(np.ones((4000, 7)))
    phases = (Segment(start=51, stop=777), Segment(start=777, stop=1501), *GAPS[1:])
    found = decimated(replace(prepared, phases=phases), MEASURED, top=TOP)
    time = prepared.data.time
    for was, now in [*zip(GAPS, found.data.segments, strict=True),
                     *zip(phases, found.phases, strict=True)]:  # fmt: skip
        kept = found.data.time[now.start : now.stop]
        first, last = time[was.start], time[was.stop - 1]
        assert first - 1e-9 <= kept[0] < first + 0.004
        assert last - 0.004 < kept[-1] <= last + 1e-9
        assert np.diff(kept) == pytest.approx(0.004)
        assert abs(len(now) / found.data.sample_rate - len(was) / 1000.0) <= 0.004
    assert found.phases[0].stop == found.phases[1].start


@pytest.mark.parametrize("lost", [2.6, 4.2, 5.5, 9.0, 5000.0])
def test_the_lag_begins_anew_after_a_gap_however_short(lost):
    values = np.where(np.arange(4000) < 3000, 1000.0, 500.0)[:, None] * np.ones((1, 7))
    prepared = flight(
        1000.0,
        values,
        time=(np.arange(4000) + (lost - 1.0) * (np.arange(4000) >= 3000)) / 1000.0,
        segments=(Segment(start=1, stop=2999), Segment(start=3001, stop=3999)),
    )
    found = decimated(prepared, replace(COMMANDED, lag=0.1), top=TOP).data
    for segment, speed in zip(found.segments, (1000.0, 500.0), strict=True):
        assert found.rotor_speed[segment.start : segment.stop] == pytest.approx(speed, rel=1e-9)


def test_a_velocity_missing_elsewhere_is_not_missing_in_flight():
    prepared = with_gaps(np.ones((4000, 7)))
    velocity = np.full((4000, 3), np.nan)
    for s in GAPS:
        velocity[s.start - 1 : s.stop + 1] = 2.0
    prepared = replace(prepared, data=replace(prepared.data, velocity=velocity))
    found = decimated(prepared, MEASURED, top=TOP).data
    for s in found.segments:
        assert found.velocity[s.start : s.stop] == pytest.approx(2.0, rel=1e-12)


def test_what_a_sensors_end_cut_off_is_found_in_every_sample():
    at = np.arange(5000)[:, None] / 1000.0
    swing = np.clip(10.0 * np.sin(2.0 * np.pi * 4.7 * at) * np.ones((1, 7)), -7.5, 7.5)
    prepared = flight(1000.0, swing)
    recorded = as_recorded(prepared)
    assert recorded.saturation["gyro"].share == pytest.approx(0.45, abs=0.02)
    assert recorded.saturation["gyro"].largest == 7.5
    assert (recorded.samples, recorded.start) == (4998, 5.0)
    assert recorded.seconds == pytest.approx(4.998)
    assert recorded.spans == ((pytest.approx(5.001), pytest.approx(9.998)),)
    fewer = decimated(prepared, MEASURED, top=TOP).data
    assert saturation(fewer.angular_velocity, "gyro").share == 0.0
