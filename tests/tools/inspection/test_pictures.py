"""What is drawn of a log stands where it was planted: gaps, limits, peaks, filters, motion."""

from pathlib import Path

import numpy as np
import pytest

from rotorfit.logs.firmware import filters_on_board
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.tools.inspection.pictures import COLUMNS, log_pictures, time_picture
from rotorfit.tools.inspection.recording import channel_report
from rotorfit.tools.inspection.spectra import rotor_bands, spectrum

ROTOR = 187.0
"""Of a planted vibration [Hz]."""


def channel(time, values, source="test"):
    return Channel(time=time, values=np.asarray(values, dtype=float), source=source)


def log_of(channels, *, log_format="table", **metadata):
    seconds = max(float(c.time[-1] - c.time[0]) for c in channels.values())
    return FlightLog(
        path=Path("made.csv"),
        sha256="0" * 64,
        format=log_format,
        channels=channels,
        seconds=seconds,
        metadata=metadata,
    )


def shaken(rate, seconds, turning, *, shaking):
    """Return noise with a sine of ROTOR where `shaking`, and rotors at `turning` [Hz] beside it."""
    t = np.arange(round(rate * seconds)) / rate
    rng = np.random.default_rng(4)
    gyro = 0.02 * rng.normal(size=(len(t), 3))
    gyro[:, 1] += 0.05 * np.sin(2 * np.pi * ROTOR * t) * shaking(t)
    speed = 2 * np.pi * np.tile(turning(t)[:, None], 4)
    return channel(t, gyro), channel(t, speed)


def peaks(gyro, speed):
    return spectrum("gyro", gyro, spans=[], rotor_speed=speed).peaks


def test_a_sine_at_the_rotors_frequency_is_named(assert_text):
    gyro, speed = shaken(1000.0, 20.0, lambda t: ROTOR + 0.0 * t, shaking=np.ones_like)
    [peak] = peaks(gyro, speed)
    assert_text(peak.words)
    [peak] = peaks(gyro, channel(speed.time, speed.values / 2))
    assert_text(peak.words)
    [peak] = peaks(gyro, None)
    assert peak.words == "187 Hz"


def test_a_sine_that_stays_when_the_rotors_change_is_not_theirs():
    def turning(t):
        return np.where(t < 10.0, ROTOR, 230.0)

    gyro, speed = shaken(1000.0, 20.0, turning, shaking=np.ones_like)
    [peak] = peaks(gyro, speed)
    assert peak.harmonic is None
    gyro, speed = shaken(1000.0, 20.0, turning, shaking=lambda t: t < 10.0)
    [peak] = peaks(gyro, speed)
    assert peak.harmonic == 1


def test_a_slow_log_folds_the_sine_down_and_says_so(assert_text):
    gyro, speed = shaken(
        300.0, 24.0, lambda t: np.where(t < 12.0, ROTOR, 140.0), shaking=lambda t: t < 12.0
    )
    [peak] = peaks(gyro, speed)
    assert_text(peak.words)


def test_noise_has_no_peak():
    gyro, speed = shaken(1000.0, 20.0, lambda t: ROTOR + 0.0 * t, shaking=np.zeros_like)
    assert peaks(gyro, speed) == ()


def test_the_density_is_that_of_the_noise():
    """White noise of deviation s at a rate f has the amplitude density s sqrt(2 / f)."""
    gyro, _ = shaken(1000.0, 60.0, lambda t: t, shaking=np.zeros_like)
    found = spectrum("gyro", gyro, spans=[(5.0, 50.0)], rotor_speed=None)
    assert found.density["x"].mean() == pytest.approx(0.02 * np.sqrt(2 / 1000.0), rel=0.03)
    assert found.seconds == pytest.approx(45.0, abs=1.0)
    assert (found.frequency[0], found.frequency[-1]) == (1.0, 500.0)


def test_where_rotors_turn():
    t = np.arange(1000) / 100.0
    speed = channel(t, 2 * np.pi * np.tile(np.linspace(100.0, 200.0, 1000)[:, None], 4))
    first, second, *_ = rotor_bands(speed, [])
    assert (first.low, first.high) == pytest.approx((110.0, 190.0))
    assert (second.low, second.high) == pytest.approx((220.0, 380.0))
    [late, *_] = rotor_bands(speed, [(9.0, 10.0)])
    assert late.low > 189.0


