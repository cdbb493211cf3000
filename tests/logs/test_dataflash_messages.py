"""Messages of DataFlash logs: found, counted and unpacked as pymavlink does, and across damage."""

import struct
import tracemalloc
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest
from dataflash_encoder import (
    BAT,
    FMT,
    FMT_OF_FMT,
    HEAD,
    IMU,
    KINDS,
    MSG,
    STRUCT,
    Kind,
    definition,
    imu,
    log,
    message,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.DFReader import DFReader_binary

from plain_loops import plain_loops
from rotorfit.errors import LogError
from rotorfit.logs.dataflash.columns import columns, possible_in_order
from rotorfit.logs.dataflash.messages import Wanted, find_messages

ALL = Kind(200, "ALL", "QbBhHiIfdgcCeEL", "TimeUS,b,B,h,H,i,I,f,d,g,c,C,e,E,L")
TEXTS = Kind(201, "TXT", "qnNZMa", "q,n,N,Z,M,a")
numbers = st.tuples(
    st.integers(0, 2**64 - 1),
    st.integers(-128, 127),
    st.integers(0, 255),
    st.integers(-(2**15), 2**15 - 1),
    st.integers(0, 2**16 - 1),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**32 - 1),
    st.floats(width=32, allow_nan=False),
    st.floats(allow_nan=False),
    st.floats(width=16, allow_nan=False),
    st.integers(-(2**15), 2**15 - 1),
    st.integers(0, 2**16 - 1),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**32 - 1),
    st.integers(-(2**31), 2**31 - 1),
)


@contextmanager
def pymavlink_reader(path):
    reader = DFReader_binary(str(path))
    yield reader
    reader.data_map.close()
    reader.filehandle.close()


def pymavlink_rows(path, name):
    rows = []
    with pymavlink_reader(path) as reader:
        while (found := reader.recv_match(type=name)) is not None:
            rows.append([getattr(found, label) for label in found._fieldnames])
    return rows


def whole(data, **options):
    return find_messages([data], **options)


def steps(count, *, first=0):
    return [imu(0.01 * (first + i), (0.1, 0.2, 0.3), (0.0, 0.0, -9.8)) for i in range(count)]


@settings(max_examples=15, deadline=None)
@given(st.lists(numbers, min_size=1, max_size=20))
def test_every_number_is_pymavlinks(tmp_path_factory, rows):
    data = log([ALL], [message(ALL, *row) for row in rows])
    path = tmp_path_factory.mktemp("log") / "numbers.bin"
    path.write_bytes(data)
    ours = columns(whole(data), "ALL", ALL.labels.split(","))
    theirs = pymavlink_rows(path, "ALL")
    assert len(theirs) == len(rows)
    for i, label in enumerate(ALL.labels.split(",")):
        assert ours[label].tolist() == [row[i] for row in theirs], label


def test_texts_and_arrays(tmp_path):
    array = list(range(-16, 16))
    row = (-5, b"ab", b"MOT_PWM_MIN", b"hello", 7, struct.pack("<32h", *array))
    data = log([TEXTS], [message(TEXTS, *row)])
    (tmp_path / "texts.bin").write_bytes(data)
    ours = columns(whole(data), "TXT", ("q", "n", "N", "Z", "M", "a"))
    assert [ours[x].tolist()[0] for x in ("q", "n", "N", "Z", "M")] == [*row[:5]]
    assert ours["a"].tolist() == [array]
    theirs = pymavlink_rows(tmp_path / "texts.bin", "TXT")[0]
    assert theirs[:4] == [-5, "ab", "MOT_PWM_MIN", "hello"]
    assert list(theirs[5]) == array


