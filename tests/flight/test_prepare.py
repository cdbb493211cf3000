from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from hand_made_logs import (
    COMMANDED,
    HOVER,
    G,
    channel,
    flight_log,
    hover_thrust,
    motion_log,
    prepared,
    spans,
    with_channel,
)
from plain_loops import plain_loops
from rotorfit.errors import ExperimentError, FlightError, FrameError, LogError
from rotorfit.findings import doubt
from rotorfit.flight.motors.motor_model import (
    MotorModel,
    MotorResponse,
    first_order_lag,
    with_motors,
)
from rotorfit.flight.prepare import Cut, prepare
from rotorfit.flight.replaced_samples import REPLACED
from rotorfit.logs.motor_law import (
    MotorLaw,
    PolynomialCurve,
    SquareRootCurve,
    TableCurve,
    VoltageFactor,
)
from rotorfit.simulation import (
    PERFECT,
    Scenario,
    layout_vehicle,
    paper_vehicle,
    sampled_flight_data,
    simulate_flight,
    to_flight_log,
    variant,
)

LAW = MotorLaw(curve=PolynomialCurve((20.0, 950.0)))


def refusal(error, log, **options) -> str:
    with pytest.raises(error) as refused:
        prepared(log, **options)
    return str(refused.value)


@pytest.fixture(scope="module")
def hover():
    return motion_log(hover_thrust(20))


# What comes out


@pytest.mark.parametrize("layout", ["paper", "hexa-x", "octo"])
def test_a_noiseless_flight_is_its_samples_and_differences(layout):
    vehicle = paper_vehicle("B") if layout == "paper" else layout_vehicle(layout)
    flight = simulate_flight(*vehicle, Scenario(seconds=6.0), seed=1)
    rotors = flight.rotor_speed.shape[1]
    log = to_flight_log(flight, channels=("gyro", "accel", "rotor_speed", "velocity"))
    data = prepared(log, rotors=rotors).data
    expected = sampled_flight_data(flight)
    assert data.segments == expected.segments
    assert data.differentiation == expected.differentiation
    rows = slice(data.segments[0].start, data.segments[0].stop)
    for name in (
        "time",
        "specific_force",
        "angular_velocity",
        "angular_acceleration",
        "rotor_speed",
        "rotor_acceleration",
        "velocity",
    ):
        got, wanted = getattr(data, name)[rows], getattr(expected, name)[rows]
        assert got == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max()), name


def test_commands_pass_law_lag_and_delay():
    log = motion_log(hover_thrust(10), name="command")
    motors = MotorModel(speed="commanded", law=LAW, lag=0.03, delay=0.01)
    result = prepared(log, motors=motors)
    command = log.channels["command"].values
    settled = 20 + 950 * command
    assert result.motor_channel == pytest.approx(settled)
    delayed = np.vstack([settled[:1], settled[:1], settled[:-2]])
    assert result.data.rotor_speed == pytest.approx(first_order_lag(delayed, 200.0, 0.03))
    slope = (result.data.rotor_speed[2:] - result.data.rotor_speed[:-2]) * 100
    assert result.data.rotor_acceleration[1:-1] == pytest.approx(slope)
    assert set(result.spikes) == {"gyro", "accel"}
    again = with_motors(result.data, result.motor_channel, MotorResponse())
    assert again.rotor_speed == pytest.approx(settled)
    assert again.segments == result.data.segments


def test_a_law_with_a_voltage_factor_follows_the_battery(assert_wording):
    log = motion_log(hover_thrust(10), name="command")
    motors = MotorModel(
        speed="commanded", law=replace(LAW, voltage=VoltageFactor(12.0, 1.0)), lag=0.03
    )
    message = refusal(LogError, log, motors=motors)
    assert_wording(message)
    optional = replace(LAW, voltage=VoltageFactor(12.0, 1.0, missing_std=0.04))
    plain = prepared(log, motors=replace(motors, law=LAW)).motor_channel
    assert prepared(log, motors=replace(motors, law=optional)).motor_channel == pytest.approx(plain)
    command = log.channels["command"]
    sagging = np.linspace(12.6, 10.8, 101)[:, None]
    slow = channel(np.linspace(command.time[0], command.time[-1], 101), sagging)
    result = prepared(with_channel(log, battery=slow), motors=motors)
    volts = np.interp(result.data.time, slow.time, sagging[:, 0])[:, None]
    expected = (20 + 950 * command.values[: len(volts)]) * volts / 12
    assert result.motor_channel == pytest.approx(expected, rel=1e-5)