@pytest.fixture(scope="module")
def marked():
    """A log of 20 s with a gap of the gyro, a clipped accelerometer and a full command."""
    t = np.arange(4000) / 200.0
    gyro = 0.01 * np.random.default_rng(1).normal(size=(4000, 3))
    roll = (t > 12.0) & (t < 15.0)
    gyro[:, 0] += roll * np.radians(80.0) * np.sin(2 * np.pi * t)
    accel = np.tile([0.0, 0.0, 9.81], (4000, 1)) + 0.1 * np.random.default_rng(2).normal(
        size=(4000, 3)
    )
    swing = (t > 3.0) & (t < 4.0)
    accel[:, 2] += swing * 200.0 * np.sin(2 * np.pi * (t - 3.0))
    accel = np.clip(accel, -156.9, 156.9)
    command = np.full((4000, 4), 0.5)
    command[1000:1200, 2] = 1.0
    kept = (t < 7.0) | (t >= 7.5)
    return log_of(
        {
            "gyro": channel(t[kept], gyro[kept]),
            "accel": channel(t, accel),
            "command": channel(t, command),
        }
    )


def test_gap_limit_and_full_command_are_marked_where_they_are(marked):
    picture, why = time_picture(marked, zero=0.0)
    assert why == []
    found = [(m.kind, m.channel, round(m.start, 3), round(m.end, 3)) for m in picture.marks]
    gap, high, low, full = found
    assert gap == ("gap", "gyro", 6.995, 7.5)
    # sin > 147.1 / 200 from 47 to 133 degrees of a period of 1 s that begins at 3 s
    assert high[:2] == low[:2] == ("limit", "accel")
    assert high[2:] == pytest.approx((3.13, 3.37), abs=0.011)
    assert low[2:] == pytest.approx((3.66, 3.84), abs=0.011)
    assert full == ("limit", "command", 5.0, 5.995)


def test_which_axis_moved_when(marked):
    picture, _ = time_picture(marked, zero=0.0)
    seconds = {a.axis: a.seconds(2) for a in picture.activity}
    assert seconds["roll"] == pytest.approx(3.0, abs=0.3)
    assert (seconds["pitch"], seconds["yaw"]) == (0.0, 0.0)
    assert 0.5 <= seconds["thrust"] <= 1.5
    [roll] = [a for a in picture.activity if a.axis == "roll"]
    assert roll.seconds(2, [(0.0, 13.5)]) == pytest.approx(1.5, abs=0.3)
    inside = roll.size[round(12.5 / roll.step) : round(14.5 / roll.step)]
    assert inside == pytest.approx(80.0 / np.sqrt(2.0), rel=0.15)


def test_a_long_log_is_kept_small_with_its_extremes():
    count = 300_000
    values = np.random.default_rng(3).normal(size=(count, 3))
    gaps = np.random.default_rng(3).choice([0.001, 0.1], size=count, p=[0.9, 0.1])
    log = log_of({"gyro": channel(np.cumsum(gaps), values)})
    picture, _ = time_picture(log, zero=0.0)
    [series] = picture.traces[0].curves
    assert len(series.time) <= 3 * COLUMNS
    for axis, column in zip("xyz", values.T, strict=True):
        assert (series.values[axis].min(), series.values[axis].max()) == (
            column.min(),
            column.max(),
        )
    assert len(picture.marks) <= 800


def test_a_column_without_samples_is_left_out_alone():
    t = np.arange(1000) / 100.0
    speeds = np.full((1000, 4), 500.0)
    speeds[:, 1] = np.nan
    speeds[::2, 3] = np.nan
    picture, why = time_picture(log_of({"rotor_speed": channel(t, speeds)}), zero=0.0)
    [trace] = picture.traces
    assert [sorted(curve.values) for curve in trace.curves] == [["1", "3"], ["4"]]
    assert [len(curve.time) for curve in trace.curves] == [1000, 500]
    assert why == []


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        ({"command": channel(np.arange(99) / 9.0, np.ones((99, 4)))}, "no spectrum of gyro: the"),
        ({"gyro": channel(np.arange(30) / 9.0, np.ones((30, 3)))}, "holds 64 samples"),
        ({"gyro": channel(np.arange(9.0)[::-1], np.ones((9, 3)))}, "runs backwards"),
        ({"gyro": channel(np.arange(9.0), np.full((9, 3), np.nan))}, "0 usable samples"),
    ],
    ids=["no gyro", "short", "backwards", "nan"],
)
def test_what_cannot_be_drawn_says_why(channels, said):
    log = log_of(channels)
    reports = {name: channel_report(name, c) for name, c in channels.items()}
    found = log_pictures(log, None, reports)
    assert any(said in words for words in found.left_out), found.left_out


BETAFLIGHT = {
    "gyro_lpf1_static_hz": "250",
    "gyro_lpf1_dyn_hz": "250,500",
    "gyro_lpf2_static_hz": "400",
    "gyro_notch_hz": "180,0",
    "gyro_notch_cutoff": "150,0",
    "dyn_notch_count": "2",
    "dyn_notch_min_hz": "100",
    "dyn_notch_max_hz": "600",
    "rpm_filter_harmonics": "3",
    "rpm_filter_min_hz": "90",
    "dshot_bidir": "1",
    "acc_lpf_hz": "2500",
}


