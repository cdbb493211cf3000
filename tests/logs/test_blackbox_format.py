"""The decoder returns exactly what the test recorder wrote, and counts what was damaged."""

import contextlib
import random
import tracemalloc
from functools import partial
from pathlib import Path

import blackbox_encoder as encoder
import pytest
from blackbox_encoder import record_random
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults

from rotorfit.errors import LogError
from rotorfit.logs.blackbox import encodings, scan
from rotorfit.logs.blackbox.decode import decode
from rotorfit.logs.blackbox.listing import list_blackbox_logs
from rotorfit.logs.blackbox.read import read_blackbox

INT32 = st.integers(-(1 << 31), (1 << 31) - 1)


@settings(deadline=None)
@given(
    seed=st.integers(0, 1 << 32),
    iterations=st.integers(1, 150),
    version=st.sampled_from([1, 2]),
    p_interval=st.sampled_from(["1/2", "1/1", "3/4", "4", "32", "0"]),
)
def test_round_trip_of_every_field_of_every_frame(seed, iterations, version, p_interval):
    recorder = record_random(seed, iterations, version=version, p_interval=p_interval)
    recorder.end()
    log = decode(recorder.data)
    assert log.main.names == tuple(f[0] for f in recorder.main_fields)
    assert log.main.values.tolist() == recorder.main
    assert log.is_intra.tolist() == recorder.intra
    assert log.slow.values.tolist() == recorder.slow
    assert log.gps.values.tolist() == recorder.gps
    assert log.home.values.tolist() == recorder.home
    assert [(e.kind, e.values) for e in log.events] == recorder.events
    assert (log.damaged_stretches, log.dropped_frames, log.trailing_bytes) == (0, 0, 0)
    assert log.ended


def everything(log) -> list:
    """What a decoded log holds, as plain lists."""
    tables = (log.main, log.slow, log.gps, log.home)
    read = [[table.values.tolist(), table.positions.tolist()] for table in tables]
    damage = [log.damaged_stretches, log.skipped_bytes, log.dropped_frames, log.trailing_bytes]
    return [*read, log.is_intra.tolist(), log.events, damage, log.ended]


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 1 << 32), window=st.sampled_from([40, 400, 4000]))
def test_a_log_read_in_small_parts_is_the_same_log(seed, window):
    recorder = record_random(seed, 100, p_interval="1/1", quiet=True)
    recorder.end()
    rng = random.Random(seed)
    body = bytearray(recorder.body)
    for _ in range(rng.randrange(4)):
        body[rng.randrange(len(body))] ^= rng.randrange(256)
    data = recorder.header() + bytes(body)
    whole = everything(decode(data))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scan, "WINDOW", window)
        assert everything(decode(data)) == whole


def test_fields_that_are_not_asked_for_are_left_out():
    recorder = record_random(4, 96)
    whole = decode(recorder.data)
    part = decode(recorder.data, fields={"motor[2]", "gyroADC[1]", "absent"})
    assert part.main.names == ("loopIteration", "time", "gyroADC[1]", "motor[0]", "motor[2]")
    for name in part.main.names:
        assert part.main.column(name).tolist() == whole.main.column(name).tolist()
    others = [(len(log.slow), len(log.gps), len(log.home), log.events) for log in (part, whole)]
    assert others[0] == others[1]
    assert part.slow.names == ()


def one_group(encoding: int, values: list[int], version: int) -> list[int]:
    """Write one I frame whose fields all have this encoding, and read it back."""
    recorder = encoder.Recorder(version=version)
    head = encoder.MAIN_FIELDS[:2]
    recorder.main_fields = [*head, *[(f"x[{i}]", 1, 0, encoding, 0, 0) for i in range(len(values))]]
    recorder.record([0, 1, *values], is_intra=True)
    return decode(recorder.data).main.values[0, 2:].tolist()


@settings(deadline=None)
@given(st.lists(INT32, min_size=1, max_size=20))
def test_tag8_8svb_of_any_count(values):
    assert one_group(6, values, 2) == values


@settings(deadline=None)
@given(st.lists(INT32, min_size=3, max_size=3), st.sampled_from([7, 10]), st.integers(0, 31))
def test_tag2_groups(values, encoding, shift):
    values = [value >> shift for value in values]
    assert one_group(encoding, values, 2) == values


