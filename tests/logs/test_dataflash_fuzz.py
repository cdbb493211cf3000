"""Damaged and made-up DataFlash logs: a LogError or a FlightLog, soon, within little memory."""

import tracemalloc

import numpy as np
import pytest
from dataflash_encoder import (
    ACC,
    ARM,
    BAT,
    ESC,
    FMT_OF_FMT,
    FMTU,
    GYR,
    HEAD,
    IMU,
    KINDS,
    MSG,
    PARM,
    QUAD_X,
    RATE,
    RCOU,
    UNIT,
    Kind,
    definition,
    esc,
    imu,
    log,
    message,
    parameters,
    rcou,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults

from plain_loops import plain_loops
from rotorfit.logs.dataflash.messages import LETTERS
from rotorfit.logs.dataflash.read import read_dataflash

MEMORY = 60e6
"""A block of 4 MB, its heads, and what they become [bytes]."""
LOOPS = 1000
LOOPS_A_BYTE = 3e-3
"""Of `plain_loops`."""


def whole_log():
    xkf1 = Kind(190, "XKF1", "QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD")
    att = Kind(191, "ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw")
    parts = [message(MSG, 0, b"Frame: QUAD/X"), *parameters(QUAD_X), message(ARM, 0, 1, 0, 0, 0)]
    parts += [message(UNIT, 0, ord("E"), b"rad/s"), message(FMTU, 0, 150, b"s#EEEooo", b"")]
    for k in range(30):
        t = 0.01 * k
        us = round(1e6 * t)
        parts += [imu(t, (0.1, 0.2, 0.3), (0.0, 0.0, -9.8), instance=i) for i in range(2)]
        parts += [rcou(t, [1400, 1500, 1600, 1700]), *[esc(t, n, 5000.0 + n) for n in range(4)]]
        parts += [message(BAT, us, 0, 15.0, 15.0), message(GYR, us, 0, us, 0, 0, 0)]
        parts += [message(ACC, us, 0, us, 0, 0, -9.8), message(RATE, us, *[0.1] * 12)]
        parts += [message(xkf1, us, 0, 10, 10, 100, 1, 2, 3), message(att, us, 10, 10, 100)]
    return log((*KINDS, xkf1, att), parts)


WHOLE = whole_log()


def faults_of(path, data):
    """List what is wrong with how reading ends, and too much time or memory for it."""
    path.write_bytes(data)
    loops, (end, peak) = plain_loops(lambda: end_and_peak(path))
    found = faults(path, end)
    if loops >= LOOPS + LOOPS_A_BYTE * len(data):
        found.append(f"{loops} loops")
    if peak >= MEMORY + 10 * len(data):
        found.append(f"{peak} bytes of memory")
    if len(end) >= 1000 if isinstance(end, str) else not 0 <= end.seconds < np.inf:
        found.append(str(end))
    return found


def end_and_peak(path):
    """Return how reading ends, and the most memory that it took [bytes]."""
    tracemalloc.start()
    try:
        return ended(path, read_dataflash), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "made.bin"


@settings(max_examples=8, deadline=None)
@given(st.integers(2, len(WHOLE)))
def test_truncations(path, size):
    assert faults_of(path, WHOLE[:size]) == []


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.integers(2, len(WHOLE) - 1), st.integers(0, 7)), max_size=60))
def test_bit_flips(path, flips):
    data = bytearray(WHOLE)
    for place, bit in flips:
        data[place] ^= 1 << bit
    assert faults_of(path, bytes(data)) == []


@settings(max_examples=10, deadline=None)
@given(st.data())
def test_definitions_that_lie(path, data):
    """Any length, letters and labels for messages of names that are read."""
    letters = st.text("".join(LETTERS) + "x?\xff", max_size=16)
    labels = ",".join(data.draw(st.permutations(IMU.labels.split(",")))[:9])
    kinds = [data.draw(st.sampled_from(KINDS)) for _ in range(data.draw(st.integers(1, 4)))]
    lies = [
        definition(
            Kind(
                data.draw(st.sampled_from([kind.number, data.draw(st.integers(0, 255))])),
                data.draw(st.sampled_from([kind.name, "IMU", "FMT", "", "\x00\xff"])),
                kind.letters,
                data.draw(st.sampled_from([kind.labels, labels, ",,,", ""])),
            ),
            length=data.draw(st.one_of(st.just(kind.length), st.integers(0, 255))),
        )
        for kind in kinds
    ]
    # The letters within: each definition's 16 bytes of them begin 9 bytes after its head.
    for i, lie in enumerate(lies):
        if data.draw(st.booleans()):
            drawn = data.draw(letters).encode("latin-1")[:16].ljust(16, b"\0")
            lies[i] = lie[:9] + drawn + lie[25:]
    place = data.draw(st.sampled_from([0, 89, 89 * (1 + len(KINDS)), 4000]))
    assert faults_of(path, WHOLE[:place] + b"".join(lies) + WHOLE[place:]) == []