def test_a_law_that_does_not_reach_the_commands_is_warned_of(assert_wording):
    log = motion_log(hover_thrust(10), name="command")
    low, high = np.percentile(log.channels["command"].values, [1, 99]).tolist()
    table = MotorLaw(curve=TableCurve((low / 4, (low + high) / 2), (100.0, 500.0)))
    doubts = prepared(log, motors=MotorModel(speed="commanded", law=table)).warnings
    assert_wording(doubts)
    wide = MotorLaw(curve=TableCurve((0.0, 1.0), (0.0, 1000.0)))
    doubts = prepared(log, motors=MotorModel(speed="commanded", law=wide)).warnings
    assert not any("law" in doubt for doubt in doubts)


def test_without_a_law_the_command_stands_for_the_speed():
    log = motion_log(hover_thrust(10), name="command")
    result = prepared(log, motors=COMMANDED)
    assert np.array_equal(result.data.rotor_speed, log.channels["command"].values)
    assert result.data.rotor_speed_std == 0


def test_rotor_speed_resolution_is_passed_on_only_where_used(hover):
    measured = replace(hover.channels["rotor_speed"], resolution=6.0)
    command = channel(measured.time, measured.values / 1000)
    log = with_channel(hover, rotor_speed=measured, command=command)
    assert prepared(log).data.rotor_speed_std == pytest.approx(6 / np.sqrt(12))
    assert prepared(log, motors=COMMANDED).data.rotor_speed_std == 0


def test_the_lag_does_not_reach_across_a_gap():
    log = motion_log(hover_thrust(10), name="command")
    moved = {
        k: replace(c, time=c.time + 5.0 * (c.time > 104.9975)) for k, c in log.channels.items()
    }
    result = prepared(flight_log(**moved), motors=replace(COMMANDED, lag=0.05))
    row = int(np.flatnonzero(np.diff(result.data.time) > 1)[0]) + 1
    assert result.data.rotor_speed[row] == pytest.approx(result.motor_channel[row])
    # Motors follow what they were told before the log and in the gap for a fifth of a second.
    assert [s.start for s in result.data.segments] == [40, row + 40]


def test_measured_speeds_are_used_from_the_first_on(hover):
    assert prepared(hover).data.segments[0].start == 1


def test_a_flight_too_short_to_settle_is_used_whole():
    log = motion_log(hover_thrust(10), name="command")
    assert prepared(log, motors=COMMANDED, window=(0.0, 0.45)).data.segments[0].start == 1
    assert prepared(log, motors=COMMANDED, window=(0.0, 0.6)).data.segments[0].start == 40


def test_slow_motor_data_are_despiked_as_recorded(hover, assert_wording):
    t = hover.channels["gyro"].time
    slow = hover.channels["rotor_speed"]
    values = slow.values[::4].copy()
    values[100, 2] = 5000.0
    result = prepared(with_channel(hover, rotor_speed=channel(t[::4], values)))
    assert result.data.rotor_speed.max() < 1.3 * HOVER
    assert result.spikes["motor"] < 5
    assert result.slowest_rate == pytest.approx(50)
    assert any("at 50 Hz," in doubt for doubt in result.warnings)
    assert any("at 200 Hz:" in doubt for doubt in result.warnings)
    assert any("to 20 Hz;" in doubt for doubt in result.warnings)
    assert_wording(result.warnings)