def test_scales_by_hand():
    kind = Kind(60, "SC", "cCeEL", "c,C,e,E,L")
    found = columns(whole(log([kind], [message(kind, -150, 150, -7, 7, 473977418)])), "SC", "cCeEL")
    assert {k: v.tolist() for k, v in found.items()} == {
        "c": [-1.5],
        "C": [1.5],
        "e": [-0.07],
        "E": [0.07],
        "L": [47.3977418],
    }


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_counts_are_pymavlinks_and_those_of_a_plain_walk(tmp_path_factory, data):
    kinds = [
        Kind(number, f"T{number}", letters, ",".join(f"x{i}" for i in range(len(letters))))
        for number, letters in data.draw(
            st.dictionaries(
                st.integers(1, 127), st.text("bhQfNZ", min_size=1, max_size=6), max_size=5
            )
        ).items()
    ]
    kinds = [kind for kind in kinds if kind.length < 256]  # a byte says how long a message is
    bodies = st.binary(min_size=250, max_size=250)
    # Bytes of messages are anything, heads of messages among them.
    tricky = st.sampled_from([HEAD, HEAD + b"\x80", HEAD + b"\x07"])
    parts = []
    for _ in range(data.draw(st.integers(0, 30)) if kinds else 0):
        kind = data.draw(st.sampled_from(kinds))
        body = (data.draw(tricky) + data.draw(bodies))[: kind.length - 3]
        parts.append(HEAD + bytes([kind.number]) + body)
    content = log(kinds, parts)
    path = tmp_path_factory.mktemp("log") / "made.bin"
    path.write_bytes(content)
    ours = whole(content)
    with pymavlink_reader(path) as reader:
        theirs = {number: n for number, n in enumerate(reader.counts) if n}
    assert {ours.formats[i].type: n for i, n in enumerate(ours.counts) if n} == theirs
    assert dict(plain_walk(content)) == {
        ours.formats[i].type: n for i, n in enumerate(ours.counts) if n
    }
    assert ours.damaged_places == ours.trailing_bytes == 0


def plain_walk(data):
    lengths, counts, place = {FMT: 89}, {}, 0
    while place < len(data):
        assert data[place : place + 2] == HEAD
        number = data[place + 2]
        counts[number] = counts.get(number, 0) + 1
        if number == FMT:
            lengths[data[place + 3]] = data[place + 4]
        place += lengths[number]
    return counts


@settings(max_examples=25, deadline=None)
@given(
    st.binary(max_size=200),
    st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 255)), max_size=12),
    st.lists(st.integers(1, 4500), max_size=8),
)
def test_the_pieces_a_file_comes_in_do_not_matter(garbage, flips, cuts):
    data = bytearray(log(KINDS[:3], steps(20)) + garbage + b"".join(steps(20, first=20)))
    for place, value in flips:
        data[place % len(data)] = value
    edges = [0, *sorted({c for c in cuts if c < len(data)}), len(data)]
    pieces = [bytes(data[a:b]) for a, b in pairwise(edges)]
    at_once, in_pieces = whole(bytes(data)), find_messages(pieces)
    assert at_once.counts == in_pieces.counts
    for name in (
        *("damaged_places", "skipped_bytes", "dropped", "trailing_bytes", "bad_formats", "formats"),
    ):
        assert getattr(at_once, name) == getattr(in_pieces, name), name
    for index, rows in at_once.rows.items():
        np.testing.assert_array_equal(rows, in_pieces.rows[index])


def test_garbage_between_messages_loses_none():
    data = log([IMU], steps(5)) + b"\0" * 3000 + b"\xa3" + b"".join(steps(5, first=5))
    found = whole(data)
    assert found.count("IMU") == 10
    assert (found.damaged_places, found.skipped_bytes, found.dropped) == (1, 3001, 0)


def test_a_message_that_lost_bytes_is_left_out_alone():
    broken = steps(1)[0][:-7]
    found = whole(log([IMU], [*steps(3), broken, *steps(3, first=3)]))
    assert found.count("IMU") == 6
    assert (found.damaged_places, found.dropped) == (1, 1)
    assert found.skipped_bytes == len(broken)