@settings(max_examples=10, deadline=None)
@given(
    st.lists(st.sampled_from([IMU, RCOU, ESC, BAT, RATE, ARM, PARM, GYR, ACC]), max_size=40),
    st.data(),
)
def test_messages_of_any_content(path, kinds, data):
    """Messages whose fields are any bytes: NaN, infinities, times of any size, instances."""
    size = max(kind.length for kind in KINDS)
    source = data.draw(st.binary(min_size=size, max_size=3 * size))
    parts = []
    for i, kind in enumerate(kinds):
        body = (source[i % len(source) :] + source)[: kind.length - 3]
        parts.append(HEAD + bytes([kind.number]) + body)
    assert faults_of(path, log(KINDS, [*parameters(QUAD_X), *parts])) == []


@settings(max_examples=10, deadline=None)
@given(st.binary(max_size=3000))
def test_any_bytes(path, data):
    assert faults_of(path, FMT_OF_FMT + data) == []


@settings(max_examples=8, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(
            [
                *QUAD_X,
                "SERVO9_FUNCTION",
                "RC3_MIN",
                "RC3_MAX",
                "INS_USE",
                "INS_POS1_X",
                "EK3_IMU_MASK",
                "SERVO_BLH_POLES",
                "INS_RAW_LOG_OPT",
                "RCMAP_THROTTLE",
                "INS_GYRO_FILTER",
                "INS_ACCEL_FILTER",
            ]
        ),
        st.floats(width=32),
    )
)
def test_parameters_of_any_value(path, values):
    start = log(KINDS, [])
    assert faults_of(path, start + b"".join(parameters(values)) + WHOLE[89:]) == []


@pytest.mark.parametrize(
    "data",
    [
        FMT_OF_FMT * 1000,
        (definition(IMU) + definition(Kind(150, "IMU", "Q", "TimeUS"))) * 1000,
        FMT_OF_FMT + HEAD * 500_000,
        FMT_OF_FMT + definition(Kind(1, "A", "", ""), length=3) + (HEAD + b"\x01") * 300_000,
        FMT_OF_FMT + definition(Kind(1, "A", "b", "x")) + (HEAD + b"\x01\x07\x00") * 150_000,
        FMT_OF_FMT
        + definition(Kind(1, "A", "Z" * 3, "x,y,z"))
        + (HEAD + b"\x01" + HEAD * 96) * 5_000,
        FMT_OF_FMT
        + definition(Kind(1, "A", "hh", "x,y"))
        + definition(Kind(2, "B", "Z", "x"))
        + (HEAD + b"\x02abcd" + 2 * (HEAD + b"\x01abcd")) * 2000,
        FMT_OF_FMT + b"\0" * 2_000_000,
        WHOLE + b"\xa3" * 1_000_000,
    ],
    ids=[
        "fmt",
        "fmt in turns",
        "heads",
        "empty",
        "damage",
        "heads within",
        "overlaps",
        "zeros",
        "half heads",
    ],
)
def test_files_made_to_use_time_or_memory(path, data):
    assert faults_of(path, data) == []


@pytest.mark.slow
def test_much_damage(path):
    """Flips, cuts, insertions and copies of pieces, some hundred times."""
    rng = np.random.default_rng(11)
    for _ in range(600):
        data = bytearray(WHOLE)
        for _ in range(rng.integers(1, 30)):
            place, size = int(rng.integers(2, len(data))), int(rng.integers(1, 200))
            match rng.integers(4):
                case 0:
                    data[place] ^= 1 << int(rng.integers(8))
                case 1:
                    del data[place : place + size]
                case 2:
                    data[place:place] = rng.bytes(size)
                case _:
                    start = int(rng.integers(2, len(data)))
                    data[place:place] = data[start : start + size]
        assert faults_of(path, bytes(data)) == []
