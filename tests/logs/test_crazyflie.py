import re
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from crazyflie_encoder import FIXED, Event, Record, encode, encode_header, encode_record
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults
from scipy.spatial.transform import Rotation

from rotorfit.errors import LogError
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.crazyflie import is_crazyflie, list_events, read_crazyflie
from rotorfit.logs.crazyflie_records import (
    LARGEST_BLOCK,
    SEARCH_BYTES,
    column,
    find_records,
    record_times,
)

FLIGHT = Event(
    FIXED,
    "fixedFrequency",
    [(f"acc.{a}", "f") for a in "xyz"]
    + [(f"gyro.{a}", "f") for a in "xyz"]
    + [(f"motor.m{i}", "H") for i in (1, 2, 3, 4)],
)
OTHER = Event(7, "estTDOA", [("id", "B"), ("distance", "e"), ("count", "b"), ("t", "i")])
VALUES = (0.5, -0.25, 1.0, 180.0, -90.0, 45.0, 0, 65535, 13107, 52428)

fuzzed = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


def written(tmp_path, content):
    path = tmp_path / "log00"
    path.write_bytes(content)
    return path


def flight(count=50, *, start=1_000_000, step=1000):
    return [Record(FIXED, start + step * k, (float(k), *VALUES[1:])) for k in range(count)]


def flown(tmp_path, variables, rows, **kwargs):
    """Read a log of named float variables."""
    event = Event(FIXED, "fixedFrequency", [(name, "f") for name in variables])
    records = [Record(FIXED, 1000 * k, row) for k, row in enumerate(rows)]
    return read_crazyflie(written(tmp_path, encode([event], records)), **kwargs)


@pytest.mark.parametrize(("version", "unit"), [(1, 1e-3), (2, 1e-6)])
def test_channels_are_in_si_units(tmp_path, version, unit):
    log = read_log(written(tmp_path, encode([FLIGHT], flight(), version=version)))
    assert (log.format, log.warnings, log.notes) == ("crazyflie", (), ())
    assert list(log.channels) == ["gyro", "accel", "command"]
    gyro, accel, command = log.channels.values()
    assert gyro.time == pytest.approx(unit * (1_000_000 + 1000 * np.arange(50)), rel=1e-15)
    assert log.seconds == pytest.approx(unit * 49_000)
    assert gyro.values[3] == pytest.approx(np.pi * np.array([1, -0.5, 0.25]))
    assert accel.values[:, 0] == pytest.approx(9.80665 * np.arange(50))
    assert accel.values[3, 1:] == pytest.approx([-0.25 * 9.80665, 9.80665])
    assert command.values[3] == pytest.approx([0, 1, 0.2, 0.8])
    assert command.resolution == 1 / 65535
    assert log.metadata["log version"] == str(version)


