"""Motion capture through the preparation: derivatives, clocks, what is refused."""

import dataclasses

import numpy as np
import pytest

from hand_made_logs import flight_log, with_channel
from rotorfit.errors import FlightError, FrameError, LogError
from rotorfit.flight.mocap.prepare_mocap import prepare_mocap
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.signals import low_pass
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve
from rotorfit.simulation import (
    Scenario,
    Sensors,
    measure,
    paper_vehicle,
    simulate_flight,
    to_flight_log,
)

CHANNELS = ("rotor_speed", "command", "position", "attitude")
NOISE = Sensors(rotor_speed_std=5.0, position_std=3e-4, attitude_std=2e-3, pose_rate=100.0)


@pytest.fixture(scope="module")
def flight():
    return simulate_flight(*paper_vehicle("A"), Scenario(seconds=15.0, ground_seconds=2.0), seed=2)


def pose_log(flight, **sensors):
    return to_flight_log(measure(flight, Sensors(**sensors), seed=1), channels=CHANNELS)


def prepared(log, **options):
    return prepare_mocap(log, **{"rotor_count": 4, "arm": 0.2, **options})


def test_the_motion_is_the_exact_one(flight):
    data = prepared(pose_log(flight)).data
    (segment,) = data.segments
    rows = slice(segment.start, segment.stop)
    at = np.round(data.time[rows] * 200).astype(int)
    assert data.differentiation == "exact"
    assert data.sample_rate == pytest.approx(200)
    for name, limit in (
        ("specific_force", 0.01),
        ("angular_velocity", 1e-3),
        ("angular_acceleration", 0.1),
        ("rotor_speed", 0.5),
    ):
        error = getattr(data, name)[rows] - getattr(flight, name)[at]
        assert np.sqrt((error**2).mean()) < limit, name
    error = data.velocity[rows] - flight.velocity_body[at]
    assert np.abs(error).max() < 1e-3


@pytest.mark.parametrize("sensors", [{}, dataclasses.asdict(NOISE)])
def test_only_the_airborne_part_is_used(flight, sensors):
    result = prepared(pose_log(flight, **sensors))
    t = result.data.time
    (segment,) = result.data.segments
    start, stop = flight.time[flight.airborne][[0, -1]]
    assert 0 <= t[segment.start] - start < 0.25
    assert -0.05 <= stop - t[segment.stop - 1] < 0.25
    assert result.gyro_bias is None
    assert result.warnings == ()


@pytest.mark.parametrize(("end", "refused"), [(9.0, False), (99.0, True)])
def test_a_rotor_that_stands_still_is_named(flight, end, refused, assert_text):
    log = pose_log(flight)
    speed = log.channels["rotor_speed"]
    values = speed.values.copy()
    values[(speed.time >= 7.0) & (speed.time < end), 1] = 800.0
    stuck = with_channel(log, rotor_speed=dataclasses.replace(speed, values=values))
    if refused:
        with pytest.raises(FlightError, match="speed of rotor 2 stays at 800 rad/s"):
            prepared(stuck)
    else:
        assert_text(prepared(stuck).warnings[0])


def test_cameras_slower_than_the_motors(flight):
    result = prepared(pose_log(flight, pose_rate=100.0))
    assert result.data.sample_rate == pytest.approx(100)
    assert result.slowest_rate == pytest.approx(62.5)
    rows = slice(result.data.segments[0].start, result.data.segments[0].stop)
    at = np.round(result.data.time[rows] * 200).astype(int)
    # Through the same low-pass as the pose, on the motors' own clock.
    expected = low_pass(flight.rotor_speed, 200.0, 25.0)[at]
    assert np.abs(result.data.rotor_speed[rows] - expected)[20:-20].max() < 0.05


def drawn(channel, rate):
    """Return a channel of which a recorder has values at a rate [Hz], and draws lines between."""
    slow = np.arange(channel.time[0] + 0.003, channel.time[-1], 1.0 / rate)
    lines = [
        np.interp(channel.time, slow, np.interp(slow, channel.time, column))
        for column in channel.values.T
    ]
    return dataclasses.replace(channel, values=np.column_stack(lines))


@pytest.mark.parametrize(
    ("channel", "motors", "words"),
    [
        ("rotor_speed", "measured", "the rotor speeds come at 10 Hz, and lines are drawn"),
        ("command", "commanded", "the motors' commands come at 10 Hz, and lines are drawn"),
    ],
)
def test_lines_drawn_between_slow_samples_are_refused(flight, channel, motors, words):
    log = pose_log(flight, **dataclasses.asdict(NOISE))
    model = MotorModel(speed=motors)
    assert prepared(log, motors=model).data.segments
    lines = with_channel(log, **{channel: drawn(log.channels[channel], 10.0)})
    with pytest.raises(FlightError, match=words):
        prepared(lines, motors=model)