def test_a_type_without_definition_is_passed_over():
    stranger = HEAD + bytes([77]) + b"\x01" * 20
    found = whole(log([IMU], [*steps(2), stranger, *steps(2, first=2)]))
    assert found.count("IMU") == 4
    assert found.skipped_bytes == 23


def test_an_unfinished_message_at_the_end_is_trailing():
    found = whole(log([IMU], steps(4))[:-1])
    assert found.count("IMU") == 3
    assert found.trailing_bytes == IMU.length - 1


def test_padding_of_a_flash_page_at_the_end_is_no_damage():
    found = whole(log([IMU], steps(4)) + b"\xff" * 240)
    assert (found.count("IMU"), found.trailing_bytes, found.damaged_places) == (4, 240, 0)


def test_a_redefinition_holds_from_where_it_stands():
    short = Kind(IMU.number, "BAT", "Qf", "TimeUS,Volt")
    data = log([IMU], [*steps(3), definition(short), message(short, 5, 12.5), definition(IMU)])
    found = whole(data + b"".join(steps(2, first=3)))
    assert found.count("IMU") == 5
    assert columns(found, "BAT", ("Volt",))["Volt"].tolist() == [12.5]
    assert found.damaged_places == 0


def test_two_types_of_one_name_are_one():
    other = Kind(99, "BAT", "QBff", "TimeUS,Inst,Volt,VoltR")
    data = log([BAT, other], [message(BAT, 1, 0, 12.0, 0), message(other, 2, 0, 11.0, 0)])
    assert columns(whole(data), "BAT", ("Volt",))["Volt"].tolist() == [12.0, 11.0]


@pytest.mark.parametrize("labels", ["TimeUS", "TimeUS,I,GyrX,GyrY", IMU.labels + ",More,Evenmore"])
def test_labels_that_are_fewer_or_more_than_letters(labels):
    kind = Kind(IMU.number, "IMU", IMU.letters, labels)
    data = FMT_OF_FMT + definition(kind) + b"".join(steps(3))
    found = whole(data)
    assert columns(found, "IMU", ("TimeUS",))["TimeUS"].tolist() == [0, 10000, 20000]
    assert set(found.formats[1].fields) <= set(IMU.labels.split(","))


def test_a_label_given_twice_is_the_last_as_in_pymavlink(tmp_path):
    kind = Kind(60, "DUP", "hh", "x,x")
    data = log([kind], [message(kind, 1, 2)])
    (tmp_path / "twice.bin").write_bytes(data)
    assert columns(whole(data), "DUP", ("x",))["x"].tolist() == [2]
    assert pymavlink_rows(tmp_path / "twice.bin", "DUP") == [[2, 2]]


@pytest.mark.parametrize("length", [0, 1, 2])
def test_a_length_that_has_no_room_for_the_head_is_no_definition(length):
    data = FMT_OF_FMT + definition(MSG) + definition(IMU, length=length) + b"".join(steps(3))
    found = whole(data)
    assert found.bad_formats == 1
    assert found.count("IMU") == 0


@pytest.mark.parametrize("length", [3, IMU.length - 1, IMU.length + 1, 255])
def test_a_length_against_the_letters_leaves_fields_unread(length):
    data = FMT_OF_FMT + definition(IMU, length=length) + b"".join(steps(20))
    found = whole(data)
    assert found.formats[1].fields == {}
    assert columns(found, "IMU", ("GyrX",)) == {}


def test_fmt_itself_cannot_be_redefined():
    lie = Kind(FMT, "FMT", "BB", "Type,Length")
    data = log([IMU], [definition(lie), *steps(3), definition(BAT), message(BAT, 1, 0, 9.0, 0)])
    found = whole(data)
    assert (found.count("IMU"), found.count("BAT"), found.bad_formats) == (3, 1, 1)