@settings(deadline=None)
@given(
    st.lists(st.integers(-(1 << 15), (1 << 15) - 1), min_size=4, max_size=4),
    st.lists(st.integers(0, 15), min_size=4, max_size=4),
    st.sampled_from([1, 2]),
)
def test_tag8_4s16_of_both_versions(values, shifts, version):
    values = [value >> shift for value, shift in zip(values, shifts, strict=True)]
    assert one_group(8, values, version) == values


@pytest.mark.parametrize("value", [0, 127, 128, 16383, 16384, (1 << 32) - 1])
def test_unsigned_variable_byte_at_its_limits(value):
    recorder = encoder.Recorder()
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], ("x", 0, 0, 1, 0, 1)]
    recorder.record([0, 1, value], is_intra=True)
    assert decode(recorder.data).main.column("x").tolist() == [value]


def test_bytes_of_the_specification():
    # 554 bits of TAG2_3SVARIABLE, and 4, 0, 8, 16 bits of TAG8_4S16, worked out by hand
    recorder = encoder.Recorder()
    names = ["a", "b", "c", "d", "e", "f", "g"]
    encodings = [10] * 3 + [8] * 4
    fields = zip(names, encodings, strict=True)
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], *[(n, 1, 0, e, 0, 0) for n, e in fields]]
    body = bytes([0x00, 0x01, 0b01_10000_0, 0b1111_1000, 0b11_10_00_01, 0x7F, 0xE8, 0x00, 0x10])
    log = decode(recorder.header() + b"I" + body)
    assert log.main.values[0, 2:].tolist() == [-16, 15, -8, 7, 0, -2, -32767]


def flip(data: bytes, position: int, mask: int = 0xFF) -> bytes:
    return data[:position] + bytes([data[position] ^ mask]) + data[position + 1 :]


def test_a_corrupt_frame_costs_frames_up_to_the_next_complete():
    recorder = record_random(3, 320, p_interval="1/1", quiet=True)
    recorder.end()
    broken = 100  # a P frame in the fourth of ten stretches of 32 frames
    assert not recorder.intra[broken]
    start = len(recorder.header()) + recorder.offsets[broken]
    # The format has no checksum; these six bytes are ones whose loss shows.
    log = decode(recorder.data[: start + 20] + recorder.data[start + 26 :])
    expected = recorder.main[:broken] + recorder.main[128:]
    assert log.main.values.tolist() == expected
    assert log.damaged_stretches == 1
    size = recorder.offsets[broken + 1] - recorder.offsets[broken]
    assert log.skipped_bytes == size - 6
    assert log.dropped_frames == 128 - broken - 1
    assert log.ended


@pytest.mark.parametrize(
    "frame",
    [b"I\xa0\x80\x80\x80\x80\x00\x02\x00", b"I\x20\x02\x80\x80\x80\x80\x80\x00"],
    ids=["first field", "last field"],
)
def test_a_number_of_six_bytes_is_refused(frame):
    recorder = encoder.Recorder()
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], ("x", 1, 0, 0, 0, 0)]
    log = decode(recorder.header() + b"I\x00\x01\x00" + frame + b"I\x40\x03\x00")
    assert log.main.values.tolist() == [[0, 1, 0], [64, 3, 0]]
    assert log.dropped_frames == 1


@pytest.mark.parametrize("jump", [20_000_000, -1])
def test_time_that_jumps_within_a_stretch_drops_its_rest(jump):
    recorder = encoder.Recorder(p_interval="1/1")
    times = [1000, 2000, 3000, 3000 + jump, 4000 + jump, 40_000, 41_000]
    zeros = [0] * (len(recorder.main_fields) - 2)
    for i, time in enumerate(times):
        recorder.record([i if i < 5 else i + 27, time, *zeros], is_intra=i in (0, 5))
    log = decode(recorder.data)
    assert log.main.values.tolist() == recorder.main[:3] + recorder.main[5:]
    assert log.dropped_frames == 2


def test_a_truncated_log_keeps_all_whole_frames():
    recorder = record_random(4, 100, quiet=True)
    data = recorder.data
    start = len(recorder.header()) + recorder.offsets[-1]
    log = decode(data[: start + 10])
    assert log.main.values.tolist() == recorder.main[:-1]
    assert not log.ended
    assert log.trailing_bytes == 10


