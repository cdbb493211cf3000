"""The bytes of a ULog: formats, damage, appended data, and whatever else a file may hold."""

import random
import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults
from ulog_encoder import (
    MAGIC,
    SYNC,
    Logged,
    Parts,
    actuator_motors,
    actuator_outputs,
    armed,
    encode,
    esc_status,
    mocap,
    sensor_combined,
)

from plain_loops import plain_loops
from rotorfit.errors import LogError
from rotorfit.logs import read_log
from rotorfit.logs.ulog import messages
from rotorfit.logs.ulog.messages import LARGEST_ROW, MOST_PLACES, parse_format, row_of
from rotorfit.logs.ulog.scan import scan_file

HEAD = MAGIC + b"\x01" + bytes(8)
N = 300
TIME = 50.0 + 0.004 * np.arange(N)
GYRO = np.random.default_rng(0).normal(size=(N, 3))
IMU = sensor_combined(TIME, GYRO, GYRO + np.array([0.0, 0.0, 9.8]))


def log_of(tmp_path, content):
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    return read_log(path)


def message(kind, content, *, size=None):
    return struct.pack("<HB", len(content) if size is None else size, ord(kind)) + content


def gyro_of(log):
    return log.channels["gyro"].values


# Formats


def test_the_padding_at_the_end_is_not_in_the_file():
    formats = dict(
        parse_format(text)
        for text in (
            "inner:uint32_t a;uint8_t b;uint8_t[3] _padding0;",
            "outer:uint64_t timestamp;inner[2] part;bool c;uint8_t[7] _padding0;uint8_t _padding1;",
        )
    )
    row = row_of(formats, "outer")
    assert row.dtype.itemsize == 8 + 2 * 8 + 1
    assert row.largest == 8 + 2 * 8 + 9
    assert row.dtype["part"].subdtype[0].names == ("a", "b", "_padding0")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a",
        "a:",
        ":uint8_t x;",
        "a:uint8_t;",
        "a:uint8_t x",
        "a:uint8_t[x] y;",
        "a:uint8_t[-1] y;",
    ],
)
def test_what_is_no_format(text):
    assert parse_format(text) is None or text == "a:uint8_t x"


@pytest.mark.parametrize(
    "formats",
    [
        ["a:a x;"],
        ["a:b x;", "b:a x;"],
        ["a:none x;"],
        ["a:uint8_t x;uint8_t x;"],
        ["a:uint8_t[65534] x;"],
        ["a:b[99999] x;", "b:uint8_t[60000] x;"],
        ["a:uint8_t[2] _padding0;"],
        ["a:b x;", "b:c x;", "c:d x;", "d:e x;", "e:uint8_t x;"],
    ],
)
def test_formats_that_cannot_be_are_none(formats):
    assert row_of(dict(map(parse_format, formats)), "a") is None


def test_a_large_row_is_a_row():
    (parsed,) = [parse_format(f"a:uint8_t[{LARGEST_ROW}] x;")]
    assert row_of(dict([parsed]), "a").dtype.itemsize == LARGEST_ROW


# Damage


@pytest.mark.parametrize("sync", [0, 7])
def test_a_hole_of_zeros_costs_its_messages_only(tmp_path, sync):
    content = bytearray(encode([IMU], Parts(sync_every=sync)))
    place = len(content) // 2
    content[place : place + 512] = bytes(512)
    log = log_of(tmp_path, bytes(content))
    assert N - 16 <= len(gyro_of(log)) < N
    assert set(gyro_of(log)[:, 0]) <= set(np.float32(GYRO[:, 0]).astype(float))
    assert any(doubt.startswith("1 damaged places:") for doubt in log.warnings)


def test_lost_bytes_cost_few_messages(tmp_path):
    content = encode([IMU])
    place = len(content) // 2
    log = log_of(tmp_path, content[:place] + content[place + 701 :])
    assert N - 20 <= len(gyro_of(log)) < N
    assert log.warnings


def test_a_wrong_length_costs_one_message(tmp_path):
    content = bytearray(encode([IMU], Parts(sync_every=0)))
    found = [i for i in range(len(content)) if content[i + 2 : i + 5] == b"D\0\0"]
    content[found[100] + 1] = 1  # 256 bytes longer
    log = log_of(tmp_path, bytes(content))
    assert len(gyro_of(log)) == N - 1
    content[found[100] : found[100] + 3] = b"\xff\xffD"  # beyond the end of the file
    assert len(gyro_of(log_of(tmp_path, bytes(content)))) == N - 1


DECLARING = encode(
    [armed(TIME[::10], True), IMU],
    Parts(parameters={f"P{i:02}": i for i in range(20)}, sync_every=0),
)