def imu(gyro="gyroADC", accel="accSmooth"):
    t = np.arange(10.0)
    return {
        "gyro": channel(t, np.ones((10, 3)), gyro),
        "accel": channel(t, np.ones((10, 3)), accel),
    }


def test_filters_of_betaflight_stand_at_the_headers_frequencies():
    found = filters_on_board(log_of(imu(), log_format="blackbox", **BETAFLIGHT))
    assert [(f.channel, f.kind, f.low, f.middle, f.high, f.harmonics) for f in found] == [
        ("gyro", "low-pass", 250.0, None, 500.0, ()),
        ("gyro", "low-pass", 400.0, None, 400.0, ()),
        ("gyro", "notch", 150.0, 180.0, 216.0, ()),
        ("gyro", "notch", 100.0, None, 600.0, ()),
        ("gyro", "notch", 90.0, None, 90.0, (1, 2, 3)),
        ("accel", "low-pass", 25.0, None, 25.0, ()),
    ]
    assert all(f.passed for f in found)
    assert found[2].short == "notch 180 Hz"
    off = BETAFLIGHT | {"dyn_notch_count": "0", "dshot_bidir": "0", "gyro_lpf1_dyn_hz": "0,500"}
    raw = filters_on_board(log_of(imu(accel="accUnfiltered"), log_format="blackbox", **off))
    assert [(f.low, f.passed) for f in raw] == [
        (250.0, True), (400.0, True), (150.0, True), (25.0, False),
    ]  # fmt: skip


def test_filters_of_inav():
    stated = {
        "Firmware revision": "INAV 7.1.0",
        "gyro_lpf_hz": "60",
        "acc_lpf_hz": "15",
        "acc_notch_hz": "90",
        "acc_notch_cutoff": "60",
        "rpm_gyro_filter_enabled": "1",
        "rpm_gyro_harmonics": "2",
        "rpm_gyro_min_hz": "80",
    }
    found = filters_on_board(log_of(imu(), log_format="blackbox", **stated))
    assert [(f.channel, f.low, f.high, f.harmonics) for f in found] == [
        ("gyro", 60.0, 60.0, ()),
        ("accel", 60.0, 135.0, ()),
        ("gyro", 80.0, 80.0, (1, 2)),
        ("accel", 15.0, 15.0, ()),
    ]


def test_filters_of_px4_are_behind_the_samples_of_the_sensors(assert_wording):
    stated = {
        "IMU_GYRO_CUTOFF": "40",
        "IMU_ACCEL_CUTOFF": "30",
        "IMU_GYRO_NF0_FRQ": "80",
        "IMU_GYRO_NF0_BW": "20",
        "IMU_GYRO_DNF_EN": "1",
        "IMU_GYRO_DNF_HMC": "2",
        "IMU_GYRO_DNF_MIN": "25",
    }
    sensors = imu("sensor_combined.gyro_rad", "sensor_combined.accelerometer_m_s2")
    found = filters_on_board(log_of(sensors, log_format="ulog", **stated))
    assert [(f.low, f.high, f.harmonics, f.passed) for f in found] == [
        (40.0, 40.0, (), False),
        (70.0, 90.0, (), False),
        (25.0, 25.0, (1, 2), False),
        (30.0, 30.0, (), False),
    ]
    assert_wording(found[0].words)
    control = filters_on_board(
        log_of(imu("vehicle_angular_velocity.xyz"), log_format="ulog", **stated)
    )
    assert control[0].passed and not control[-1].passed


def test_filters_of_ardupilot():
    stated = {
        "INS_GYRO_FILTER": "20",
        "INS_ACCEL_FILTER": "10",
        "INS_HNTCH_ENABLE": "1",
        "INS_HNTCH_MODE": "3",
        "INS_HNTCH_FREQ": "60",
        "INS_HNTCH_HMNCS": "5",
        "INS_HNTC2_ENABLE": "1",
        "INS_HNTC2_MODE": "0",
        "INS_HNTC2_FREQ": "120",
        "INS_HNTC2_BW": "30",
    }
    found = filters_on_board(log_of(imu("IMU.GyrX", "IMU.AccX"), log_format="dataflash", **stated))
    assert [(f.low, f.high, f.harmonics) for f in found] == [
        (20.0, 20.0, ()),
        (60.0, 60.0, (1, 3)),
        (105.0, pytest.approx(120.0**2 / 105.0), ()),
        (10.0, 10.0, ()),
    ]
    raw = filters_on_board(log_of(imu("GYR1.GyrX", "ACC1.AccX"), log_format="dataflash", **stated))
    assert not any(f.passed for f in raw)


def test_settings_that_are_no_numbers_are_no_filters():
    stated = {"gyro_lpf1_static_hz": "fast", "gyro_notch_hz": "180", "acc_lpf_hz": ""}
    assert filters_on_board(log_of(imu(), log_format="blackbox", **stated)) == ()
    assert filters_on_board(log_of(imu(), log_format="table", gyro_lpf1_static_hz="100")) == ()