def test_what_the_reader_says_of_slow_motor_data_is_said_once(hover):
    t, slow = hover.channels["gyro"].time, hover.channels["rotor_speed"]
    log = with_channel(hover, rotor_speed=channel(t[::4], slow.values[::4]))
    log = replace(log, findings=(doubt("slow-motor-data", "set it"),))
    assert not [one for one in prepared(log).findings if one.kind == "slow-motor-data"]


def test_motor_data_are_fast_enough_from_150_hz_on():
    log = motion_log(hover_thrust(10), rate=500)
    t, speed = log.channels["gyro"].time, log.channels["rotor_speed"]
    third = with_channel(log, rotor_speed=channel(t[::3], speed.values[::3]))
    fourth = with_channel(log, rotor_speed=channel(t[::4], speed.values[::4]))
    assert not any("log motors faster" in words for words in prepared(third).warnings)
    assert any("motor data come at 125 Hz" in words for words in prepared(fourth).warnings)


def test_spikes_are_counted_and_taken_out(hover):
    values = hover.channels["accel"].values.copy()
    values[500, 0], values[900, 2] = 1e6, -300.0
    result = prepared(with_channel(hover, accel=channel(hover.channels["accel"].time, values)))
    assert result.spikes["accel"] == pytest.approx(2, abs=3)
    assert np.abs(result.data.specific_force).max() < 15


@pytest.mark.parametrize(("name", "read"), [("gyro", 5.0), ("accel", 50.0), ("rotor_speed", 0.0)])
def test_many_replaced_samples_are_said(hover, name, read):
    one = hover.channels[name]
    lost = np.random.default_rng(4).random((len(one.time), 1)) < 0.06
    log = with_channel(hover, **{name: channel(one.time, np.where(lost, read, one.values))})
    [said] = [found for found in prepared(log).findings if found.kind == REPLACED]
    assert said.evidence[0].value == pytest.approx(0.06, abs=0.015)
    assert not [found for found in prepared(hover).findings if found.kind == REPLACED]


def test_rest_needs_low_motors(hover):
    """A calm hover before the start that the user gives is not rest, however quiet the gyro."""
    t = hover.channels["gyro"].time
    turning = np.full((len(t), 3), 0.2) + 0.005 * np.random.default_rng(0).normal(size=(len(t), 3))
    log = with_channel(hover, gyro=channel(t, turning))
    assert prepared(log, window=(10.0, 15.0)).gyro_bias is None


def test_a_large_bias_is_taken_off_and_said(assert_text):
    t = np.arange(4000) / 200
    flying = t > 5
    thrust = np.where(flying, 1 + 0.1 * np.sin(5 * t), 0.0)
    force = np.zeros((4000, 3))
    force[:, 2] = np.where(flying, G * thrust, G)
    rates = np.where(flying[:, None], 0.3 * np.sin(np.outer(t, (4, 5, 3))), 0.0)
    rates[:, 1] += 0.25
    result = prepared(motion_log(thrust, force=force, rates=rates))
    assert result.gyro_bias == pytest.approx((0, 0.25, 0), abs=2e-3)
    assert_text(result.warnings)
    assert [one.kind for one in result.findings] == ["gyro-bias"]


def test_cuts_are_named_in_the_order_of_time(hover):
    c = hover.channels["accel"]
    kept = (c.time < 105) | (c.time > 106)
    result = prepared(with_channel(hover, accel=channel(c.time[kept], c.values[kept])))
    assert len(result.data.segments) == 2
    named = [(cut.reason, round(cut.start, 1), round(cut.end, 1)) for cut in result.cuts]
    assert ("gap in accel", 105.0, 106.0) in named
    assert [cut.start for cut in result.cuts] == sorted(cut.start for cut in result.cuts)
    assert all(isinstance(cut, Cut) for cut in result.cuts)


# Windows


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ((5.0, 10.0), (5.0, 9.995)),
        ((5.0, None), (5.0, 19.99)),
        ((None, 10.0), (0.005, 9.995)),
        ((-3.0, 99.0), (0.005, 19.99)),
    ],
)
def test_start_and_end_replace_the_search(hover, window, expected):
    result = prepared(hover, window=window)
    ((start, end),) = spans(result)
    assert (start, end) == (pytest.approx(expected[0]), pytest.approx(expected[1]))
    assert {cut.reason for cut in result.cuts} <= {"outside start and end"}