@pytest.mark.parametrize(
    ("damaged", "lost", "parameters"),
    [
        (b"int32_t P07", (), 19),
        (b"esc_report:", (), 20),
        (b"actuator_armed:", ("actuator_armed",), 20),
        (b"sensor_combined:", ("sensor_combined",), 20),
        (b"\0\0\0actuator_armed", ("actuator_armed",), 20),
    ],
)
def test_damage_among_the_declarations_costs_the_one_it_hit(tmp_path, damaged, lost, parameters):
    """Neither a mark nor data stand between the declarations."""
    content = bytearray(DECLARING)
    place = content.index(damaged)
    content[place - 3 : place + 8] = bytes(11)
    path = tmp_path / "log.ulg"
    path.write_bytes(bytes(content))
    found = scan_file(path, {"actuator_armed": None, "sensor_combined": None})
    kept = {name: len(topics[0].rows) for name, topics in found.topics.items()}
    expected = {"actuator_armed": N // 10, "sensor_combined": N}
    assert kept == {name: count for name, count in expected.items() if name not in lost}
    assert len(found.parameters) == parameters


def test_data_before_subscriptions_do_not_hide_declarations(tmp_path):
    """Stale data in a damaged stretch: their length reaches beyond the subscriptions."""
    place = DECLARING.index(b"int32_t P07") - 4
    stale = message("D", b"\x05\0", size=len(DECLARING) - place - 60 * N // 2)
    log = log_of(tmp_path, DECLARING[:place] + stale + DECLARING[place:])
    assert len(gyro_of(log)) == N


def test_a_log_that_was_cut_off_is_read_to_its_last_message(tmp_path):
    content = encode([IMU], Parts(sync_every=0))
    log = log_of(tmp_path, content[:-20])
    assert len(gyro_of(log)) == N - 1
    (doubt,) = log.warnings
    assert doubt.startswith("the log was cut off: ")


def test_a_log_that_was_cut_off_before_its_data_is_named_so(tmp_path):
    content = encode([IMU], Parts(sync_every=0))
    end = content.index(b"sensor_combined", content.index(b"sensor_combined") + 1)
    with pytest.raises(LogError, match=r"no data behind the declarations: the file was cut off"):
        log_of(tmp_path, content[:end])


def test_blocks_are_joined(tmp_path, monkeypatch):
    content = encode([IMU, armed(TIME[::10], True)])
    whole = log_of(tmp_path, content)
    for size in (100, 1000, 4097):
        monkeypatch.setattr(messages, "BLOCK_BYTES", size)
        log = log_of(tmp_path, content)
        np.testing.assert_array_equal(gyro_of(log), gyro_of(whole))
        assert log.warnings == ()


def test_messages_out_of_order_are_left_out(tmp_path, assert_wording):
    swapped = TIME.copy()
    rows = encode([sensor_combined(swapped, GYRO, GYRO)], Parts(sync_every=0))
    size = len(message("D", b"\0\0")) + 48
    first = len(rows) - N * size
    k = first + 100 * size
    moved = rows[:k] + rows[k + size : k + 6 * size] + rows[k : k + size] + rows[k + 6 * size :]
    log = log_of(tmp_path, moved)
    assert len(gyro_of(log)) == N - 1
    assert (np.diff(log.channels["gyro"].time) > 0).all()
    assert any("1 messages" in doubt for doubt in log.warnings)
    assert_wording(log.warnings)


@pytest.mark.parametrize("wrong", [1000.0, -40.0])
def test_a_wrong_time_costs_its_own_message(tmp_path, wrong, assert_wording):
    content = encode([IMU], Parts(sync_every=0))
    stamp, moved = (struct.pack("<Q", round(1e6 * (TIME[100] + by))) for by in (0.0, wrong))
    log = log_of(tmp_path, content.replace(stamp, moved))
    np.testing.assert_allclose(log.channels["gyro"].time, np.delete(TIME, 100), atol=1e-6)
    assert any("1 messages" in doubt for doubt in log.warnings)
    assert_wording(log.warnings)


def appended(content, more, *, bit=1):
    """Set the flags of a file, and append."""
    flags = bytes(8) + bytes([bit]) + bytes(7) + struct.pack("<3Q", len(content), 0, 0)
    return content[:19] + flags + content[59:] + more


def test_appended_data_begin_where_the_flags_say(tmp_path, assert_wording):
    first = encode([IMU], Parts(sync_every=0))
    data = first[first.index(b"D\0\0") - 2 :][: 10 * 53]
    late = bytearray(data)
    for k in range(10):
        stamp = struct.pack("<Q", round(1e6 * (TIME[-1] + 0.004 * (k + 1))))
        late[k * 53 + 5 : k * 53 + 13] = stamp
    log = log_of(tmp_path, appended(first[:-30], bytes(late)))
    assert len(gyro_of(log)) == N - 1 + 10
    assert any("1 stretches" in note for note in log.notes)
    assert_wording(log.notes)


def test_flags_that_are_not_known_are_refused(tmp_path):
    with pytest.raises(LogError, match="changes of the format that rotorfit does not know"):
        log_of(tmp_path, appended(encode([IMU]), b"", bit=2))


def test_a_place_of_appended_data_that_cannot_be_is_said(tmp_path, assert_wording):
    content = appended(encode([IMU]), b"")
    content = content[:35] + struct.pack("<Q", 1 << 60) + content[43:]
    log = log_of(tmp_path, content)
    assert len(gyro_of(log)) == N
    assert_wording(log.warnings[0])


# Whatever a file may hold


def faults_of(path):
    return faults_and_texts(path, ended(path))


def faults_and_texts(path, end):
    """List what is wrong with how reading ends, and texts of the log that no terminal shows."""
    texts = () if isinstance(end, str) else (*end.notes, *end.warnings, *end.metadata.values())
    return faults(path, end) + [text for text in texts if not text.isprintable()]


FEW = 50.0 + 0.02 * np.arange(12)
FILE = encode(
    [
        sensor_combined(FEW, np.ones((12, 3)), np.ones((12, 3))),
        esc_status(FEW, np.full((12, 4), 500.0)),
        actuator_motors(FEW, np.full((12, 4), 0.5)),
        actuator_outputs(FEW, np.full((12, 4), 1500.0)),
        armed(FEW[::4], True),
        mocap(FEW, np.zeros((12, 3)), np.tile([1.0, 0, 0, 0], (12, 1))),
        Logged(name="battery_status", time=FEW, fields={"voltage_v": 12.0}),
        Logged(name="vehicle_local_position", time=FEW, fields={"vx": 1.0, "v_xy_valid": True}),
        Logged(name="vehicle_attitude", time=FEW, fields={"q": np.tile([1, 0, 0, 0], (12, 1))}),
    ],
    Parts(
        parameters={"CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.3, "PWM_MAIN_FUNC1": 101},
        system_defaults={"CA_ROTOR0_PX": 0.0},
        changes=[(50.1, "THR_MDL_FAC", 0.5)],
        dropouts=[(50.1, 10)],
        info={"ver_sw_release": 1, "ver_hw": "board"},
        sync_every=10,
    ),
)
fuzzed = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60
)


@fuzzed
@given(
    flips=st.lists(st.tuples(st.integers(16, len(FILE) - 1), st.integers(0, 7)), max_size=12),
    cut=st.integers(0, len(FILE)),
    tail=st.binary(max_size=40),
)
@example(flips=[], cut=0, tail=b"")
@example(flips=[(FILE.index(b"char[5] ver_hw") - 4, 0)], cut=0, tail=b"")  # a text too long by one
def test_damaged_files_end_in_a_log_or_a_log_error(tmp_path, flips, cut, tail):
    content = bytearray(FILE)
    for place, bit in flips:
        content[place] ^= 1 << bit
    path = tmp_path / "log.ulg"
    path.write_bytes(bytes(content[: len(FILE) - cut // 8]) + tail)
    assert faults_of(path) == []


@fuzzed
@given(st.lists(st.tuples(st.sampled_from("ABDFILMOPQRSXZ"), st.binary(max_size=60)), max_size=12))
def test_any_messages_end_in_a_log_or_a_log_error(tmp_path, listed):
    content = HEAD + b"".join(message(kind, data) for kind, data in listed)
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    assert faults_of(path) == []


FIELDS = [
    *("float[3] gyro_rad;", "float gyro_rad;", "esc_report[8] esc;", "float[12] control;"),
    *("int32_t accelerometer_timestamp_relative;", "float[3] accelerometer_m_s2;", "bool armed;"),
    *("float[16] output;", "float[4] q;", "float vx;", "float voltage_v;", "uint8_t esc_count;"),
    *("uint64_t timestamp_sample;", "int16_t[8] x;", "int16_t[8] y;", "int16_t z;", "float dt;"),
    *("float scale;", "uint8_t samples;", "float[3] position;", "uint8_t pose_frame;"),
    *("float[3] xyz;", "bool[2] armed;", "float[3] delta_angle;", "uint32_t delta_angle_dt;"),
]
NAMES = [
    *("sensor_combined", "esc_status", "actuator_motors", "actuator_outputs", "actuator_armed"),
    *("vehicle_imu", "vehicle_attitude", "vehicle_local_position", "battery_status"),
    *("vehicle_angular_velocity", "vehicle_acceleration", "vehicle_mocap_odometry"),
    *("sensor_gyro_fifo", "sensor_accel_fifo", "vehicle_land_detected"),
]


@fuzzed
@given(
    names=st.lists(st.sampled_from(NAMES), min_size=1, max_size=6),
    fields=st.lists(st.sampled_from(FIELDS), min_size=1, max_size=8),
    rows=st.integers(1, 6),
    seed=st.integers(0, 1000),
)
def test_topics_with_other_fields_end_in_a_log_or_a_log_error(tmp_path, names, fields, rows, seed):
    """The fields that are looked for may be missing, or of another kind; their values are noise."""
    rng = random.Random(seed)
    report = "esc_report:uint64_t timestamp;int32_t esc_rpm;uint8_t actuator_function;"
    declared = [message("B", bytes(40)), message("F", report.encode())]
    formats = dict([parse_format(report)])
    data = []
    for number, name in enumerate(names):
        text = f"{name}:uint64_t timestamp;{''.join(dict.fromkeys(fields))}"
        formats[name] = parse_format(text)[1]
        declared.append(message("F", text.encode()))
        declared.append(message("A", struct.pack("<BH", 0, number) + name.encode()))
        row = row_of(formats, name)
        for k in range(rows if row else 0):
            noise = rng.randbytes(row.dtype.itemsize - 8)
            stamp = struct.pack("<Q", rng.choice([1000 * k, 1000 * k, rng.getrandbits(64)]))
            data.append(message("D", struct.pack("<H", number) + stamp + noise))
    path = tmp_path / "log.ulg"
    path.write_bytes(HEAD + b"".join(declared + data))
    assert faults_of(path) == []


# Bounded memory and time


def hostile_formats():
    nested = [b"a:uint8_t[60000] x;", b"b:a[300] y;", b"c:b[60000] y;", b"d:c[60000] y;"]
    declared = b"".join(message("F", text) for text in nested)
    return HEAD + declared + message("A", b"\0\0\0d") + message("D", bytes(60))


def hostile_lengths():
    return HEAD + message("D", b"", size=65535) * 50_000


def hostile_marks():
    return HEAD + (message("S", SYNC) + b"\xff") * 4_000


def hostile_search():
    """Known data messages, none of which is followed by a message."""
    declared = message("F", b"a:uint8_t x;") + message("A", b"\0\0\0a")
    return HEAD + declared + (message("D", b"\0\0x") + b"\xff") * 10_000


def hostile_declarations():
    """What looks like formats, parameters and subscriptions, and is none: a search at each byte."""
    unlike = [b"\0\x30A\0\0\0abc", b"\0\x30Fabc:", b"\0\x30P\7float x", b"\1\1\1F" + b"x" * 80]
    return HEAD + b"\xff" + b"".join(piece * 10_000 for piece in unlike)


def hostile_subscriptions():
    declared = message("F", b"a:" + b"".join(b"uint8_t f%d;" % i for i in range(999)))
    return (
        HEAD
        + declared
        + b"".join(message("A", struct.pack("<BH", 0, i) + b"a") for i in range(5_000))
    )


def hostile_texts():
    return HEAD + b"".join(
        message("I", bytes([14]) + b"char[60000] %02d" % (i % 100) + bytes(60_000))
        for i in range(100)
    )


@pytest.mark.parametrize(
    "made",
    [
        hostile_formats,
        hostile_lengths,
        hostile_marks,
        hostile_search,
        hostile_declarations,
        hostile_subscriptions,
        hostile_texts,
    ],
)
def test_files_made_to_use_memory_or_time(tmp_path, made):
    content = made()
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    loops, end = plain_loops(lambda: ended(path))
    assert faults_and_texts(path, end) == []
    assert loops < 1000 + 3e-3 * len(content)
    tracemalloc.start()
    ended(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 30e6 + 30 * len(content)


def test_damage_everywhere_is_refused(tmp_path):
    with pytest.raises(LogError, match=f"damaged in more than {MOST_PLACES} places"):
        log_of(tmp_path, hostile_search())


def test_topics_that_are_not_wanted_are_counted_and_not_kept(tmp_path):
    wide = Logged(
        name="wide",
        time=50.0 + 1e-4 * np.arange(5_000),
        fields={"x": 1.0},
        format="uint64_t timestamp;float[100] x;",
    )
    path = tmp_path / "log.ulg"
    path.write_bytes(encode([wide, IMU]) + b"")
    found = scan_file(path, {"sensor_combined": None})
    assert found.counts == {"wide": 5_000, "sensor_combined": N}
    assert list(found.topics) == ["sensor_combined"]
