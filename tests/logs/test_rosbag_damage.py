"""ROS bags that are damaged or made to hurt: only LogError or a log, bounded memory, no hang."""

import bz2
import struct
import tracemalloc

import lz4.frame
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults
from rosbag_writers import EPOCH, Sent, write_messages_ros1, write_messages_ros2
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin

from rotorfit.logs import read_log
from rotorfit.logs.rosbag.contents import Decoder, Definitions, parsed
from rotorfit.logs.rosbag.stream import LARGEST_CHUNK, Topic

MCAP = b"\x89MCAP0\r\n"
IMU = "sensor_msgs/msg/Imu"


def peak_of(path):
    """Return how a file ends, and how much memory it took [bytes]."""
    ended(path)  # what is imported does not count
    tracemalloc.start()
    try:
        return ended(path), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def messages():
    for k in range(12):
        stamp = EPOCH + 10_000_000 * k
        fields = {"angular_velocity": {"x": 0.1 * k}, "linear_acceleration": {"z": 9.8}}
        yield Sent("/imu", IMU, stamp, stamp + 1_000_000, fields)
        esc = {"esc_status": [{"rpm": 6000 + k}] * 4}
        yield Sent("/esc", "mavros_msgs/msg/ESCStatus", stamp, stamp + 1_000_000, esc)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_messages_ros1(messages(), folder / "plain.bag")
    write_messages_ros1(messages(), folder / "lz4.bag", compression="lz4")
    write_messages_ros2(messages(), folder / "db3")
    write_messages_ros2(messages(), folder / "mcap", storage=StoragePlugin.MCAP)
    write_messages_ros2(
        messages(), folder / "zstd", storage=StoragePlugin.MCAP, compression="storage"
    )
    return {
        "plain": (folder / "plain.bag").read_bytes(),
        "lz4": (folder / "lz4.bag").read_bytes(),
        "db3": (folder / "db3" / "db3.db3").read_bytes(),
        "mcap": (folder / "mcap" / "mcap.mcap").read_bytes(),
        "zstd": (folder / "zstd" / "zstd.mcap").read_bytes(),
    }


NAMES = ("plain", "lz4", "db3", "mcap", "zstd")
fuzzed = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40
)
HARMS = [
    b"",
    b"\x00",
    b"\xff",
    b"\xff" * 8,
    b"\x00" * 4,
    b"\x7f\xff\xff\xff",
    b"=",
    b"\x05",
    b"\x06",
]


@fuzzed
@given(
    name=st.sampled_from(NAMES),
    damage=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 60), st.sampled_from(HARMS)), max_size=4
    ),
    end=st.floats(0.002, 1),
)
@example(name="plain", damage=[], end=1.0)
@example(name="db3", damage=[], end=0.5)
@example(name="zstd", damage=[], end=0.5)
def test_damaged_bags_end_in_a_log_or_a_log_error(tmp_path, samples, name, damage, end):
    content = samples[name]
    for place, length, inserted in damage:
        start = int(place * len(content))
        content = content[:start] + inserted + content[start + length :]
    path = tmp_path / "bag"
    path.write_bytes(content[: max(int(end * len(content)), 1)])
    assert faults(path, ended(path)) == []


@fuzzed
@given(
    name=st.sampled_from(NAMES),
    flips=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 7)), min_size=1, max_size=8),
)
def test_flipped_bits_end_in_a_log_or_a_log_error(tmp_path, samples, name, flips):
    content = bytearray(samples[name])
    for place, bit in flips:
        content[int(place * len(content))] ^= 1 << bit
    path = tmp_path / "bag"
    path.write_bytes(content)
    assert faults(path, ended(path)) == []


@pytest.mark.parametrize("name", NAMES)
def test_whole_samples_are_whole(tmp_path, samples, name):
    path = tmp_path / "bag"
    path.write_bytes(samples[name])
    log = read_log(path)
    assert faults(path, log) == []
    assert len(log.channels["rotor_speed"].time) == 12
    assert log.warnings == ()


def test_a_schema_that_is_no_text_is_damage(tmp_path, samples):
    """Found by fuzzing: the database's own error message cannot be decoded then."""
    path = tmp_path / "bag"
    path.write_bytes(samples["db3"].replace(b"CREATE INDEX", b"CREATE I\x80DEX"))
    said = ended(path)
    assert "damaged SQLite database (" in said
    assert faults(path, said) == []


def test_a_schema_of_several_lines_is_reported_in_one(tmp_path, samples):
    """Found by fuzzing: the database quotes its damaged statement, line breaks and all."""
    path = tmp_path / "bag"
    path.write_bytes(samples["db3"].replace(b"type_description_hash", b"ty`e_description_hash"))
    said = ended(path)
    assert "damaged SQLite database (" in said
    assert faults(path, said) == []


# Made to hurt


