"""Units, axes and words of the channels that a Blackbox log gives."""

import math

import blackbox_encoder as encoder
import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.blackbox import is_blackbox
from rotorfit.logs.blackbox.listing import list_blackbox_logs
from rotorfit.logs.blackbox.read import read_blackbox
from rotorfit.logs.flight_log import CHANNELS, FlightLog


def log_of(tmp_path, fields: dict[str, list[int]], **entries: str | None) -> FlightLog:
    """Read a log of I frames with these fields, 1 ms apart, and these header lines."""
    count = len(next(iter(fields.values())))
    recorder = encoder.Recorder(i_interval=1)
    recorder.entries |= {name: text for name, text in entries.items() if text is not None}
    for name in [name for name, text in entries.items() if text is None]:
        del recorder.entries[name]
    head = encoder.MAIN_FIELDS[:2]
    recorder.main_fields = [*head, *[(name, 1, 0, 0, 0, 0) for name in fields]]
    for i in range(count):
        recorder.record([i, 1000 * i + 500, *(v[i] for v in fields.values())], is_intra=True)
    recorder.end()
    path = tmp_path / "log.bbl"
    path.write_bytes(recorder.data)
    return read_blackbox(path)


def vector(name: str, *columns: list[int]) -> dict[str, list[int]]:
    return {f"{name}[{i}]": column for i, column in enumerate(columns)}


BETAFLIGHT_43 = {"Firmware revision": "Betaflight 4.3.1 (abc) STM32F405", "motor_poles": None}


def speeds_in_debug(tmp_path, mode, poles=None, **entries):
    fields = {
        **vector("motor", *[[158, 2047, 300]] * 4),
        **vector("debug", [60, 70, 80], [61, 71, 81], [62, 72, 82], [63, 73, 83]),
    }
    path = tmp_path / "log.bbl"
    log_of(tmp_path, fields, debug_mode=mode, **(BETAFLIGHT_43 | entries))
    return read_blackbox(path, motor_poles=poles)


def test_speeds_in_debug_of_older_betaflight(tmp_path):
    values = np.array([[60, 61, 62, 63], [70, 71, 72, 73], [80, 81, 82, 83]])
    hertz = speeds_in_debug(tmp_path, "46").channels["rotor_speed"]
    np.testing.assert_allclose(hertz.values, 2 * np.pi * values)
    assert "RPM_FILTER" in hertz.source
    electrical = 100 * 2 * np.pi / 60 * values
    by_file = speeds_in_debug(tmp_path, "45", poles=12).channels["rotor_speed"]
    np.testing.assert_allclose(by_file.values, electrical / 6)
    by_header = speeds_in_debug(tmp_path, "45", poles=12, motor_poles="14").channels["rotor_speed"]
    np.testing.assert_allclose(by_header.values, electrical / 7)


@pytest.mark.parametrize(
    ("mode", "entries", "words"),
    [
        ("45", {}, "the header no motor_poles"),
        ("6", {}, "neither omega nor eRPM"),
        ("46", {"Firmware revision": "Betaflight 4.5.0 (a) X"}, "neither omega nor eRPM"),
        ("46", {"Firmware revision": "INAV 7.0.0 (a) X"}, "INAV to 9 has no"),
    ],
)
def test_debug_holds_no_speeds(tmp_path, mode, entries, words):
    log = speeds_in_debug(tmp_path, mode, **entries)
    assert "rotor_speed" not in log.channels
    assert any(words in note for note in log.notes)


INDIFLIGHT = {"Firmware revision": "Indiflight 5.0.0 (abc) TEST"}


def test_shapes_clock_and_words(tmp_path, assert_text):
    fields = {
        **vector("gyroADC", [1, 2, 3], [4, 5, 6], [7, 8, 9]),
        **vector("motor", *[[158, 2047, 0]] * 4),
        "vbatLatest": [1600, 1599, 1598],
    }
    log = log_of(tmp_path, fields)
    assert (log.format, log.log_number, log.logs_in_file) == ("blackbox", 1, 1)
    assert log.seconds == pytest.approx(0.002)
    assert len(log.sha256) == 64
    for name, channel in log.channels.items():
        assert channel.time.tolist() == pytest.approx([0.0005, 0.0015, 0.0025])
        columns = CHANNELS[name][0] or 4
        assert channel.values.shape == (3, columns)
    assert log.metadata["Firmware revision"] == "Betaflight 4.5.0 (norevision) TEST"
    assert log.metadata["Craft name"] == "Prüfstand"
    assert log.metadata["gyro_lpf1_static_hz"] == "250"
    assert_text(log.notes)