def test_a_jump_of_time_drops_the_stretch_unless_resumed():
    def log_with_pause(event: bool):
        recorder = encoder.Recorder(p_interval="1/1")
        for i, time in enumerate((1000, 2000, 3000, 60_000_000, 4000, 5000)):
            if event and time > 5000:
                payload = encoder.unsigned_vb(96) + encoder.unsigned_vb(time)
                recorder.event(14, payload, (96, time))
            deltas = [32 * i, time, *[0] * (len(recorder.main_fields) - 2)]
            recorder.record(deltas, is_intra=True)
        return decode(recorder.data).main.column("time").tolist()

    assert log_with_pause(False) == [1000, 2000, 3000, 4000, 5000]
    assert log_with_pause(True)[:4] == [1000, 2000, 3000, 60_000_000]


def test_bytes_after_the_end_are_ignored_and_counted():
    recorder = record_random(5, 64, quiet=True)
    recorder.end()
    log = decode(recorder.data + b"\xff" * 77)
    assert log.main.values.tolist() == recorder.main
    assert (log.ended, log.trailing_bytes) == (True, 77)


def test_remains_of_an_older_log_before_the_header_are_ignored():
    recorder = record_random(6, 64, quiet=True)
    log = decode(b"\x00IPIP\xff\n" * 50 + recorder.data)
    assert log.main.values.tolist() == recorder.main


def test_two_logs_are_never_glued(tmp_path, assert_wording):
    first, second = record_random(7, 64, quiet=True), record_random(8, 96, quiet=True)
    first.end()
    path = tmp_path / "two.bfl"
    path.write_bytes(first.data + second.data)
    with pytest.raises(LogError) as error:
        read_blackbox(path)
    assert str(error.value).startswith(f"{path}: holds 2 logs (")
    assert "1: about " in str(error.value)
    assert_wording(str(error.value))
    with pytest.raises(LogError, match="expected a choice: pass the log number"):
        decode(path.read_bytes())
    for number, recorder in ((1, first), (2, second)):
        log = decode(path.read_bytes(), log_number=number)
        assert log.main.values.tolist() == recorder.main
        flight = read_blackbox(path, log_number=number)
        assert (flight.log_number, flight.logs_in_file) == (number, 2)
    entries = sorted(list_blackbox_logs(path), key=lambda entry: entry.number)
    cut = len(first.data)
    assert [(e.number, e.start, e.stop) for e in entries] == [
        (1, 0, cut),
        (2, cut, cut + len(second.data)),
    ]
    assert "Betaflight 4.5.0 (norevision)" in entries[0].description
    assert entries[0].description.endswith(f"Prüfstand, {cut / 1000:.0f} kB")
    assert_wording(entries[0].description)
    with pytest.raises(LogError, match="no log 3, expected a log number from 1 to 2"):
        read_blackbox(path, log_number=3)


def log_lasting(seconds: int, before: bytes = b"") -> bytes:
    """A log of one intra frame a second, with other bytes of a memory behind it."""
    recorder = encoder.Recorder(p_interval="1/1")
    for i in range(seconds + 1):
        deltas = [32 * i, 7_000_000 + 1_000_000 * i, *[0] * (len(recorder.main_fields) - 2)]
        recorder.record(deltas, is_intra=True)
    recorder.end()
    return recorder.data + before


def test_of_several_logs_the_longest_is_named_first(tmp_path):
    path = tmp_path / "three.bfl"
    path.write_bytes(log_lasting(3) + log_lasting(90, b"\xff" * 40_000) + log_lasting(41))
    entries = list_blackbox_logs(path)
    said = [(entry.number, entry.description.split(",")[0]) for entry in entries]
    assert said == [(2, "about 90 s"), (3, "about 41 s"), (1, "about 3 s")]
    with pytest.raises(LogError, match=r"holds 3 logs \(2: about 90 s, .*; 3: about 41 s, "):
        read_blackbox(path)
    path.write_bytes(log_lasting(3))
    assert "about" not in list_blackbox_logs(path)[0].description