@fuzzed
@given(
    kinds=st.lists(st.sampled_from("BbHhIife"), min_size=1, max_size=8),
    version=st.sampled_from([1, 2]),
    data=st.data(),
)
def test_every_value_comes_back(kinds, version, data):
    events = [
        Event(3, "first", [(f"v.{i}", kind) for i, kind in enumerate(kinds)]),
        Event(9, "second", [("w", "H")]),
    ]
    values = {
        **{"BHI"[i]: st.integers(0, 256**2**i - 1) for i in range(3)},
        **{"bhi"[i]: st.integers(-(256**2**i) // 2, 256**2**i // 2 - 1) for i in range(3)},
        "f": st.floats(width=32, allow_nan=False, allow_infinity=False),
        "e": st.floats(width=16, allow_nan=False, allow_infinity=False),
    }
    row = st.tuples(*(values[kind] for kind in kinds))
    records = [
        Record(3, 10 * k, data.draw(row)) if is_first else Record(9, 10 * k, (k,))
        for k, is_first in enumerate(data.draw(st.lists(st.booleans(), max_size=30)))
    ]
    content = encode(events, records, version=version)
    found = find_records(content)
    assert (found.checksum, found.trailing_bytes, found.damaged_places) == (True, 0, 0)
    for event in found.header.events:
        mine = [record for record in records if record.number == event.number]
        unit = 1e-3 if version == 1 else 1e-6
        assert record_times(content, found, event).tolist() == [r.time * unit for r in mine]
        for i, variable in enumerate(event.variables):
            expected = [float(record.values[i]) for record in mine]
            assert column(content, found, event, variable).tolist() == expected


def test_runs_longer_than_a_block_are_whole():
    event = Event(FIXED, "fixedFrequency", [("motor.m1", "H")])
    count = 2 * LARGEST_BLOCK + 77
    rows = np.zeros(count, dtype=[("n", "<u2"), ("t", "<u8"), ("v", "<u2")])
    rows["n"], rows["t"], rows["v"] = FIXED, 1000 * np.arange(count), np.arange(count) % 60000
    content = encode_header([event]) + rows.tobytes()
    content += struct.pack("<I", zlib.crc32(content))
    found = find_records(content)
    read = column(content, found, found.header.events[0], found.header.events[0].variables[0])
    np.testing.assert_array_equal(read, rows["v"])


def test_the_controller_has_the_rates_and_the_mixer_the_commands(tmp_path, assert_wording):
    names = [f"controller.cmd_{n}" for n in ("thrust", "roll", "pitch", "yaw")]
    names += [f"controller.r_{n}" for n in ("roll", "pitch", "yaw")] + ["controller.accelz"]
    rows = [(30000, 1000, 400, 50, 1, 2, 3, 1), (0, 900, 900, 900, 0, 0, 0, 1)] * 5
    rows += [(60000, 20000, 0, 0, 1, 2, 3, 1), (1000, 20000, 0, 0, 1, 2, 3, 1)]
    log = flown(tmp_path, names, rows)
    assert list(log.channels) == ["gyro", "command"]
    assert log.channels["gyro"].values[0].tolist() == [1, -2, 3]
    command = 65535 * log.channels["command"].values
    assert command[0] == pytest.approx([29750, 29250, 30350, 30650])
    assert command[1].tolist() == [0, 0, 0, 0]  # no thrust: the firmware stops the motors
    assert command[-2] == pytest.approx([50000, 50000, 65535, 65535])
    assert command[-1] == pytest.approx([0, 0, 11000, 11000])
    assert "legacy mixer" in log.channels["command"].source
    assert_wording(log.notes)
    assert log.notes[-1] == "Left out: controller.accelz."


def test_the_gyro_itself_goes_before_the_controller(tmp_path, assert_text):
    names = [f"controller.r_{n}" for n in ("roll", "pitch", "yaw")] + [f"gyro.{a}" for a in "xyz"]
    log = flown(tmp_path, names, [(1, 2, 3, 180, 0, 0)] * 3)
    assert log.channels["gyro"].values[0] == pytest.approx([np.pi, 0, 0])
    assert_text(log.notes[-1])


def test_commands_as_demanded_go_before_those_put_out(tmp_path, assert_text):
    pwm = [f"pwm.m{i}_pwm" for i in (1, 2, 3, 4)]
    motor = [f"motor.m{i}" for i in (1, 2, 3, 4)]
    log = flown(tmp_path, pwm, [(0, 13107, 26214, 65535)] * 3)
    assert log.channels["command"].values[0] == pytest.approx([0, 0.2, 0.4, 1])
    log = flown(tmp_path, pwm + motor, [(0, 0, 0, 0, 13107, 13107, 13107, 65536), (0,) * 8])
    assert log.channels["command"].values[0, :3] == pytest.approx([0.2, 0.2, 0.2])
    assert np.isnan(log.channels["command"].values[0, 3])
    assert_text(log.notes[0])
    assert log.notes[-1] == f"Left out: {', '.join(pwm)}."


@pytest.mark.parametrize(
    ("names", "row", "channel", "values"),
    [
        (["pm.vbat"], [3.75], "battery", [3.75]),
        (["pm.vbatMV"], [3750], "battery", [3.75]),
        (
            ["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"],
            [1, 2, 3],
            "position",
            [1, 2, 3],
        ),
        ([f"stateEstimate.q{a}" for a in "xyzw"], [0, 0, 1.01, 0], "attitude", [0, 0, 0, 1]),
        ([f"rpm.m{i}" for i in "1234"], [60, -60, 600, 0], "rotor_speed", [1, 1, 10, 0]),
        ([f"motor.m{i}_rpm" for i in "1234"], [60, 60, 600, 0], "rotor_speed", [1, 1, 10, 0]),
    ],
)
def test_other_variables(tmp_path, names, row, channel, values):
    log = flown(tmp_path, names, [row] * 3)
    expected = np.array(values) * (2 * np.pi if channel == "rotor_speed" else 1)
    assert log.channels[channel].values[1] == pytest.approx(expected, rel=1e-6)
    assert any(name in log.channels[channel].source for name in names)


def test_an_attitude_that_is_none_and_infinite_values_are_nan(tmp_path):
    names = [f"stateEstimate.q{a}" for a in "wxyz"] + ["pm.vbat"]
    rows = [(1, 0, 0, 0, 4), (2, 0, 0, 0, np.inf), (np.nan, 0, 0, 0, np.nan), (1, 0, 0, 0, 3)]
    log = flown(tmp_path, names, rows)
    assert np.isnan(log.channels["attitude"].values[:, 0]).tolist() == [False, True, True, False]
    assert np.isnan(log.channels["battery"].values[:, 0]).tolist() == [False, True, True, False]


def test_the_event_is_chosen(tmp_path):
    voltage = Event(4, "low", [("pm.vbat", "f")])
    records = [Record(4, 1000, (3.5,)), *flight(), Record(4, 90000000, (3.0,))]
    path = written(tmp_path, encode([voltage, FLIGHT], records))
    assert "accel" in read_crazyflie(path).channels
    assert read_crazyflie(path, event="low").channels["battery"].values.tolist() == [[3.5], [3.0]]
    with pytest.raises(LogError, match=r"no records of the event 'none': the log has 'low' 2 rec"):
        read_crazyflie(path, event="none")
    only = written(tmp_path, encode([voltage, OTHER], [records[0], records[-1]]))
    assert list(read_crazyflie(only).channels) == ["battery"]
    more = [Record(7, 10 + k, (1, 1.0, 1, 1)) for k in range(4)]
    both = written(tmp_path, encode([voltage, OTHER], [*more, records[0], records[-1]]))
    with pytest.raises(LogError, match=r"several events .*--log N, of 1: 'low', 2: "):
        read_crazyflie(both)
    assert [entry.number for entry in list_events(both)] == [1, 2]
    chosen = read_log(both, options=ReadOptions(log_number=1))
    assert chosen.channels["battery"].values.tolist() == [[3.5], [3.0]]
    with pytest.raises(LogError, match="no log 3: the file has 1: 'low', 2: "):
        read_log(both, options=ReadOptions(log_number=3))


def test_the_one_event_with_an_imu_is_read_without_a_choice(tmp_path):
    event = Event(9, "estimator", FLIGHT.variables)
    voltage = Event(4, "low", [("pm.vbat", "f")])
    flown_records = [Record(9, r.time, r.values) for r in flight()]
    records = [Record(4, 1000, (3.5,)), *flown_records, Record(4, 90000000, (3.0,))]
    path = written(tmp_path, encode([voltage, event], records))
    assert "accel" in read_log(path).channels
    assert list_events(path) == ()
    with pytest.raises(LogError, match="is one log, there is no log 2"):
        read_log(path, options=ReadOptions(log_number=2))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xbc\x02\x00", "3 bytes, expected a Crazyflie log header"),
        (b"\xbc\x03\x00\x01\x00", "Crazyflie log of version 3, expected 1 or 2"),
        (b"\xbc\x02\x00\xff\xff" + b"a" * 99, "the header declares 65535 events"),
        (b"\xbc\x02\x00\x01\x00\x01\x00ab\x00\xff\xff", "event 'ab' declares 65535 variables"),
        (b"\xbc\x02\x00\x01\x00\x01\x00" + b"a" * 999, "no name of at most 200 letters"),
        (
            b"\xbc\x02\x00\x02\x00\x01\x00a\x00\x00\x00\x01\x00b\x00\x00\x00",
            "the header declares an event twice",
        ),
        (
            b"\xbc\x02\x00\x01\x00\x01\x00a\x00\x01\x00v(d)\x00",
            "event 'a' declares the variable 'v(d)'",
        ),
        (
            b"\xbc\x02\x00\x01\x00\x01\x00a\x00\x01\x00\n(f)\x00",
            "event 'a' declares the variable '\\n(f)'",
        ),
        (b"\xbc\x02\x00\x01\x00\x01", "the file ends within its header"),
        (encode([], []), "no flight was recorded: no event is declared"),
        (encode([FLIGHT], []), "no flight was recorded: 'fixedFrequency' 0 records"),
        (encode([FLIGHT], flight(1)), "no flight was recorded: 'fixedFrequency' 1 records"),
        (encode([OTHER], [Record(7, k, (1, 1.0, 1, 1)) for k in range(3)]), "none of the 4 var"),
    ],
)
def test_what_is_no_flight_is_refused(tmp_path, content, message):
    path = written(tmp_path, content)
    with pytest.raises(LogError, match=f"^{re.escape(f'{path}: {message}')}"):
        read_crazyflie(path)


