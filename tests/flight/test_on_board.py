"""Filters on board: their responses, and rotors that pass them, against scipy's and by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

import made_fit
from rotorfit.flight.on_board import (
    MOST_RESTORED,
    applied_filters,
    filter_response,
    passed_through,
    response_of,
    restoring_response,
    with_filters,
    without_lateness,
)
from rotorfit.logs.blackbox.firmware import filters as of_betaflight
from rotorfit.logs.dataflash.firmware import filters as of_ardupilot
from rotorfit.logs.firmware import Filter
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.logs.ulog.firmware import filters as of_px4

NO_GAPS = np.zeros(0, dtype=np.int64)


def low_pass(cutoff, shape="butterworth", channel="gyro"):
    return Filter(
        channel=channel,
        kind="low-pass",
        low=cutoff,
        high=cutoff,
        setting="x",
        passed=True,
        shape=shape,
    )


@given(st.floats(5.0, 400.0), st.sampled_from(["butterworth", "pt1", "pt2", "pt3"]))
def test_low_passes_lose_3_db_at_their_cut_off(cutoff, shape):
    gain = filter_response(low_pass(cutoff, shape), np.array([0.0, cutoff, 10.0 * cutoff]))
    assert np.abs(gain[:2]) == pytest.approx([1.0, 0.5**0.5])
    order = {"butterworth": 2, "pt1": 1, "pt2": 2, "pt3": 3}[shape]
    # Far above, they fall with their order; cut-offs of first orders in a row are higher.
    wider = 1.0 if shape == "butterworth" else (2.0 ** (1.0 / order) - 1.0) ** -0.5
    assert abs(gain[2]) == pytest.approx((wider / 10.0) ** order, rel=0.05 * order)


def test_a_butterworth_delays_slow_motion_by_its_root_of_two():
    """INS_GYRO_FILTER at 20 Hz: 11.25 ms, and a gain of .60 at 23 Hz."""
    slow, quick = filter_response(low_pass(20.0), np.array([0.01, 23.0]))
    late = -np.angle(slow) / (2.0 * np.pi * 0.01)
    assert late == pytest.approx(0.01125, rel=1e-3)
    assert abs(quick) == pytest.approx(0.603, abs=1e-3)


@pytest.mark.parametrize(("middle", "low"), [(80.0, 60.0), (120.0, 105.0)])
def test_a_notch_loses_3_db_at_its_edges(middle, low):
    high = middle**2 / low
    one = Filter(
        channel="gyro", kind="notch", low=low, high=high, middle=middle, setting="x", passed=True
    )
    gain = np.abs(filter_response(one, np.array([0.0, low, middle, high])))
    assert gain == pytest.approx([1.0, 0.5**0.5, 0.0, 0.5**0.5], abs=1e-9)


@given(st.floats(8.0, 60.0), st.integers(0, 100))
def test_rotors_pass_the_filter_as_a_gyro_at_4_khz_does(cutoff, seed):
    """Motion about the cut-off, filtered on board as digital filters are, and read at 400 Hz."""
    fast, every = 4000.0, 10
    rng = np.random.default_rng(seed)
    t = np.arange(round(4.0 * fast)) / fast
    places = cutoff * rng.uniform(0.2, 1.5, 8)
    swing = np.cos(2.0 * np.pi * places * t[:, None] + rng.uniform(0.0, 6.0, 8)).sum(axis=1)
    speed = 500.0 + 10.0 * swing[:, None]
    sos = signal.butter(2, cutoff, fs=fast, output="sos")
    begun = signal.sosfilt_zi(sos)[:, :, None] * speed[0]
    on_board = signal.sosfilt(sos, speed, axis=0, zi=begun)[0][::every]
    found = passed_through(speed[::every], fast / every, [low_pass(cutoff)], jumps=NO_GAPS)
    middle = slice(400, 1200)  # away from the ends
    assert np.abs(found - on_board)[middle].max() < 0.01 * np.abs(10.0 * swing).max()


def test_every_piece_between_gaps_begins_settled():
    speed = np.repeat([[300.0], [700.0]], 400, axis=0)
    found = passed_through(speed, 400.0, [low_pass(20.0)], jumps=np.array([400]))
    np.testing.assert_allclose(found, speed, atol=1e-6)
    joined = passed_through(speed, 400.0, [low_pass(20.0)], jumps=NO_GAPS)
    assert np.abs(joined - speed).max() > 100.0


def test_only_the_gyros_filters_act_on_the_rotors():
    speed = np.random.default_rng(0).uniform(300.0, 700.0, (500, 4))
    assert passed_through(speed, 400.0, [low_pass(20.0, channel="accel")], jumps=NO_GAPS) is speed


def behind(sos, values):
    """Filter rows on board, begun settled."""
    begun = signal.sosfilt_zi(sos)[:, :, None] * values[0]
    return signal.sosfilt(sos, values, axis=0, zi=begun)[0]


def digital(one, fast):
    """Return a low-pass as a firmware computes it at a fast rate."""
    if one.shape == "butterworth":
        return signal.butter(2, one.low, fs=fast, output="sos")
    order = {"pt1": 1, "pt2": 2}[one.shape]
    wider = (2.0 ** (1.0 / order) - 1.0) ** -0.5
    once = signal.butter(1, wider * one.low, fs=fast, output="sos")
    return np.concatenate([once] * order)


PAIRS = {
    "ArduPilot, 10 and 20 Hz": (
        low_pass(10.0, channel="accel"),
        low_pass(20.0),
    ),
    "PX4, 15 and 40 Hz": (low_pass(15.0, channel="accel"), low_pass(40.0)),
    "Betaflight, 10 and 100 Hz": (low_pass(10.0, "pt2", channel="accel"), low_pass(100.0, "pt1")),
    "an accelerometer quicker than the gyro": (
        low_pass(100.0, "pt2", channel="accel"),
        low_pass(20.0),
    ),
}


@pytest.mark.parametrize("filters", PAIRS.values(), ids=PAIRS)
def test_thrust_about_the_accelerometers_cut_off_shows_kt(filters):
    """The slope of the specific force by the rotors, both as logged, is k_t over the mass."""
    accel = filters[0]
    fast, every, slope = 4000.0, 8, 0.02
    rng = np.random.default_rng(5)
    t = np.arange(round(6.0 * fast)) / fast
    places = rng.uniform(0.5, 1.2, 12) * min(accel.low, 16.0)
    swing = 40.0 * np.cos(2.0 * np.pi * places * t[:, None] + rng.uniform(0.0, 6.0, 12)).sum(axis=1)
    thrust = np.column_stack([np.zeros((len(t), 2)), slope * (500.0 + swing)])
    noise = 0.02 * rng.normal(size=(len(t[::every]), 3))
    read = behind(digital(accel, fast), thrust)[::every] + noise
    rate = fast / every
    rotors = passed_through((500.0 + swing)[::every, None], rate, filters, jumps=NO_GAPS)[:, 0]
    data = made_fit.prepared(seconds=6.0, rate=rate, force=read).data
    found = with_filters(data, filters, jumps=NO_GAPS)
    assert found.filters == filters
    inside = slice(500, -500)  # away from the ends
    slopes = [
        np.polyfit(rotors[inside], force[inside, 2], 1)[0] / slope
        for force in (found.specific_force, read)
    ]
    assert slopes[0] == pytest.approx(1.0, abs=0.01)
    assert abs(slopes[1] - 1.0) > 0.1


@pytest.mark.parametrize("filters", PAIRS.values(), ids=PAIRS)
def test_drag_is_in_proportion_to_the_filtered_velocity(filters):
    """The velocity is estimated from raw samples; what leads it would look like a lever."""
    accel, fast, every, drag = filters[0], 4000.0, 8, -0.4
    rng = np.random.default_rng(8)
    t = np.arange(round(8.0 * fast)) / fast
    angle = 2.0 * np.pi * rng.uniform(0.4, 4.0, 12) * t[:, None] + rng.uniform(0.0, 6.0, 12)
    moving = np.outer(np.cos(angle).sum(axis=1), [1.0, -0.5, 0.2])
    read = behind(digital(accel, fast), drag * moving)[::every]
    velocity = moving[::every].copy()
    velocity[1000:1050] = np.nan  # a gap in the positions
    data = made_fit.prepared(seconds=8.0, rate=fast / every, force=read).data
    found = with_filters(replace(data, velocity=velocity), filters, jumps=NO_GAPS)
    assert np.array_equal(np.isnan(found.velocity), np.isnan(velocity))
    known = np.isfinite(velocity).all(axis=1)
    known[:600] = known[-600:] = known[900:1150] = False
    left = found.specific_force - drag * found.velocity
    raw = found.specific_force - drag * velocity
    assert np.abs(left[known]).max() < 0.1 * np.abs(raw[known]).max()


def test_what_a_filter_has_lost_is_not_amplified_without_end():
    own = (low_pass(5.0, channel="accel"), low_pass(100.0))
    gain = np.abs(restoring_response(own, np.linspace(0.0, 200.0, 5000)))
    assert gain.max() == pytest.approx(MOST_RESTORED, rel=0.02)
    assert gain[-1] < 0.1


def test_accelerometers_without_other_filters_stay():
    force = 9.8 + np.random.default_rng(2).normal(size=(2000, 3))
    data = made_fit.prepared(force=force).data
    bare = with_filters(data, (low_pass(20.0),), jumps=NO_GAPS)
    assert bare.specific_force is force
    alike = with_filters(data, (low_pass(20.0), low_pass(20.0, channel="accel")), jumps=NO_GAPS)
    assert alike.specific_force is force


def log_of(gyro, accel="", **settings):
    time, values = np.zeros(1), np.zeros((1, 3))
    channels = {
        name: Channel(time=time, values=values, source=source)
        for name, source in (("gyro", gyro), ("accel", accel))
    }
    return FlightLog(
        path=Path("made"),
        sha256="0",
        format="dataflash",
        channels=channels,
        seconds=1.0,
        metadata=settings,
    )


def known(filters):
    return [(one.kind, one.shape) for one in filters if one.passed and one.is_known]


def test_betaflights_low_passes_have_the_shape_of_the_header():
    stated = {
        "Firmware revision": "Betaflight 4.3.1",
        "gyro_lpf1_static_hz": "100",
        "gyro_lpf1_type": "3",
        "gyro_lpf2_static_hz": "250",
        "gyro_lpf2_type": "1",
        "gyro_notch_hz": "180",
        "gyro_notch_cutoff": "150",
        "acc_lpf_hz": "1000",
    }
    log = log_of("gyroADC[0..2]", "accSmooth[0..2]", **stated)
    shapes = ["pt3", "butterworth", "butterworth", "butterworth"]
    assert [shape for _, shape in known(of_betaflight(log))] == shapes
    newer = log_of("gyroADC", "accSmooth", **{**stated, "Firmware revision": "Betaflight 4.5.0"})
    assert known(of_betaflight(newer))[-1] == ("low-pass", "pt2")
    unfiltered = log_of("gyroUnfilt[0..2]", "accUnfiltered[0..2]", **stated)
    assert known(of_betaflight(unfiltered)) == []
    untyped = {name: value for name, value in stated.items() if not name.endswith("_type")}
    kinds = [kind for kind, _ in known(of_betaflight(log_of("gyroADC", "accSmooth", **untyped)))]
    assert kinds == ["notch", "low-pass"]  # of the gyro's low-passes nobody knows the shape


def test_raw_samples_of_ardupilot_and_px4_passed_no_filter():
    stated = {"INS_GYRO_FILTER": "20", "INS_ACCEL_FILTER": "10", "INS_HNTCH_ENABLE": "1"}
    stated |= {"INS_HNTCH_MODE": "0", "INS_HNTCH_FREQ": "60", "INS_HNTCH_BW": "20"}
    stated |= {"INS_HNTCH_HMNCS": "3"}
    filtered = of_ardupilot(log_of("IMU[0].GyrX", "IMU[0].AccX", **stated))
    assert [one.middle for one in filtered if one.kind == "notch"] == [60.0, 120.0]
    assert len(known(filtered)) == 4
    assert known(of_ardupilot(log_of("GYR[0].GyrX", "ACC[0].AccX", **stated))) == []
    px4 = {"IMU_GYRO_CUTOFF": "40", "IMU_ACCEL_CUTOFF": "30"}
    assert known(of_px4(log_of("sensor_combined.gyro_rad", "sensor_combined.acc", **px4))) == []
    behind = log_of("vehicle_angular_velocity.xyz", "vehicle_acceleration.xyz", **px4)
    assert known(of_px4(behind)) == [("low-pass", "butterworth")] * 2


def test_filters_that_follow_the_rotors_are_not_applied():
    stated = {"INS_GYRO_FILTER": "20", "INS_HNTCH_ENABLE": "1", "INS_HNTCH_MODE": "3"}
    log = log_of("IMU[0].GyrX", "IMU[0].AccX", INS_HNTCH_FREQ="60", **stated)
    [one] = applied_filters(log)
    assert (one.kind, one.low) == ("low-pass", 20.0)
    grid = np.array([5.0, 20.0])
    assert np.abs(response_of([one], "accel", grid)) == pytest.approx([1.0, 1.0])


@given(st.floats(4.0, 20.0), st.floats(0.1, 0.8))
def test_a_force_is_moved_by_its_lateness_alone(cutoff, share):
    """A swing behind a low-pass comes as late as its phase says, and keeps its height."""
    flight = made_fit.prepared(seconds=20.0).data
    f, t = share * cutoff, flight.time
    response = filter_response(low_pass(cutoff), np.array([f]))[0]
    swing = np.exp(2j * np.pi * f * t)[:, None] * np.array([1.0, 1j, -0.5])
    late = replace(flight, specific_force=np.real(response * swing))
    found = without_lateness(late, lambda at: filter_response(low_pass(cutoff), at), jumps=NO_GAPS)
    middle = slice(len(t) // 4, -len(t) // 4)
    in_time = np.abs(response) * np.real(swing)
    assert found.specific_force[middle] == pytest.approx(in_time[middle], abs=0.02)
    assert (found.rotor_speed == late.rotor_speed).all()