def test_a_file_of_definitions_alone_is_refused_soon():
    rng = np.random.default_rng(1)
    kinds = [
        Kind(int(rng.integers(0, 128)), f"A{i % 99}", "b" * (1 + i % 16), f"l{i}")
        for i in range(3000)
    ]
    data = log(kinds, [])

    def refused() -> None:
        with pytest.raises(LogError, match=r"defines its messages .* times, expected once each"):
            whole(data)

    loops, _ = plain_loops(refused)
    assert loops < 1500


def test_two_definitions_in_turns_are_refused_soon():
    pair = definition(IMU) + definition(Kind(IMU.number, "IMU", "Q", "TimeUS"))
    with pytest.raises(LogError, match="defines its messages 2001 times"):
        whole(FMT_OF_FMT + pair * 1200)


def test_only_the_wanted_are_kept_and_all_are_counted():
    data = log(KINDS, [*steps(100), *[message(BAT, 0, 0, 1.0, 1.0)] * 50])
    found = whole(data, wanted=Wanted(names={"BAT"}))
    assert found.count("IMU") == 100
    assert [found.formats[i].name for i in found.rows] == ["BAT"]


def test_memory_is_that_of_the_wanted_messages():
    part = b"".join(steps(2000))
    blocks = [FMT_OF_FMT + definition(IMU) + definition(BAT), *[part] * 100]
    tracemalloc.start()
    found = find_messages(blocks, wanted=Wanted(names={"BAT"}))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.count("IMU") == 200_000
    assert peak < 0.2 * 100 * len(part)


def test_times_out_of_order_are_left_out_whichever_are_fewer():
    late = np.array([0.0, 1.0, 900.0, 2.0, 3.0, 1e9])
    assert possible_in_order(late).tolist() == [True, True, False, True, True, False]
    early = np.array([5.0, 6.0, 0.5, 7.0])
    assert possible_in_order(early).tolist() == [True, True, False, True]


def test_letters_have_the_sizes_of_their_struct():
    from rotorfit.logs.dataflash.messages import Field

    for letter, packed in STRUCT.items():
        assert Field(letter=letter, offset=3).dtype.itemsize == struct.calcsize("<" + packed)


def test_one_instance_is_kept_and_a_glimpse_of_others():
    rest = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    messages = [imu(0.01 * k, *rest, instance=i) for k in range(3000) for i in range(3)]
    data = log(KINDS, messages)
    kept = whole(data, wanted=Wanted(names={"IMU"}, instances={"IMU": 2, "BAT": 0}))
    assert kept.count("IMU") == 9000
    assert columns(kept, "IMU", ("I",))["I"].tolist() == [2] * 3000
    glimpse = find_messages([data] * 20, wanted=Wanted(names=(), glimpsed={"IMU"}))
    numbers = columns(glimpse, "IMU", ("I",))["I"]
    assert set(numbers.tolist()) == {0, 1, 2}
    assert len(numbers) < 0.2 * glimpse.count("IMU")


def test_of_some_messages_only_labelled_fields_are_kept():
    data = log([IMU], steps(500))
    every = whole(data)
    some = whole(data, wanted=Wanted(labels={"IMU": ("GyrY", "TimeUS", "NoSuch")}))
    (index,) = every.named("IMU")
    assert some.rows[index].shape == (500, 12)
    assert some.formats[index].length == every.formats[index].length
    for label in ("TimeUS", "GyrY"):
        mine, all_of_it = (columns(found, "IMU", (label,))[label] for found in (some, every))
        np.testing.assert_array_equal(mine, all_of_it)
    assert columns(some, "IMU", ("GyrX",)) == {}


def test_a_head_in_garbage_is_no_message():
    false_head = b"\0" * 50 + HEAD + bytes([IMU.number]) + b"\0" * 10
    found = whole(log([IMU], steps(5)) + false_head + b"".join(steps(5, first=5)))
    assert found.count("IMU") == 10
    assert (found.damaged_places, found.skipped_bytes, found.dropped) == (1, 63, 0)