def test_stubs_are_not_listed_among_flights(tmp_path):
    path = tmp_path / "stubs.bfl"
    stubs = log_lasting(0) + log_lasting(0)
    path.write_bytes(stubs + log_lasting(9) + log_lasting(0))
    assert [entry.number for entry in list_blackbox_logs(path)] == [3]
    assert read_blackbox(path).log_number == 3
    path.write_bytes(stubs + log_lasting(9) + log_lasting(12))
    assert [entry.number for entry in list_blackbox_logs(path)] == [4, 3]
    path.write_bytes(stubs)
    assert sorted(entry.number for entry in list_blackbox_logs(path)) == [1, 2]


def replaced(line: str, value: str | None) -> bytes:
    """A log whose header line says something else, or is missing."""
    recorder = record_random(9, 64, quiet=True)
    lines = recorder.header().decode().splitlines()
    kept = [text for text in lines if not text.startswith(f"H {line}:")]
    assert len(kept) < len(lines)
    if value is not None:
        kept.append(f"H {line}:{value}")
    return "".join(f"{text}\n" for text in kept).encode() + recorder.body


MANY = ",".join(["loopIteration,time", *(f"x{i}" for i in range(511))])


@pytest.mark.parametrize(
    ("line", "value", "message"),
    [
        ("Field I name", None, "does not declare the fields loopIteration and time"),
        ("Field I name", "a,b", "2 names, 42 signs, 42 predictors and 42 encodings"),
        ("Field I name", MANY, "limit 512 fields"),
        ("Field I encoding", "1,1,4" + ",0" * 39, "encoding 4, expected one of"),
        ("Field I encoding", "1,1" + ",9" * 40, "more than 2 unwritten fields"),
        ("Field I predictor", "0,0,1" + ",0" * 39, "predictor 1, expected one of"),
        ("Field P predictor", "6,2,12" + ",0" * 39, "predictor 12, expected one of"),
        ("Field P encoding", "1" + ",0" * 41, "counting field that is also written"),
        ("Field P encoding", "9,0,x", "expected comma-separated integers"),
        ("Field S predictor", "0,0,0,0", "5 names, 5 signs, 4 predictors"),
        ("I interval", "0", "I interval 0, expected 1 to 65536"),
        ("I interval", "99999999", "expected 1 to 65536"),
        ("Data version", "3", "data version is 3, expected 1 or 2"),
    ],
)
def test_a_header_that_cannot_be_used_is_refused(line, value, message):
    with pytest.raises(LogError, match=message) as error:
        decode(replaced(line, value))
    assert "\n" not in str(error.value)


def test_a_damaged_header_line_is_skipped_and_counted():
    recorder = record_random(10, 64, quiet=True)
    header = recorder.header()
    broken = header.replace(b"H acc_1G:2048\n", b"H acc_\x01G\xfe48\n")
    log = decode(broken + recorder.body)
    assert log.main.values.tolist() == recorder.main
    assert log.header.damaged_bytes == len(b"H acc_\x01G\xfe48\n")
    assert "acc_1G" not in log.header.entries


def test_no_log_at_all():
    with pytest.raises(LogError, match="no Blackbox log in these bytes"):
        decode(b"H Product:something else\n")


# --- hostile input -------------------------------------------------------------------------------

SMALL = record_random(11, 96, p_interval="1/1", quiet=True)
SMALL.end()


@pytest.fixture(scope="session")
def scratch(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("hostile") / "log.bfl"


def faults_of(scratch: Path, data: bytes, log_number: int | None = None) -> list[str]:
    """List what is wrong with how reading ends; warnings are errors here."""
    scratch.write_bytes(data)
    end = ended(scratch, partial(read_blackbox, log_number=log_number))
    return faults(scratch, end, ordered=False)


@settings(deadline=None)
@given(data=st.binary(max_size=400), with_header=st.booleans())
def test_random_bytes(scratch, data, with_header):
    assert faults_of(scratch, SMALL.header() + data if with_header else data) == []


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1 << 32))
def test_random_frame_letters(scratch, seed):
    rng = random.Random(seed)
    letters = b"IPSGHE\x00\x01\x80\xff"
    body = bytes(rng.choice(letters) for _ in range(3000))
    assert faults_of(scratch, SMALL.header() + body) == []