def chunk(compression: bytes, size: int, stored: bytes) -> bytes:
    """An MCAP chunk record."""
    content = struct.pack("<QQQI", 0, 0, size, 0)
    content += struct.pack("<I", len(compression)) + compression
    content += struct.pack("<Q", len(stored)) + stored
    return b"\x06" + struct.pack("<Q", len(content)) + content


def ros1_record(fields: dict, data: bytes) -> bytes:
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value
        for name, value in fields.items()
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


BOMB = bytes(1 << 25)


@pytest.mark.parametrize("declared", [1 << 20, 1 << 25, 1 << 40])
def test_an_lz4_bomb_unfolds_to_its_bound_at_most(tmp_path, declared, assert_wording):
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MCAP + chunk(b"lz4", declared, lz4.frame.compress(BOMB)))
    message, peak = peak_of(path)
    assert_wording(message)
    assert peak < (1 << 25) * 2.5


def test_a_bomb_of_many_chunks_is_given_up(tmp_path, assert_wording):
    """Each chunk alone would pass; together they unfold to a thousand times the file."""
    part = chunk(b"lz4", 1 << 25, lz4.frame.compress(BOMB))
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MCAP + part * 6)
    message, peak = peak_of(path)
    assert "than 40 times" in message
    assert_wording(message)
    assert peak < (1 << 25) * 2.5


def test_a_bzip2_bomb_in_a_ros1_bag(tmp_path, assert_wording):
    stored = bz2.compress(bytes(1 << 24))
    fields = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", 1 << 16)}
    path = tmp_path / "bomb.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + ros1_record(fields, stored))
    message, peak = peak_of(path)
    assert "damaged (1 times)" in message
    assert_wording(message)
    assert peak < 1 << 23


@pytest.mark.parametrize(
    "content",
    [
        MCAP + b"\x06" + b"\xff" * 8,
        MCAP + b"\x05" + struct.pack("<Q", 1 << 62),
        MCAP + chunk(b"", 10, b"\x05" + b"\xff" * 8),
        MCAP + chunk(b"lz4", LARGEST_CHUNK + 1, b""),
        MCAP + chunk(b"rar", 10, b"ab"),
        b"#ROSBAG V2.0\n" + b"\xff" * 8,
        b"#ROSBAG V2.0\n" + struct.pack("<I", 4) + b"\xff" * 8,
        b"SQLite format 3\x00" + b"\xff" * 200,
    ],
)
def test_huge_declared_lengths_take_no_memory(tmp_path, content):
    path = tmp_path / "bag"
    path.write_bytes(content)
    message, peak = peak_of(path)
    assert isinstance(message, str)
    assert peak < 1 << 23


def mcap_of(definition: str | bytes, data: bytes, count: int = 20, *, coding: str = "cdr"):
    """An MCAP file with one topic and the same message over and over."""
    kind, language = {
        "cdr": ("sensor_msgs/msg/Imu", b"ros2msg"),
        "ros1": ("sensor_msgs/Imu", b"ros1msg"),
    }[coding]
    described = definition if isinstance(definition, bytes) else definition.encode()

    def text(words: bytes) -> bytes:
        return struct.pack("<I", len(words)) + words

    def record(opcode: int, content: bytes) -> bytes:
        return bytes([opcode]) + struct.pack("<Q", len(content)) + content

    schema = struct.pack("<H", 1) + text(kind.encode()) + text(language) + text(described)
    channel = struct.pack("<HH", 0, 1) + text(b"/imu") + text(coding.encode()) + text(b"")
    body = b"".join(
        record(5, struct.pack("<HIQQ", 0, k, EPOCH + k, EPOCH + k) + data) for k in range(count)
    )
    return MCAP + record(3, schema) + record(4, channel) + body


DEEP = "A0 a\n" + "".join(f"MSG: sensor_msgs/A{k}\nA{k + 1} a\n" for k in range(500))
HOLLOW = "A0 a\n" + "".join(
    f"MSG: sensor_msgs/A{k}\n" + "".join(f"A{k + 1} a{n}\n" for n in range(100)) for k in range(11)
)
HOLLOW += "MSG: sensor_msgs/A11\n"  # a hundred to the eleventh times nothing
WIDE = "A[60000] a\nMSG: sensor_msgs/A\nB[60000] b\nMSG: sensor_msgs/B\n"


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        ("Imu angular_velocity", "goes too deep"),
        ("Other other", "is not defined in the file"),
        (DEEP, "goes too deep"),
        (WIDE, "more than 1024 fields"),
        (HOLLOW, "more than 1024 fields"),
        ("float64[999999999] data", "has an array of 999999999: damaged"),
        ("float64[60000] data", "a message does not fit its definition (ValueError: buffer is"),
        ("float64[-1] data", "has an array of -1: damaged"),
        ("string[60000] data", "more than 1024 fields"),
        ("A[] a\nMSG: sensor_msgs/A\nB[0] b\nMSG: sensor_msgs/B\nint8 c", "an array of nothing"),
        ("float64 = 3", "the definition of sensor_msgs/Imu is no definition of a message: damaged"),
        ("float64 class\nfloat64 class_", "has conflicting Python names"),
        ("# " + "a" * (1 << 21), "characters: damaged"),
        ("float64 a\n" * 3000, "has 3000 lines: damaged"),
    ],
)
def test_definitions_that_never_end_are_refused(tmp_path, definition, message):
    path = tmp_path / "bag.mcap"
    path.write_bytes(mcap_of(definition, b"\x00\x01\x00\x00" + bytes(40), count=300))
    said, peak = peak_of(path)
    assert message in said
    assert peak < 1 << 25