@pytest.fixture(scope="module")
def bumpy():
    """A flight of 250 Hz from the ground, with a gap and a bump, between them calm and lively."""
    rate = 250.0
    thrust = hover_thrust(16, rate=rate)
    t = np.arange(len(thrust)) / rate
    force = np.zeros((len(t), 3))
    force[:, 2] = G * thrust
    force[t < 2] = (0.0, 0.0, G)
    thrust[t < 2] = 0.05
    force[(t > 6.0) & (t < 6.1)] += (60.0, 20.0, 40.0)
    rates = 0.3 * np.sin(np.outer(t, (5.0, 6.0, 3.0)))
    rates *= np.where(t < 2, 0.0, np.where((t > 9) & (t < 11), 12.0, 1.0))[:, None]
    log = motion_log(thrust, rate=rate, force=force, rates=rates)
    kept = (t < 13.0) | (t > 13.5)
    return {
        name: replace(one, time=t[kept], values=one.values[kept])
        for name, one in log.channels.items()
    }


@pytest.mark.parametrize("window", [(None, None), (2.0, 12.0), (2.4, 14.4)])
@pytest.mark.parametrize("shift", [12.5, 1e6])
def test_when_a_clock_begins_changes_nothing(bumpy, shift, window):
    """A rate of 250.0000001 Hz must not make 74 samples of 75 in 0.3 s."""
    moved = {name: replace(c, time=c.time + shift) for name, c in bumpy.items()}
    first = prepared(flight_log(**bumpy), window=window)
    later = prepared(flight_log(**moved), window=window)
    assert len(first.phases) >= 4 if window == (None, None) else len(first.phases) >= 2
    assert later.data.segments == first.data.segments
    assert later.phases == first.phases
    assert [cut.reason for cut in later.cuts] == [cut.reason for cut in first.cuts]
    for name in ("start", "end"):
        ends = [[getattr(cut, name) for cut in one.cuts] for one in (first, later)]
        np.testing.assert_allclose(np.array(ends[1]) - shift, ends[0], atol=1e-9)
    assert later.gyro_bias == pytest.approx(first.gyro_bias, abs=1e-12)
    for name in ("specific_force", "angular_acceleration", "rotor_speed"):
        one, other = (getattr(prepared.data, name) for prepared in (first, later))
        np.testing.assert_allclose(other, one, rtol=1e-7, atol=1e-6)


def test_windows_without_samples_are_refused(hover, assert_text):
    assert_text(refusal(FlightError, hover, window=(30.0, 40.0)))
    assert_text(refusal(FlightError, hover, window=(30.0, None)))
    assert_text(refusal(FlightError, hover, window=(10.0, 5.0)))
    assert "no usable samples" in refusal(FlightError, hover, window=(float("nan"), 5.0))


def test_a_window_where_no_motor_turns_is_refused():
    thrust = np.where(np.arange(4000) < 2000, 0.0, hover_thrust(20))
    force = np.zeros((4000, 3))
    force[:, 2] = np.where(thrust > 0, G * thrust, G)
    log = motion_log(thrust, force=force, name="command")
    assert "the motors never turn" in refusal(FlightError, log, window=(1.0, 8.0), motors=COMMANDED)


# Refusals


@pytest.mark.parametrize(
    ("channel_name", "what"), [("gyro", "rotation rates"), ("accel", "specific force")]
)
def test_a_missing_sensor_is_named(hover, channel_name, what, assert_text):
    log = with_channel(hover, **{channel_name: None})
    said = refusal(LogError, log)
    assert f"no {what} (channel {channel_name};" in said
    assert f"has {', '.join(log.channels)})" in said
    assert_text(said)


def test_missing_motors_are_named(hover, assert_text, assert_wording):
    assert_text(refusal(LogError, with_channel(hover, rotor_speed=None)))
    assert_text(refusal(LogError, hover, motors=COMMANDED))
    commands = motion_log(hover_thrust(5), name="command")
    assert_wording(refusal(LogError, commands))
    assert "it has none" in refusal(LogError, flight_log())