def test_another_format_is_refused(tmp_path):
    with pytest.raises(LogError, match="begins with 61 62 63, expected bc"):
        read_crazyflie(written(tmp_path, b"abc"))
    assert not is_crazyflie(b"\xbc")
    assert not is_crazyflie(b"\xbc\x02\x01")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ReadOptions(axes="FRD"), "names its own variables: leave out axes"),
        (ReadOptions(columns={"time": ColumnSpec(name="t")}), "leave out a columns map"),
        (ReadOptions(log_number=2), "is one log, there is no log 2"),
    ],
)
def test_options_for_other_formats_are_refused(tmp_path, options, message):
    with pytest.raises(LogError, match=message):
        read_log(written(tmp_path, encode([FLIGHT], flight())), options=options)


def test_a_log_that_was_cut_off_is_read_to_its_last_whole_record(tmp_path, assert_text):
    content = encode([FLIGHT], flight())
    log = read_crazyflie(written(tmp_path, content[: -4 - 20]))
    assert len(log.channels["gyro"].time) == 49
    assert "checksum" in log.warnings[0]
    size = len(encode_record(FLIGHT, flight(1)[0]))
    assert log.warnings[1].startswith(f"{size - 20} bytes at")
    assert_text(log.warnings[1])


def test_changed_values_are_said(tmp_path, assert_wording):
    content = bytearray(encode([FLIGHT], flight()))
    content[-30] ^= 1
    log = read_crazyflie(written(tmp_path, bytes(content)))
    assert len(log.channels["gyro"].time) == 50
    assert len(log.warnings) == 1
    assert_wording(log.warnings[0])