VECTORS = "Vector3 {}\n===========\nMSG: sensor_msgs/Vector3\nfloat64 x\r\nfloat64 y\nfloat64 z"


@pytest.mark.parametrize("coding", ["cdr", "ros1"])
def test_messages_of_both_ros_in_mcap(tmp_path, coding):
    """Also with a constant and a comment that rosbags would stop at."""
    head = b"" if coding == "ros1" else b"\x00\x01\x00\x00"
    path = tmp_path / "bag.mcap"
    fields = VECTORS.format("angular_velocity").encode()
    definition = b"uint8 maximum = 3  # \xb0/s\n" + fields
    path.write_bytes(mcap_of(definition, head + struct.pack("<3d", 1, 2, 3), coding=coding))
    np.testing.assert_array_equal(read_log(path).channels["gyro"].values, 20 * [[1, 2, 3]])


def test_messages_each_of_its_own_length_are_read(tmp_path):
    path = tmp_path / "bag.mcap"
    bodies = [b"\x00\x01\x00\x00" + struct.pack("<I", k) + bytes(k) for k in range(1, 1600)]
    path.write_bytes(
        mcap_of("uint8[] data", b"", count=0)
        + b"".join(
            b"\x05" + struct.pack("<QHIQQ", 22 + len(body), 0, 0, EPOCH, EPOCH) + body
            for body in bodies
        )
    )
    assert "topics: /imu (1599 messages)" in ended(path)


# The decoder against plain reading


@given(
    frame=st.text(max_size=9),
    names=st.lists(st.text(max_size=5), max_size=4),
    numbers=st.lists(st.floats(width=32, allow_nan=False), max_size=5),
    last=st.floats(allow_nan=False),
    big=st.booleans(),
)
def test_numbers_after_strings_and_sequences_are_found(frame, names, numbers, last, big):
    """CDR written here by hand: alignment after strings of any length, both byte orders."""
    order = ">" if big else "<"
    out = bytearray()

    def put(code, value, size):
        out.extend(b"\x00" * (-len(out) % size))
        out.extend(struct.pack(order + code, value))

    def put_text(words):
        coded = words.encode() + b"\x00"
        put("I", len(coded), 4)
        out.extend(coded)

    put_text(frame)
    put("I", len(names), 4)
    for name in names:
        put_text(name)
    put("I", len(numbers), 4)
    for number in numbers:
        put("f", number, 4)
    put("B", 7, 1)
    put("d", last, 8)
    data = (b"\x00\x00" if big else b"\x00\x01") + b"\x00\x00" + bytes(out)
    text = "string frame\nstring[] names\nfloat32[] numbers\nuint8 flag\nfloat64 last"
    topic = Topic(name="/t", kind="a/B", encoding="cdr", definition=text)
    wanted = {name: (name,) for name in ("last", "flag", "numbers", "frame")}
    decoder = Decoder(topic, wanted, (), Definitions())
    decoder.add(7, data)
    found = decoder.finish()
    assert found.unreadable == (0, "")
    assert found.received.tolist() == [7]
    assert found.values["last"].tolist() == [[last]]
    assert found.values["flag"].tolist() == [[7]]
    assert found.values["numbers"].tolist() == [numbers]
    assert found.values["frame"].shape == (1, 0)


def test_constants_comments_and_bounds_of_a_definition():
    text = (
        "# a comment\nuint8 LIMIT=3 # three\nstring NAME = a # b\nfloat32[<=4] a  # bounded\n"
        "string<=10 s\nint32 x 5\nb/msg/C[2] c\n"
        "================================================================================\n"
        "MSG: b/C\ntime t\nduration d\n"
    )
    fields = {
        kind: [(name, desc[1]) for name, desc in entry[1]]
        for kind, entry in parsed("a/msg/B", text).items()
    }
    time, duration = (f"builtin_interfaces/msg/{name}" for name in ("Time", "Duration"))
    assert fields == {
        "a/msg/B": [
            ("a", ((Nodetype.BASE, ("float32", 0)), 4)),
            ("s", ("string", 10)),
            ("x", ("int32", 0)),
            ("c", ((Nodetype.NAME, "b/msg/C"), 2)),
        ],
        "b/msg/C": [("t", time), ("d", duration)],
    }