@pytest.mark.parametrize("arm", [-0.2, 0.0, float("nan"), float("inf")])
def test_an_arm_that_is_no_length_is_refused(hover, arm):
    with pytest.raises(ExperimentError, match=f"arm is {arm:g}, expected a length of more than 0"):
        prepare(hover, rotor_count=4, arm=arm)


def test_the_wrong_number_of_rotors_is_refused(hover, assert_text):
    assert_text(refusal(LogError, hover, rotors=6))


@pytest.mark.parametrize("name", ["gyro", "accel"])
def test_a_sensor_that_never_moves_is_refused(hover, name, assert_text):
    c = hover.channels[name]
    log = with_channel(hover, **{name: channel(c.time, np.full_like(c.values, 2.5))})
    assert_text(refusal(FlightError, log))


@pytest.mark.parametrize("name", ["gyro", "accel", "rotor_speed"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_a_channel_without_numbers_is_refused(hover, name, value, assert_text):
    c = hover.channels[name]
    log = with_channel(hover, **{name: channel(c.time, np.full_like(c.values, value))})
    assert_text(refusal(FlightError, log))


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_a_log_of_a_few_samples_is_refused(hover, samples):
    short = {
        k: replace(c, time=c.time[:samples], values=c.values[:samples])
        for k, c in hover.channels.items()
    }
    assert f"has {samples} usable samples" in refusal(FlightError, flight_log(**short))


@pytest.mark.parametrize("samples", [8, 20, 61])
@pytest.mark.parametrize("window", [(None, None), (0.0, None)])
def test_very_short_logs_are_refused_in_words(hover, samples, window):
    short = {
        k: replace(c, time=c.time[:samples], values=c.values[:samples])
        for k, c in hover.channels.items()
    }
    try:
        result = prepared(flight_log(**short), window=window)
    except FlightError as error:
        assert str(error)
    else:
        assert samples == 61
        assert result.data.samples_used > 50


def test_a_gyro_in_degrees_is_refused(assert_wording):
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(*vehicle, Scenario(seconds=15.0, sensors=sensors), seed=4)
    log = to_flight_log(flight)
    gyro = replace(log.channels["gyro"], values=np.degrees(log.channels["gyro"].values))
    message = refusal(FlightError, with_channel(log, gyro=gyro))
    assert "(below 40 was" in message
    assert_wording(message)


def test_an_accelerometer_in_g_is_refused(hover, assert_wording):
    accel = replace(hover.channels["accel"], values=hover.channels["accel"].values / G)
    message = refusal(FlightError, with_channel(hover, accel=accel))
    assert "about 9.8 is" in message
    assert_wording(message)


def test_an_accelerometer_in_raw_counts_is_refused(hover, assert_wording):
    accel = replace(hover.channels["accel"], values=hover.channels["accel"].values * 208)
    message = refusal(FlightError, with_channel(hover, accel=accel))
    assert "about 9.8 m/s^2 is" in message
    assert_wording(message)


def test_frd_axes_are_refused_with_the_remedy(hover, assert_wording):
    frd = {
        name: replace(hover.channels[name], values=hover.channels[name].values * (1, -1, -1))
        for name in ("gyro", "accel")
    }
    message = refusal(FrameError, with_channel(hover, **frd))
    assert_wording(message)


@pytest.mark.parametrize(("order", "axis"), [((2, 0, 1), "x"), ((0, 2, 1), "y")])
def test_a_turned_imu_is_refused(hover, order, axis, assert_wording):
    turned = {
        name: replace(hover.channels[name], values=hover.channels[name].values[:, order])
        for name in ("gyro", "accel")
    }
    message = refusal(FrameError, with_channel(hover, **turned))
    assert f"along {axis} instead" in message
    assert_wording(message)


# Doubts


def test_thrust_swings_are_doubted(assert_wording):
    t = np.arange(4000) / 200
    thrust = 1 + 0.95 * np.sin(1.5 * t)
    doubts = prepared(motion_log(thrust)).warnings
    assert any("outside 0.3 to 1.8" in doubt for doubt in doubts)
    assert_wording(doubts)


@pytest.mark.parametrize(("speed", "said"), [(8.0, True), (3.0, False)])
def test_fast_flight_is_doubted(hover, speed, said):
    t = 100 + np.arange(3, 17, 0.2)  # slower and shorter than the rest: it must cut nothing
    velocity = np.zeros((len(t), 3))
    velocity[:, 0] = speed
    result = prepared(with_channel(hover, velocity=channel(t, velocity)))
    message = (
        "the vehicle flies at up to 8.0 m/s; over 5 m/s the air changes thrust and torque, which "
        "the model has to first order only (terms drag, inflow): use a slower part of the flight, "
        "if there is one"
    )
    assert (message in result.warnings) == said
    assert result.slowest_rate == pytest.approx(200)
    assert result.data.seconds_used > 19.9


def test_a_velocity_that_cannot_be_used_is_left_out(hover):
    velocity = channel([100.0, 101.0], np.full((2, 3), np.nan))
    assert prepared(with_channel(hover, velocity=velocity)).data.velocity is None


# Hard cases


def test_channels_of_three_rates_and_spans():
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(
        *vehicle, Scenario(seconds=6.0, sample_rate=500.0, sensors=sensors), seed=2
    )
    log = to_flight_log(flight, channels=("gyro", "accel", "rotor_speed"))
    every = {"gyro": slice(0, None), "accel": slice(101, None, 2), "rotor_speed": slice(0, -200, 5)}
    mixed = {
        k: replace(c, time=c.time[every[k]], values=c.values[every[k]])
        for k, c in log.channels.items()
    }
    result = prepared(flight_log(**mixed))
    ((start, end),) = spans(result)
    assert start == pytest.approx(0.204, abs=0.003)
    assert end == pytest.approx(5.59, abs=0.01)
    assert result.slowest_rate == pytest.approx(100)
    rows = slice(result.data.segments[0].start, result.data.segments[0].stop)
    assert result.data.rotor_speed[rows] == pytest.approx(flight.rotor_speed[rows], abs=30)


@pytest.mark.parametrize("rotors", [1, 3, 6, 8, 12])
def test_any_number_of_rotors(rotors):
    result = prepared(motion_log(hover_thrust(5), rotors=rotors), rotors=rotors)
    assert result.data.rotor_speed.shape[1] == rotors


def test_rotors_that_all_turn_alike():
    log = motion_log(hover_thrust(10))
    speed = log.channels["rotor_speed"].values[:, :1] * np.ones(4)
    result = prepared(with_channel(log, rotor_speed=channel(log.channels["gyro"].time, speed)))
    assert result.data.seconds_used > 9.9


def test_damaged_samples_do_no_harm(hover):
    rng = np.random.default_rng(0)
    damaged = {}
    for name, c in hover.channels.items():
        values = c.values.copy()
        for value in (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e8):
            values[rng.choice(len(values), 4), rng.integers(values.shape[1])] = value
        damaged[name] = channel(c.time, values)
    result = prepared(flight_log(**damaged))
    data = result.data
    assert data.seconds_used > 15
    for segment in data.segments:
        rows = slice(segment.start, segment.stop)
        assert np.abs(data.specific_force[rows]).max() < 20
        assert np.abs(data.angular_velocity[rows]).max() < 1
        assert np.abs(data.rotor_speed[rows]).max() < 2 * HOVER


def test_the_log_stays_as_it_was(hover):
    before = {name: c.values.copy() for name, c in hover.channels.items()}
    prepared(hover)
    assert all(np.array_equal(before[k], c.values) for k, c in hover.channels.items())


def test_perfect_sensors_make_no_spikes():
    flight = simulate_flight(*paper_vehicle("A"), Scenario(seconds=6.0, sensors=PERFECT), seed=3)
    assert set(prepared(to_flight_log(flight)).spikes.values()) == {0}


def test_long_logs_and_thousands_of_gaps_take_linear_time():
    def work(seconds):
        result = prepared(gapped_log(seconds))
        assert len(result.data.segments) == seconds / 0.6
        assert result.data.samples_used == 500 * seconds - 2 * seconds / 0.6

    work(6)  # so that what is imported does not count
    short, long = (plain_loops(partial(work, seconds))[0] for seconds in (60, 300))
    assert long < 3 * 5 * short


def gapped_log(seconds):
    """Return a hover with a gap after every 300 samples."""
    log = motion_log(hover_thrust(seconds, rate=500.0), rate=500.0)
    t = log.channels["gyro"].time
    gapped = t + 0.1 * (np.arange(len(t)) // 300)
    return flight_log(**{k: channel(gapped, c.values) for k, c in log.channels.items()})


def tumbling(log, *, at, seconds=0.5):
    """Return a log with a crash in it: turns of 60 rad/s for a moment."""
    gyro = log.channels["gyro"]
    rows = (gyro.time - gyro.time[0] >= at) & (gyro.time - gyro.time[0] < at + seconds)
    blows = 60.0 * np.sin(np.arange(len(gyro.time)) * 0.5)[:, None]
    return with_channel(log, gyro=replace(gyro, values=np.where(rows[:, None], blows, gyro.values)))


def test_a_crash_is_no_gyro_in_degrees():
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(*vehicle, Scenario(seconds=15.0, sensors=sensors), seed=4)
    log = tumbling(to_flight_log(flight), at=11.0)
    with pytest.raises(
        FlightError, match=r"from 11\.0 to 11\.5 s .* a crash or a blow; set end = 10\.9"
    ):
        prepared(log, window=(2.0, 13.0))
    assert prepared(log, window=(2.0, 10.9)).data.seconds_used == pytest.approx(8.9, abs=0.1)


def test_a_columns_map_is_advised_only_where_one_is_taken(assert_wording):
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(*vehicle, Scenario(seconds=15.0, sensors=sensors), seed=4)
    log = to_flight_log(flight)
    gyro = replace(log.channels["gyro"], values=np.degrees(log.channels["gyro"].values))
    accel = replace(log.channels["accel"], values=log.channels["accel"].values / 9.80665)
    for changed in (with_channel(log, gyro=gyro), with_channel(log, accel=accel)):
        assert "columns = {" in refusal(FlightError, replace(changed, format="table"))
        words = refusal(FlightError, replace(changed, format="blackbox"))
        assert "columns = {" not in words
        assert_wording(words)


def test_a_torn_log_is_refused_by_its_gaps(assert_wording):
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(*vehicle, Scenario(seconds=15.0, sensors=sensors), seed=4)
    log = to_flight_log(flight)
    kept = np.random.default_rng(1).random(len(log.channels["gyro"].time)) > 0.2
    channels = {
        name: replace(c, time=c.time[kept], values=c.values[kept])
        for name, c in log.channels.items()
        if name in ("gyro", "accel", "rotor_speed")
    }
    message = refusal(FlightError, replace(log, channels=channels))
    assert_wording(message)


def test_a_lag_on_thrust_follows_the_square_of_the_speed():
    """PX4's SIH: u moves on by dt / tau of its distance, and thrust goes with u."""
    flight = simulate_flight(*layout_vehicle("quad-x"), Scenario(seconds=6.0), seed=1)
    log = to_flight_log(flight, channels=("gyro", "accel", "command"))
    law = MotorLaw(curve=SquareRootCurve(900.0, 0.0))
    found = prepared(log, motors=MotorModel(speed="commanded", law=law, lag=0.05, lag_on="thrust"))
    held = found.motor_channel
    expected = first_order_lag(held**2, found.data.sample_rate, 0.05)
    np.testing.assert_allclose(found.data.rotor_speed**2, expected, rtol=1e-9)
    other = with_motors(found.data, held, MotorResponse(lag=0.02))
    expected = first_order_lag(held**2, found.data.sample_rate, 0.02)
    np.testing.assert_allclose(other.rotor_speed**2, expected, rtol=1e-9)