@pytest.mark.parametrize(
    ("entries", "scale"),
    [
        ({}, math.radians(1)),
        ({"blackbox_high_resolution": "1"}, math.radians(0.1)),
        ({"gyro_scale": "0x3d79c190"}, math.radians(0.0609755)),  # 16.4 counts per deg/s
        ({"gyro_scale": "0x308f9e14"}, 1.044955e-3),  # Baseflight: rad/us
    ],
)
def test_gyro_scale(tmp_path, entries, scale):
    log = log_of(tmp_path, vector("gyroADC", [0, 100], [0, -50], [0, 7]), **entries)
    gyro = log.channels["gyro"]
    assert gyro.values[1] == pytest.approx(np.array([100, -50, 7]) * scale, rel=2e-5)
    assert gyro.resolution == pytest.approx(scale, rel=2e-5)


@pytest.mark.parametrize("text", [None, "0x7f800000", "0x0", "fast", ""])
def test_gyro_without_scale_is_left_out(tmp_path, text, assert_wording):
    log = log_of(tmp_path, vector("gyroADC", [1], [2], [3]), gyro_scale=text)
    assert "gyro" not in log.channels
    assert_wording(log.notes)


def test_accel_prefers_the_unfiltered_field(tmp_path, assert_text):
    fields = {**vector("accSmooth", [0], [0], [1]), **vector("accUnfiltered", [0], [2048], [4096])}
    accel = log_of(tmp_path, fields).channels["accel"]
    assert accel.values[0] == pytest.approx([0, 9.80665, 19.6133])
    assert_text(accel.source)
    assert accel.resolution == pytest.approx(9.80665 / 2048)


def test_accel_without_scale_is_left_out(tmp_path, assert_wording):
    log = log_of(tmp_path, vector("accSmooth", [0], [0], [1]), acc_1G="0")
    assert any("line acc_1G is" in note for note in log.notes)
    assert_wording(log.notes)


def test_erpm_and_motor_poles(tmp_path, assert_wording):
    log = log_of(tmp_path, vector("eRPM", [1400], [0]), motor_poles="14")
    speed = log.channels["rotor_speed"]
    # 140 000 electrical rpm, 7 pole pairs: 20 000 rpm
    assert speed.values[0] == pytest.approx([20_000 * 2 * math.pi / 60, 0])
    missing = log_of(tmp_path, vector("eRPM", [1400]), motor_poles=None)
    assert any("expected 2 or" in note for note in missing.notes)
    assert_wording(missing.notes)


def test_omega_has_as_many_rotors_as_motors(tmp_path):
    omega = vector("omegaUnfiltered", [1500], [1600], [0], [1700], [0], [0], [0], [0])
    log = log_of(tmp_path, {**omega, **vector("motor", *[[500]] * 4)})
    assert log.channels["rotor_speed"].values.tolist() == [[1500, 1600, 0, 1700]]
    assert log.channels["rotor_speed"].resolution == 1.0
    assert log_of(tmp_path, omega).channels["rotor_speed"].values.shape == (1, 4)


def test_command_is_the_fraction_of_the_output_range(tmp_path, assert_text, assert_wording):
    log = log_of(tmp_path, vector("motor", [0, 158, 1102, 2047, 2060]))
    command = log.channels["command"]
    assert command.values[:, 0] == pytest.approx([0, 0, 944 / 1889, 1, 1])
    assert_text(command.source)
    old = log_of(tmp_path, vector("motor", [1535]), motorOutput=None)
    assert old.channels["command"].values[0, 0] == pytest.approx(0.5)
    none = log_of(tmp_path, vector("motor", [1535]), motorOutput="5,5")
    assert_wording(none.notes)


@pytest.mark.parametrize(
    ("revision", "entries", "volts"),
    [
        ("Betaflight 4.2.0 (8f2d21460) STM32F745", {}, 16.0),
        ("Betaflight 2026.6.0-alpha (41848825e) STM32H743", {}, 16.0),
        ("INAV 7.1.0 (abc) MATEKF722", {}, 16.0),
        ("Betaflight 3.5.7 (abc) OMNIBUS", {"vbat_scale": "110"}, 1600 * 3.3 / 4095 * 11),
    ],
)
def test_battery(tmp_path, revision, entries, volts):
    log = log_of(tmp_path, {"vbatLatest": [1600]}, **{"Firmware revision": revision}, **entries)
    assert log.channels["battery"].values.tolist() == [[pytest.approx(volts)]]


def test_battery_of_unknown_scale_is_left_out(tmp_path, assert_wording):
    log = log_of(tmp_path, {"vbatLatest": [1600]}, **{"Firmware revision": "Homebrew 1"})
    assert_wording(log.notes)