@given(
    edits=st.lists(
        st.tuples(
            st.sampled_from(["flip", "cut", "insert", "repeat"]),
            st.floats(0, 1),
            st.integers(1, 255),
        ),
        min_size=1,
        max_size=6,
    ),
    truncate=st.floats(0, 1),
    log_number=st.sampled_from([None, 1, 2]),
)
@settings(max_examples=70, deadline=None)
def test_mutated_logs(scratch, edits, truncate, log_number):
    data = SMALL.data
    for kind, where, amount in edits:
        at = int(where * (len(data) - 1))
        match kind:
            case "flip":
                data = flip(data, at, amount)
            case "cut":
                data = data[:at] + data[at + amount :]
            case "insert":
                data = data[:at] + random.Random(amount).randbytes(amount) + data[at:]
            case _:
                data = data[:at] + data[at : at + 10 * amount] * 2 + data[at + amount :]
    if truncate < 0.5:
        data = data[: int(2 * truncate * len(data))]
    assert faults_of(scratch, data or b"?", log_number) == []


@given(
    line=st.sampled_from(
        [
            *(
                f"Field {k} {p}"
                for k in "ISGH"
                for p in ("name", "signed", "predictor", "encoding")
            ),
            *("Field P predictor", "Field P encoding", "I interval", "P interval"),
            *("Data version", "gyro_scale", "acc_1G", "motorOutput", "motor_poles", "vbatref"),
        ]
    ),
    value=st.one_of(
        st.text(max_size=30),
        st.lists(st.integers(-3, 12), max_size=45).map(lambda v: ",".join(map(str, v))),
        st.lists(st.integers(-(10**10), 10**10), max_size=3).map(lambda v: ",".join(map(str, v))),
        st.sampled_from(["0x7f800000", "0x00000000", "0xffffffff", "2147483647,-2147483648"]),
    ),
)
@settings(max_examples=70, deadline=None)
def test_mutated_headers(scratch, line, value):
    data = SMALL.header() + f"H {line}:{value}\n".encode("utf-8", "surrogatepass") + SMALL.body
    assert faults_of(scratch, data) == []


@pytest.mark.parametrize("filler", [b"P", b"I", b"E", b"H", b"\x80", b"\xff", b"\x00", b"IP"])
def test_long_monotonous_bodies_take_bounded_time_and_memory(scratch, filler):
    assert faults_of(scratch, SMALL.data + filler * (60_000 // len(filler))) == []
    assert faults_of(scratch, SMALL.header() + filler * (60_000 // len(filler))) == []


def frames_without_change(encoding: int, fields: int, per_group: int) -> bytes:
    """100 kB of the shortest I frames of fields that share tag bytes."""
    recorder = encoder.Recorder(i_interval=1)
    bases = [("gyroADC", 3), ("accSmooth", 3), ("motor", 8), ("eRPM", 8), ("x", 512)]
    names = [f"{base}[{i}]" for base, count in bases for i in range(count)][:fields]
    head = encoder.MAIN_FIELDS[:2]
    recorder.main_fields = [*head, *[(n, 1, 0, encoding, 0, encoding) for n in names]]
    frame = b"I\x00\x00" + bytes(-(-fields // per_group))
    return recorder.header() + frame * (100_000 // len(frame))


@pytest.mark.parametrize(
    ("data", "ratio"),
    [
        pytest.param(frames_without_change(6, 504, 8), 25, id="504 fields, eight to a byte"),
        pytest.param(frames_without_change(6, 16, 8), 60, id="16 fields in five bytes"),
        pytest.param(frames_without_change(1, 0, 1), 40, id="frames of three bytes"),
        pytest.param(SMALL.header() + b"IPSG" * 40_000, 25, id="letters only"),
        pytest.param(SMALL.data + bytes(150_000), 25, id="erased memory"),
    ],
)
def test_memory_grows_with_the_file_and_no_more(scratch, monkeypatch, data, ratio):
    monkeypatch.setattr(scan, "WINDOW", 1 << 14)  # what is worked on at a time is the constant part
    monkeypatch.setattr(encodings, "BLOCK_FRAMES", 1 << 10)
    scratch.write_bytes(data)
    tracemalloc.start()
    with contextlib.suppress(LogError):
        read_blackbox(scratch)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < ratio * len(data) + 3_000_000, f"{peak / len(data):.1f} times the file"