@pytest.mark.parametrize("lost", [b"", b"\xff" * 512, b"\0" * 512, bytes(range(256)) * 3])
@pytest.mark.parametrize("cut", [0, 1, 17])
def test_a_lost_sector_costs_the_records_in_it_alone(tmp_path, lost, cut):
    records = flight(400)
    content = encode([FLIGHT, OTHER], records)
    size = len(encode_record(FLIGHT, records[0]))
    first = len(encode_header([FLIGHT, OTHER])) + 100 * size + cut
    damaged = content[:first] + lost + content[first + 512 :]
    log = read_crazyflie(written(tmp_path, damaged))
    row = log.channels["accel"].values[:, 0] / 9.80665
    expected = [k for k in range(400) if k < 99 or k > 100 + (512 + cut - 1) // size]
    missing = set(expected) - set(np.rint(row).astype(int).tolist())
    assert len(missing) <= 1
    assert np.isin(np.rint(row), [*expected, 99, 100, 100 + (512 + cut - 1) // size]).all()
    assert (log.channels["accel"].values[:, 1:] == 9.80665 * np.array(VALUES[1:3])).all()
    assert (log.channels["gyro"].values == np.radians(VALUES[3:6])).all()
    assert np.array_equal(log.channels["accel"].time, (1e6 + 1e3 * np.rint(row)) * 1e-6)
    assert "damaged places" in log.warnings[1] or lost == b""


def test_one_credible_head_in_damage_is_not_believed(tmp_path, assert_text):
    records = flight(60)
    head = encode_record(FLIGHT, Record(FIXED, 1_030_500, VALUES))[:10]
    parts = [encode_record(FLIGHT, record) for record in records]
    damage = b"\x01" * 100 + head + b"\x01" * 100
    content = encode_header([FLIGHT]) + b"".join(parts[:30]) + damage + b"".join(parts[30:])
    log = read_crazyflie(written(tmp_path, content))
    row = np.rint(log.channels["accel"].values[:, 0] / 9.80665)
    assert row.tolist() == [k for k in range(60) if k != 29]
    assert_text(log.warnings[1])


@pytest.mark.parametrize("more", [-10, -9, -8, -2, -1, 0, 1, 2, 10])
def test_the_search_loses_nothing_between_its_parts(tmp_path, more):
    parts = [encode_record(FLIGHT, record) for record in flight(40)]
    damage = b"\x01" * (SEARCH_BYTES + 1 + more)
    content = encode_header([FLIGHT]) + b"".join(parts[:20]) + damage + b"".join(parts[20:])
    log = read_crazyflie(written(tmp_path, content))
    assert len(log.channels["gyro"].time) == 39
    assert f" {len(damage)} bytes skipped" in log.warnings[1]


def test_an_unfinished_record_after_damage_is_the_end(tmp_path, assert_text):
    parts = [encode_record(FLIGHT, record) for record in flight(40)]
    content = encode_header([FLIGHT]) + b"".join(parts[:20]) + b"\x01" * 30 + parts[30][:20]
    log = read_crazyflie(written(tmp_path, content))
    assert_text(log.warnings[1])


@pytest.mark.parametrize(("wrong", "row"), [(10**14, 0), (8 * 10**9, 20), (-2_000_000, 20)])
def test_a_time_that_cannot_be_is_damage(tmp_path, wrong, row, assert_text):
    records = flight(40, start=5_000_000)
    records[row] = Record(FIXED, records[row].time + wrong, VALUES)
    log = read_crazyflie(written(tmp_path, encode([FLIGHT], records)))
    size = len(encode_record(FLIGHT, records[0]))
    before = int(row > 0)
    (said,) = log.warnings
    assert f" {size} bytes skipped, {before} records" in said
    assert_text(said)
    assert len(log.channels["gyro"].time) == 39 - before


def test_times_out_of_order_are_left_out(tmp_path, assert_text):
    records = flight(50)
    early = [*records[:20], Record(FIXED, 1_000_500, VALUES), *records[20:]]
    log = read_crazyflie(written(tmp_path, encode([FLIGHT], early)))
    assert len(log.channels["gyro"].time) == 50
    assert_text(log.warnings)
    late = [*records[:20], Record(FIXED, 1_900_000, VALUES), *records[20:]]
    log = read_crazyflie(written(tmp_path, encode([FLIGHT], late)))
    assert log.channels["gyro"].time == pytest.approx(1 + 1e-3 * np.arange(50))


def faults_of(path):
    return faults(path, ended(path, read_crazyflie))


@fuzzed
@given(st.binary(max_size=300), st.sampled_from([b"\xbc\x01\x00", b"\xbc\x02\x00", b""]))
def test_any_bytes_end_in_a_log_or_one_line(tmp_path, content, start):
    assert faults_of(written(tmp_path, start + content + b"\0")) == []


@fuzzed
@given(
    st.integers(0, 4000),
    st.integers(0, 100),
    st.binary(max_size=80),
    st.sampled_from([1, 2]),
    st.booleans(),
)
def test_any_damage_ends_in_a_log_or_one_line(tmp_path, place, lost, put, version, resealed):
    other = Record(7, 1_040_000, (1, 1.0, 1, 1))
    records = [*flight(30), other, *flight(30, start=1_050_000)]
    content = encode([FLIGHT, OTHER], records, version=version)
    content = content[:place] + put + content[place + lost :]
    if resealed:
        content = content[:-4] + struct.pack("<I", zlib.crc32(content[:-4]))
    assert faults_of(written(tmp_path, content or b"\xbc")) == []


@pytest.mark.parametrize("length", range(0, 700, 7))
def test_every_beginning_of_a_log_is_read_or_refused(tmp_path, length):
    content = encode([FLIGHT], flight(20))
    path = written(tmp_path, content[: length + 1])
    end = ended(path, read_crazyflie)
    assert faults(path, end) == []
    assert isinstance(end, str) or "checksum" in end.warnings[0]


@pytest.mark.parametrize(
    "filling",
    [b"\xff\xff", b"\0", b"\x07\x00" + bytes(8), np.random.default_rng(1).bytes(1 << 16)],
)
def test_memory_and_time_stay_in_proportion_to_the_file(tmp_path, filling):
    content = encode([FLIGHT, OTHER], flight(20))[:-4]
    content += (filling * (2_000_000 // len(filling) + 1))[:2_000_000]
    path = written(tmp_path, content)
    tracemalloc.start()
    end = ended(path, read_crazyflie)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert faults(path, end) == []
    assert peak < 40_000_000


@pytest.mark.parametrize("euler", [False, True])
def test_velocity_is_turned_into_the_body(tmp_path, euler):
    """A quarter turn left, nose 30 degrees down (the firmware writes pitch positive nose up)."""
    turned = Rotation.from_euler("ZYX", [90.0, 30.0, 0.0], degrees=True)
    speed = [f"stateEstimate.v{a}" for a in "xyz"]
    if euler:
        names, attitude = [f"stateEstimate.{a}" for a in ("roll", "pitch", "yaw")], [0, -30.0, 90.0]
    else:
        names = [f"stateEstimate.q{a}" for a in "wxyz"]
        attitude = turned.as_quat(scalar_first=True).tolist()
    log = flown(tmp_path, [*speed, *names], [(0.0, 2.0, -1.0, *attitude)] * 20)
    ahead = np.array(
        [2.0 * np.cos(np.pi / 6) + 0.5, 0.0, 2.0 * np.sin(np.pi / 6) - np.cos(np.pi / 6)]
    )
    np.testing.assert_allclose(log.channels["velocity"].values[3], ahead, atol=1e-6)


def test_without_attitude_a_world_velocity_is_left_out(tmp_path):
    names = [*(f"stateEstimate.v{a}" for a in "xyz"), "pm.vbat"]
    assert "velocity" not in flown(tmp_path, names, [(0.1, 0.2, 0.3, 3.7)] * 20).channels


def test_rates_asked_for_are_turned_nose_down(tmp_path):
    """The firmware asks for pitch positive nose up."""
    names = [f"controller.{axis}Rate" for axis in ("roll", "pitch", "yaw")]
    log = flown(tmp_path, names, [(90.0, 45.0, -30.0)] * 20)
    asked = np.radians([90.0, -45.0, -30.0])
    np.testing.assert_allclose(log.channels["reference"].values[3], asked, rtol=1e-6)