def test_position_is_turned_upwards_and_only_new_fixes_count(tmp_path):
    fields = vector("extPos", [0, 1000, 1000, 1001], [0, 200, 200, 200], [0, -1500, -1500, -1500])
    position = log_of(tmp_path, fields, **INDIFLIGHT).channels["position"]
    assert position.values.tolist() == [
        pytest.approx([1.0, -0.2, 1.5]),
        pytest.approx([1.001, -0.2, 1.5]),
    ]
    assert position.time == pytest.approx([0.0015, 0.0035])
    assert "position" not in log_of(tmp_path, fields).channels


def test_attitude_of_indiflight(tmp_path, assert_wording):
    # pitched nose up by 90 degrees and yawed to the left: FRD to NED turned to FLU to NWU
    fields = vector("quat", [8127, 5747, 0], [0, 0, 0], [0, 5747, 0], [0, 0, 0])
    attitude = log_of(tmp_path, fields, **INDIFLIGHT).channels["attitude"]
    half = math.sqrt(0.5)
    assert attitude.values[:2].tolist() == [
        pytest.approx([1, 0, 0, 0]),
        pytest.approx([half, 0, -half, 0]),
    ]
    assert np.isnan(attitude.values[2]).all()
    other = log_of(tmp_path, fields)
    assert_wording(other.notes)


def test_the_clock_continues_where_its_32_bits_overflow(tmp_path):
    recorder = encoder.Recorder(i_interval=1)
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], ("x", 1, 0, 0, 0, 0)]
    for i in range(4):
        recorder.record([i, (1 << 32) - 2000 + 1000 * i, 0], is_intra=True)
    path = tmp_path / "log.bbl"
    path.write_bytes(recorder.data)
    assert read_blackbox(path).seconds == pytest.approx(0.003)


def test_recognised_by_content():
    head = encoder.Recorder().header()
    assert is_blackbox(head[:200])
    assert is_blackbox(b"\xff\x00" * 300 + head)
    assert not is_blackbox(b"ULog\x01\x12\x35")
    assert not is_blackbox(b"H Product:Blackbox flight data recorder by somebody else")


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "empty.bbl").write_bytes(b"")
    cases = [
        ("nowhere.bbl", "no such file: check the path"),
        ("", "is a directory, expected a log file"),
        ("empty.bbl", r"is empty \(0 bytes\)"),
    ]
    for name, message in cases:
        for function in (read_blackbox, list_blackbox_logs):
            with pytest.raises(LogError, match=message):
                function(tmp_path / name)


def test_a_log_without_frames_is_refused(tmp_path):
    path = tmp_path / "log.bbl"
    path.write_bytes(encoder.Recorder().header() + b"\xff" * 12)
    with pytest.raises(LogError, match="log 1 has no readable main frame in 12 bytes") as error:
        read_blackbox(path)
    assert str(path) in str(error.value)


def test_damage_is_noted(tmp_path, assert_wording):
    recorder = encoder.record_random(3, 320, p_interval="1/1", quiet=True)
    start = len(recorder.header()) + recorder.offsets[100]
    path = tmp_path / "log.bbl"
    path.write_bytes(recorder.data[: start + 20] + recorder.data[start + 26 : -3])
    notes = read_blackbox(path).warnings
    assert any(note.startswith("1 corrupt stretches: ") for note in notes)
    assert any("27 frames" in note for note in notes)
    assert_wording(notes)
    assert any(note.startswith("no end-of-log event: ") for note in notes)


def test_inav_is_not_advised_to_enable_what_it_does_not_have(tmp_path, assert_wording):
    log = log_of(tmp_path, vector("motor", [1535]), **{"Firmware revision": "INAV 7.1.0 (abc) F7"})
    [note] = [note for note in log.notes if note.startswith("no rotor_speed")]
    assert "to 9 has" in note
    assert "enable" not in note
    assert_wording(note)


@pytest.mark.parametrize(
    ("field", "entries", "asked"),
    [
        ("setpoint", {}, [100, -50, 7]),
        ("setpoint", {"blackbox_high_resolution": "1"}, [10, -5, 0.7]),
        ("axisRate", {"Firmware revision": "INAV 7.1.0 (abc) TEST"}, [100, -50, 7]),
        ("gyroSp", {**INDIFLIGHT, "blackbox_high_resolution": "1"}, [10, 5, -0.7]),
    ],
)
def test_what_was_asked_for_has_the_axes_of_the_gyro(tmp_path, field, entries, asked):
    """INDIflight alone asks in FRD."""
    log = log_of(tmp_path, vector(field, [0, 100], [0, -50], [0, 7]), **entries)
    assert log.channels["reference"].values[1] == pytest.approx(np.radians(asked))