def test_a_late_pose_is_the_pose_of_before(flight):
    late = prepared(pose_log(flight, pose_delay=0.01)).data
    now = prepared(pose_log(flight)).data
    a = np.searchsorted(late.time, 5.0 + 0.01 - 1e-6)
    b = np.searchsorted(now.time, 5.0 - 1e-6)
    np.testing.assert_allclose(
        late.angular_velocity[a : a + 1000], now.angular_velocity[b : b + 1000], atol=1e-3
    )


def test_a_gap_is_cut_and_stands_in_the_result(flight):
    log = pose_log(flight)
    values = log.channels["position"].values.copy()
    values[2000:2010] = np.nan
    position = dataclasses.replace(log.channels["position"], values=values)
    result = prepared(with_channel(log, position=position))
    first, second = result.data.segments
    t = result.data.time
    assert t[first.stop - 1] == pytest.approx(9.995 - 0.1, abs=0.011)
    assert t[second.start] == pytest.approx(10.05 + 0.1, abs=0.011)
    (gap,) = [cut for cut in result.cuts if cut.reason == "gap in motion capture"]
    assert (gap.start, gap.end) == pytest.approx((9.995, 10.05))
    whole = prepared(log).data
    rows = slice(second.start, second.start + 500)
    at = np.searchsorted(whole.time, t[rows] - 1e-6)
    np.testing.assert_allclose(
        result.data.angular_acceleration[rows], whole.angular_acceleration[at], atol=0.05
    )


def test_start_and_end_by_hand(flight):
    result = prepared(pose_log(flight), window=(5.0, 9.0))
    t = result.data.time
    (segment,) = result.data.segments
    assert t[segment.start] - t[0] == pytest.approx(5.0, abs=0.006)
    assert t[segment.stop - 1] - t[0] == pytest.approx(9.0, abs=0.006)
    with pytest.raises(FlightError, match="no usable samples between start = 100 s"):
        prepared(pose_log(flight), window=(100.0, None))


def test_commands_with_their_law_and_lag(flight):
    log = pose_log(flight)
    motors = MotorModel(
        speed="commanded", law=MotorLaw(curve=PolynomialCurve((0.0, flight.max_speed))), lag=0.04
    )
    data = prepared(log, motors=motors).data
    rows = slice(data.segments[0].start, data.segments[0].stop)
    at = np.round(data.time[rows] * 200).astype(int)
    # A held command acts half a sample later than its smooth picture.
    later = (flight.rotor_speed[at] + flight.rotor_speed[at + 1]) / 2
    assert np.sqrt(((data.rotor_speed[rows] - later) ** 2).mean()) < 0.7


def test_noise_of_rotor_speed_has_the_density_of_the_log(flight):
    log = pose_log(flight, pose_rate=100.0, rotor_speed_resolution=6.0)
    assert prepared(log).data.rotor_speed_std == pytest.approx(6 / np.sqrt(24), rel=0.1)


def test_no_motor_data(flight):
    log = pose_log(flight)
    bare = flight_log(position=log.channels["position"], attitude=log.channels["attitude"])
    with pytest.raises(LogError, match=r"no motor data \(neither rotor_speed nor command"):
        prepared(bare)
    with pytest.raises(LogError, match="but the airframe 6 rotors"):
        prepared(log, rotor_count=6)


def test_motors_of_another_clock(flight):
    log = pose_log(flight)
    speed = log.channels["rotor_speed"]
    elsewhere = dataclasses.replace(speed, time=speed.time + 1000.0)
    with pytest.raises(FlightError, match="never run together"):
        prepared(with_channel(log, rotor_speed=elsewhere))


def test_a_world_with_y_up_is_refused(flight):
    log = pose_log(flight)
    values = log.channels["position"].values[:, [0, 2, 1]]
    q = log.channels["attitude"].values
    quarter = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
    turned = np.stack(
        [
            quarter[0] * q[:, 0] - quarter[1] * q[:, 1],
            quarter[0] * q[:, 1] + quarter[1] * q[:, 0],
            quarter[0] * q[:, 2] - quarter[1] * q[:, 3],
            quarter[0] * q[:, 3] + quarter[1] * q[:, 2],
        ],
        axis=1,
    )
    wrong = with_channel(
        log,
        position=dataclasses.replace(log.channels["position"], values=values),
        attitude=dataclasses.replace(log.channels["attitude"], values=turned),
    )
    with pytest.raises(FrameError, match="many systems have y up"):
        prepared(wrong)


def test_slow_cameras_are_a_doubt(flight, assert_wording):
    result = prepared(pose_log(flight, pose_rate=50.0))
    assert any("at 50 Hz" in doubt for doubt in result.warnings)
    assert_wording(result.warnings)


def test_jitter_that_was_mended_is_a_doubt(flight, assert_wording):
    log = pose_log(flight, pose_rate=100.0)
    jitter = 8e-4 * np.random.default_rng(1).normal(size=len(log.channels["position"].time))
    late = {
        name: dataclasses.replace(log.channels[name], time=log.channels[name].time + jitter)
        for name in ("position", "attitude")
    }
    (doubt,) = prepared(with_channel(log, **late)).warnings
    assert "by 0.8 ms" in doubt
    assert "regular 100.00 Hz" in doubt
    assert_wording(doubt)
