import hashlib
import re
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from rotorfit.errors import LogError, OutputError
from rotorfit.logs.columns import ColumnSpec
from rotorfit.logs.delimited import careful_numbers, fast_numbers, open_delimited
from rotorfit.logs.flight_log import CHANNELS
from rotorfit.logs.read import read_log
from rotorfit.logs.table import format_table, read_table, resolution_of, write_table
from rotorfit.logs.units import attitude_from_euler, attitude_to_flu, vectors_to_flu

AXES = ("x", "y", "z")
NUMBER = st.floats(-100, 100)
ANGLE = st.floats(-3, 3)


def flight(n=50, *, seed=0):
    """Return a flight table with every canonical column, in SI units."""
    rng = np.random.default_rng(seed)
    quaternion = rng.standard_normal((4, n))
    quaternion /= np.linalg.norm(quaternion, axis=0)
    columns = {"time": 10 + np.arange(n) / 250}
    for name in ("gyro", "accel", "vel", "ref", "pos"):
        columns |= {f"{name}_{axis}": rng.standard_normal(n) for axis in AXES}
    columns |= {f"rotor_{i}": rng.uniform(400, 900, n) for i in (1, 2, 3, 4)}
    columns |= {f"command_{i}": rng.uniform(0, 1, n) for i in (1, 2, 3, 4)}
    columns |= {f"quat_{axis}": row for axis, row in zip("wxyz", quaternion, strict=True)}
    return columns | {"battery": rng.uniform(10, 12, n)}


def stacked(columns, *names):
    return np.stack([columns[name] for name in names], axis=1)


def written(tmp_path, text, name="flight.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(tmp_path, text, **options):
    """Return the message with which a file is refused, without its path."""
    path = written(tmp_path, text)
    with pytest.raises(LogError) as caught:
        read_table(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert not isinstance(caught.value.__cause__, LogError)  # the same would be said twice
    return message.removeprefix(f"{path}: ")


GYRO = "time,gyro_x,gyro_y,gyro_z\n0,1,2,3\n0.01,4,5,6\n0.02,7,8,9\n"
GYRO_VALUES = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


# Round trips


def test_csv_reads_back_every_channel_to_the_last_bit(tmp_path):
    columns = flight()
    path = tmp_path / "a.csv"
    write_table(path, columns)
    log = read_table(path)
    assert set(log.channels) == set(CHANNELS)
    stems = {"gyro": "gyro", "accel": "accel", "velocity": "vel", "reference": "ref"}
    for channel, stem in stems.items():
        expected = stacked(columns, *(f"{stem}_{axis}" for axis in AXES))
        np.testing.assert_array_equal(log.channels[channel].values, expected)
    rotors = stacked(columns, "rotor_1", "rotor_2", "rotor_3", "rotor_4")
    np.testing.assert_array_equal(log.channels["rotor_speed"].values, rotors)
    np.testing.assert_array_equal(log.channels["battery"].values[:, 0], columns["battery"])
    quaternion = stacked(columns, "quat_w", "quat_x", "quat_y", "quat_z")
    np.testing.assert_allclose(log.channels["attitude"].values, quaternion, rtol=1e-15)
    np.testing.assert_array_equal(log.channels["gyro"].time, columns["time"])
    assert log.seconds == pytest.approx(49 / 250)
    assert (log.format, log.log_number, log.logs_in_file) == ("table", 1, 1)
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_units_and_names_of_a_map_lead_to_the_same_log(tmp_path, kind, assert_text):
    columns = flight()
    foreign = {"stamp": columns["time"] * 1e6, "v": columns["battery"] * 1e3}
    foreign |= {f"g{axis}": np.degrees(columns[f"gyro_{axis}"]) for axis in AXES}
    foreign |= {f"a{axis}": columns[f"accel_{axis}"] / 9.80665 for axis in AXES}
    foreign |= {f"e{i}": columns[f"rotor_{i}"] * 60 / (2 * np.pi) * 7 for i in (1, 2, 3, 4)}
    foreign |= {f"m{i}": 1000 + 1000 * columns[f"command_{i}"] for i in (1, 2, 3, 4)}
    path = tmp_path / f"foreign.{kind}"
    write = pyarrow.csv.write_csv if kind == "csv" else pyarrow.parquet.write_table
    write(pyarrow.table(foreign), path)
    names = {"time": ColumnSpec(name="stamp", unit="us")}
    names |= {"battery": ColumnSpec(name="v", unit="mV")}
    names |= {f"gyro_{a}": ColumnSpec(name=f"g{a}", unit="deg/s") for a in AXES}
    names |= {f"accel_{a}": ColumnSpec(name=f"a{a}", unit="g") for a in AXES}
    names |= {f"rotor_{i}": ColumnSpec(name=f"e{i}", unit="erpm") for i in (1, 2, 3, 4)}
    names |= {
        f"command_{i}": ColumnSpec(name=f"m{i}", unit="us", range=(1000.0, 2000.0))
        for i in (1, 2, 3, 4)
    }
    log = read_table(path, columns=names, motor_poles=14)
    write_table(tmp_path / "own.csv", {n: c for n, c in columns.items() if n in names})
    own = read_table(tmp_path / "own.csv")
    assert set(log.channels) == set(own.channels)
    for name, channel in own.channels.items():
        np.testing.assert_allclose(log.channels[name].values, channel.values, rtol=1e-9)
        np.testing.assert_allclose(log.channels[name].time, channel.time, rtol=1e-12)
    assert_text(log.channels["gyro"].source)


def test_scale_and_offset_come_before_the_unit(tmp_path):
    path = written(tmp_path, "time,raw\n0,100\n0.1,200\n0.2,300\n")
    spec = ColumnSpec(name="raw", unit="mV", scale=10.0, offset=5.0)
    log = read_table(path, columns={"battery": spec})
    np.testing.assert_allclose(log.channels["battery"].values[:, 0], [1.005, 2.005, 3.005])
    assert log.channels["battery"].source == "columns raw x 10 + 5 [mV]"


# The many shapes of a CSV


@pytest.mark.parametrize(
    "text",
    [
        GYRO,
        GYRO.rstrip("\n"),
        GYRO + "\n\n",
        GYRO.replace(",", ";"),
        GYRO.replace(",", "\t"),
        GYRO.replace(",", "|"),
        GYRO.replace(",", " "),
        GYRO.replace(",", ", "),
        GYRO.replace("\n", "\r\n"),
        GYRO.replace("\n", "\r"),
        "\ufeff" + GYRO,
        GYRO.encode("utf-16"),
        "# rotor test\n% 2\n\n" + GYRO,
        GYRO.replace("0.01,", "# a pause\n0.01,"),
        GYRO.replace("0.01,", "% a pause\n\n0.01,"),
        "# " + GYRO,
        GYRO.replace("time", '"time"').replace("gyro_x", '"gyro_x"'),
        re.sub(r"([\d.]+)", r'"\1"', GYRO),
        GYRO.replace("\n", ",\n"),
        GYRO.replace("time", "note,time").replace("\n0", "\nsome text,0"),
        GYRO.replace("time", "note,time").replace("\n0", "\n,0"),
        "gyro_z,time,gyro_y,gyro_x\n3,0,2,1\n6,0.01,5,4\n9,0.02,8,7\n",
        GYRO.replace("time", "µ,time").replace("\n0", "\n5,0").encode("latin-1"),
    ],
)
def test_text_tables_of_many_makes_read_alike(tmp_path, text):
    log = read_table(written(tmp_path, text))
    np.testing.assert_array_equal(log.channels["gyro"].values, GYRO_VALUES)
    np.testing.assert_array_equal(log.channels["gyro"].time, [0, 0.01, 0.02])


COMMAS = "time;gyro_x;gyro_y;gyro_z\n0;1,5;-2,5e-1;3\n0,01;4;5;6\n0,02;7;8;9\n"


@pytest.mark.parametrize(
    "text",
    [
        COMMAS,
        COMMAS.replace(";", "\t"),
        COMMAS.replace(";", " "),
        re.sub(r"(?<![a-z])(-?\d[\d,e-]*)(?=[;\n])", r'"\1"', COMMAS),
        COMMAS.replace("time", "note;time").replace("\n0", "\nsome, text;0"),
    ],
)
def test_decimals_may_have_a_comma(tmp_path, text):
    log = read_table(written(tmp_path, text))
    np.testing.assert_array_equal(log.channels["gyro"].values[0], [1.5, -0.25, 3.0])
    np.testing.assert_array_equal(log.channels["gyro"].time, [0, 0.01, 0.02])


def test_commas_that_may_part_thousands_are_no_decimals(tmp_path):
    text = "time;gyro_x;gyro_y;gyro_z\n0;1,500;2;3\n1;4;5;1,234\n"
    with pytest.raises(LogError, match="'1,500' is not a number"):
        read_table(written(tmp_path, text))


@pytest.mark.parametrize("row", ["s,deg/s,deg/s,deg/s,V", "[s],[deg/s],[deg/s],[deg/s],[V]"])
def test_units_in_a_row_of_their_own_go_behind_the_names(tmp_path, row):
    names = "t,gx,gy,gz,volts"
    table = open_delimited(f"{names}\n{row}\n0,1,2,3,12\n".encode())
    assert table.names == ("t [s]", "gx [deg/s]", "gy [deg/s]", "gz [deg/s]", "volts [V]")
    assert table.place(0) == "line 3"
    np.testing.assert_array_equal(table.numbers(["gy [deg/s]"]), [[2.0]])


@pytest.mark.parametrize(
    "above",
    [
        "robot,beetle\nframe,cog\n",
        "Flight of Tuesday\n",
        "pilot,someone\nmass,1.2\n\n",
        "a title, with a comma, or two\n# and a comment\n",
    ],
)
@pytest.mark.parametrize("text", [GYRO, GYRO.replace("\n", "\ns,rad/s,rad/s,rad/s\n", 1)])
@pytest.mark.parametrize("decimal", [".", ","])
def test_lines_above_the_names_are_skipped(above, text, decimal):
    if decimal == ",":
        text = text.replace(",", ";").replace(".", ",")
    table = open_delimited((above + text).encode())
    assert [name.removesuffix("]").partition(" [")[0] for name in table.names] == [
        *("time", "gyro_x", "gyro_y", "gyro_z")
    ]
    np.testing.assert_array_equal(table.numbers(table.names[1:]), GYRO_VALUES)
    assert table.place(0) == f"line {above.count(chr(10)) + text.count(chr(10)) - 2}"


def test_the_line_of_a_bad_cell_counts_the_lines_above(tmp_path):
    text = "robot,beetle\nframe,cog\n" + GYRO.replace("0.02", "later")
    with pytest.raises(LogError, match="line 6, column 'time'"):
        read_table(written(tmp_path, text))


@pytest.mark.parametrize("row", ["1,1", "s,furlong", "s", "0,5"])
def test_a_row_of_anything_else_is_no_row_of_units(row):
    assert open_delimited(f"t,gx\n{row}\n0,1\n".encode()).names == ("t", "gx")


@pytest.mark.parametrize("gap", ["", "nan", "NaN", "NA", "null", "inf", "1e999"])
def test_a_channel_has_the_clock_of_its_own_rows(tmp_path, gap):
    header = "battery,time,gyro_x,gyro_y,gyro_z\n"
    text = header + "12,0,1,2,3\nG,0.01,4,G,6\nG,0.02,7,8,9\n11,0.03,G,G,G\n"
    log = read_table(written(tmp_path, text.replace("G", gap)))
    np.testing.assert_array_equal(log.channels["battery"].time, [0, 0.03])
    np.testing.assert_array_equal(log.channels["gyro"].time, [0, 0.01, 0.02])
    np.testing.assert_array_equal(log.channels["gyro"].values[1], [4, np.nan, 6])


@pytest.mark.parametrize(
    "rows",
    [
        "0,,1\n,,\n2,3,\n",
        ",,\n1,,\n",
        "1,2,\n,,3",
        "1,2,3\n4,5,6\n# 7,8,9\n",
    ],
)
def test_numpy_parses_gaps_as_the_careful_parser_does(rows):
    table = open_delimited(b"a,b,c\n" + rows.encode())
    fast = fast_numbers(table, [2, 0])
    assert fast is not None
    np.testing.assert_array_equal(fast, careful_numbers(table, [2, 0]))


@pytest.mark.parametrize(
    ("rows", "line", "cells"),
    [
        ("0,12,a,b\n0.1,12,a,b,c\n0.2,12,a\n", 3, 5),
        ("0,12,a,b\n0.1,12,a\n0.2,12,a,b,c\n", 3, 3),
        ("0,12,a,b\n0.1,12,a", 3, 3),
        ('0,12,a,b\n0.1,12,a,b\n"0.2,12,a,b"\n', 4, 1),
    ],
)
def test_rows_are_counted_to_their_end_where_nothing_is_read(
    tmp_path, rows, line, cells, assert_text
):
    assert_text(refusal(tmp_path, "time,battery,note,more\n" + rows))


@pytest.mark.parametrize("end", ["29,1,2", "29,1,", "2", "29,1,2,"])
def test_a_last_line_that_was_cut_off_is_left_out(tmp_path, end):
    lines = [f"{0.01 * k:.2f},1,2,3" for k in range(25)]
    log = read_table(written(tmp_path, "\n".join(["time,gyro_x,gyro_y,gyro_z", *lines, end])))
    if end.count(",") < 3:
        assert len(log.channels["gyro"].time) == 25
        assert any("last line" in note for note in log.notes)
    else:
        assert len(log.channels["gyro"].time) == 26


def test_a_quoted_delimiter_is_no_delimiter(tmp_path, assert_text):
    header = "note,time,battery,more\n"
    log = read_table(written(tmp_path, header + 'a,0,12,b\n"x, y",0.1,11,b\n'))
    assert log.channels["battery"].values.tolist() == [[12], [11]]
    message = refusal(tmp_path, header + 'a,0,12,b\n"x,0.1,11,y"\n')
    assert_text(message)


def test_half_an_attitude_next_to_a_whole_one_is_left_out(tmp_path, assert_text):
    text = "time,quat_w,quat_x,quat_y,quat_z,yaw\n0,1,0,0,0,9\n0.01,1,0,0,0,9\n"
    log = read_table(written(tmp_path, text))
    assert log.channels["attitude"].values.tolist() == [[1, 0, 0, 0], [1, 0, 0, 0]]
    assert_text(log.notes)


def test_rows_without_a_time_are_left_out_and_counted(tmp_path, assert_text):
    log = read_table(written(tmp_path, GYRO + ",1,1,1\n0.04,1,1,1\n"))
    assert_text(log.notes)
    np.testing.assert_array_equal(log.channels["gyro"].time, [0, 0.01, 0.02, 0.04])


def test_repeated_times_are_for_later_stages(tmp_path):
    log = read_table(written(tmp_path, GYRO.replace("0.01,", "0,") + "0.02,1,1,1\n0.02,1,1,1\n"))
    np.testing.assert_array_equal(log.channels["gyro"].time, [0, 0, 0.02, 0.02, 0.02])


def test_an_empty_optional_channel_is_left_out_with_a_note(tmp_path, assert_text):
    text = "time,gyro_x,gyro_y,gyro_z,battery\n0,1,2,3,\n0.01,4,5,6,\n"
    log = read_table(written(tmp_path, text))
    assert set(log.channels) == {"gyro"}
    assert_text(log.notes)


def test_a_stray_column_of_a_mapped_file_is_left_out_with_a_note(tmp_path, assert_text):
    path = written(tmp_path, "t,yaw,vbat\n0,1,12\n0.01,2,12\n")
    names = {"time": ColumnSpec(name="t"), "battery": ColumnSpec(name="vbat")}
    log = read_table(path, columns=names)
    assert set(log.channels) == {"battery"}
    assert_text(log.notes)


def test_a_column_that_the_map_claims_loses_its_own_name(tmp_path):
    path = written(tmp_path, "time,roll,pitch,yaw\n0,10,20,30\n0.01,10,20,30\n")
    rates = {"gyro_x": "roll", "gyro_y": "pitch", "gyro_z": "yaw"}
    log = read_table(path, columns={k: ColumnSpec(name=v) for k, v in rates.items()})
    assert set(log.channels) == {"gyro"}
    np.testing.assert_array_equal(log.channels["gyro"].values[0], [10, 20, 30])


# Axes and attitude


@given(arrays(float, (5, 3), elements=NUMBER), arrays(float, (5, 3), elements=ANGLE))
def test_frd_and_flu_describe_the_same_motion(vectors, angles):
    flu = vectors_to_flu(vectors, "FRD")
    np.testing.assert_array_equal(vectors_to_flu(flu, "FRD"), vectors)
    np.testing.assert_array_equal(vectors_to_flu(vectors, "FLU"), vectors)
    # World vectors: turned by the converted attitude, they are the converted turned vectors.
    attitude_wxyz = attitude_from_euler(angles)
    rotated = _rotation(attitude_wxyz).apply(vectors)
    rotated_flu = _rotation(attitude_to_flu(attitude_wxyz, "FRD")).apply(flu)
    np.testing.assert_allclose(rotated_flu, vectors_to_flu(rotated, "FRD"), atol=1e-10)


@given(arrays(float, (5, 3), elements=ANGLE))
def test_euler_angles_agree_with_the_matrix_product(angles):
    roll, pitch, yaw = angles.T
    expected = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    ours = _rotation(attitude_from_euler(angles)).as_matrix()
    np.testing.assert_allclose(ours, expected, atol=1e-12)


def _rotation(attitude_wxyz):
    return Rotation.from_quat(attitude_wxyz[:, [1, 2, 3, 0]])


def test_a_frd_table_is_turned_at_the_door(tmp_path, assert_text):
    flu = flight()
    frd = {n: -c if n.endswith(("_y", "_z")) else c for n, c in flu.items()}
    write_table(tmp_path / "flu.csv", flu)
    write_table(tmp_path / "frd.csv", frd)
    ours = read_table(tmp_path / "frd.csv", axes="FRD")
    expected = read_table(tmp_path / "flu.csv")
    for name, channel in expected.channels.items():
        np.testing.assert_array_equal(ours.channels[name].values, channel.values)
    assert_text(ours.notes)


def test_quaternion_and_euler_angles_read_alike(tmp_path, assert_wording):
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.5, 1.5, (20, 3))
    time = {"time": np.arange(20) / 100}
    euler = {n: angles[:, i] for i, n in enumerate(("roll", "pitch", "yaw"))}
    wxyz = attitude_from_euler(angles)
    quaternion = {f"quat_{axis}": wxyz[:, i] for i, axis in enumerate("wxyz")}
    write_table(tmp_path / "euler.csv", time | euler)
    write_table(tmp_path / "quaternion.csv", time | quaternion)
    write_table(tmp_path / "both.csv", time | euler | quaternion)
    for axes in ("FLU", "FRD"):
        logs = [
            read_table(tmp_path / f"{name}.csv", axes=axes)
            for name in ("euler", "quaternion", "both")
        ]
        first, *others = (log.channels["attitude"].values for log in logs)
        for other in others:
            np.testing.assert_allclose(other, first, atol=1e-14)
    assert_wording(logs[2].notes[0])


def test_lost_tracking_is_nan_and_quaternions_are_made_unit(tmp_path, assert_text):
    text = "time,quat_w,quat_x,quat_y,quat_z\n0,1.001,0,0,0\n0.01,0,0,0,0\n0.02,0,0.999,0,0\n"
    log = read_table(written(tmp_path, text))
    values = log.channels["attitude"].values
    np.testing.assert_array_equal(values[[0, 2]], [[1, 0, 0, 0], [0, 1, 0, 0]])
    assert np.isnan(values[1]).all()
    assert_text(log.notes)


# Resolution


def test_the_resolution_of_a_quantised_channel_is_its_step():
    signal = np.random.default_rng(0).normal(0, 3, (3000, 3))
    assert resolution_of(np.round(signal / 0.125) * 0.125) == 0.125
    assert resolution_of(np.round(np.round(signal * 7) / 7, 2)) == pytest.approx(1 / 7, abs=0.005)
    assert resolution_of(signal) is None
    assert resolution_of(np.round(signal[:, :1] / 10)) is None  # too few levels to tell
    assert resolution_of(np.full((5, 1), np.nan)) is None


def test_the_resolution_is_in_si_units(tmp_path):
    degrees = np.round(np.random.default_rng(0).normal(0, 30, (500, 3)) * 16) / 16
    rows = [f"{i / 100},{x},{y},{z}" for i, (x, y, z) in enumerate(degrees.tolist())]
    path = written(tmp_path, "time,gyro_x,gyro_y,gyro_z\n" + "\n".join(rows))
    columns = {f"gyro_{a}": ColumnSpec(name=f"gyro_{a}", unit="deg/s") for a in AXES}
    resolution = read_table(path, columns=columns).channels["gyro"].resolution
    assert resolution == pytest.approx(np.radians(1 / 16))


# Refusals: tables of the wrong kind


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "t,imu_gyro_x,m1\n0,1,2\n",
            "no column 'time'; the file has t, imu_gyro_x, m1; name them in an experiment file, "
            "such as columns = { "
            'time = { name = "t" }, gyro_x = { name = "imu_gyro_x" }, '
            'rotor_1 = { name = "m1" }, ... }, with a unit where it is not SI, or let rotorfit '
            "propose them: rotorfit airframe FILE",
        ),
        (
            "time,foo\n0,1\n",
            "no known column besides 'time'; the file has time, foo; name them in an "
            "experiment file, such as "
            'columns = { time = { name = "time" }, ... }, with a unit '
            "where it is not SI, or let rotorfit propose them: rotorfit airframe FILE",
        ),
        (
            "foo\n1\n",
            "no column 'time'; the file has foo; name them in an experiment file, such as "
            'columns = { time = { name = "NAME IN THE FILE", unit = "s" }, ... }, with a unit '
            "where it is not SI, or let rotorfit propose them: rotorfit airframe FILE",
        ),
        (
            "time,gyro_x,gyro_y\n0,1,2\n",
            "column 'gyro_z' is missing next to gyro_x, gyro_y: record gyro_x, gyro_y, gyro_z "
            "together, or rename 'gyro_x'",
        ),
        (
            "time,rotor_1,rotor_3\n0,1,2\n",
            "column 'rotor_2' is missing next to rotor_1, rotor_3: record rotor_1, rotor_2, "
            "rotor_3 together, or rename 'rotor_1'",
        ),
        ("time,battery,battery\n0,1,2\n", "2 columns are named 'battery': rename"),
        (
            "0,1,2,3\n0.01,1,2,3\n",
            "no row of column names: line 1 holds numbers only; write the names above, "
            "time,gyro_x,... in the order of the columns",
        ),
        (
            "# nothing\n\n",
            "no row of column names: the file holds only comments and blank lines",
        ),
        ("time,battery\n", "no rows below the column names: nothing was recorded"),
        (
            "time,battery\n1,2\n",
            "one sample only: a flight log needs two at least, and seconds of flight",
        ),
        ("time,battery\n,2\n,3\n", "column 'time' for 'time' holds no number"),
        (
            "time,battery\n1,2\n1,2\n",
            "all 2 rows have the time 1 s: the clock stands; export it with more digits, such as "
            "seconds from the first row",
        ),
        (
            "time,gyro_x,gyro_y,gyro_z\n0,1,,3\n0.01,1,,3\n",
            "column 'gyro_y' for 'gyro_y' holds no number",
        ),
        (
            "# made by hand\ntime,battery\n0,1\n\n0.02,1\n0.01,1\n",
            "line 6: time goes back from 0.02 to 0.01 s: sort the rows, or keep one recording a "
            "file",
        ),
        (
            GYRO + "0.03,1,abc,3\n",
            "line 5, column 'gyro_y': 'abc' is not a number",
        ),
        (
            GYRO.replace("0.01,", "25:00:00,"),
            "line 3, column 'time': '25:00:00' is not a number",
        ),
        (
            GYRO.replace(",", ";") + "0.03;1,5;2;3\n",
            "line 5, column 'gyro_x': '1,5' is not a number: write decimals with a point",
        ),
        (
            GYRO + "0.03,1,2\n",
            "line 5 has 3 cells, the header has 4: complete or remove the line",
        ),
        (
            GYRO.replace("0.01,", "0.005,1,2,3,4\n0.01,"),
            "line 3 has 5 cells, the header has 4: complete or remove the line",
        ),
        (
            "time,command_1\n0,1100\n0.01,1500\n",
            "column 'command_1' for 'command_1' reaches 1500, expected 0 (stop) to 1 (full): say "
            'what it holds, as command_1 = { name = "command_1", unit = "us", '
            'range = [1000, 2000] }, or unit "%", or a scale',
        ),
        (
            "time,roll,pitch,yaw\n0,1,2,3\n0.01,-12.5,1,2\n",
            "column 'roll' for 'roll' reaches 12.5, too much for rad: say the unit, as "
            'roll = { name = "roll", unit = "deg" }',
        ),
        (
            "time,quat_w,quat_x,quat_y,quat_z\n0,9,0,0,0\n0.01,9,0,0,0\n",
            "most quaternions have not length 1 (median 9): check the columns and their scale",
        ),
        (
            b"\xff\xfet",
            "damaged UTF-16 text (truncated data): save it as UTF-8",
        ),
        (
            b"PAR1 and no more",
            "Parquet file without its end: it was cut off, copy or write it again",
        ),
        (b"PAR1 in the middle nothing PAR1", None),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(tmp_path, text, message):
    if message is None:
        assert re.fullmatch(r"damaged Parquet file \(.+\): write it again", refusal(tmp_path, text))
    else:
        said = refusal(tmp_path, text).replace(str(tmp_path / "flight.csv"), "FILE")
        assert said == message


@pytest.mark.parametrize(
    ("step", "unit"),
    [(1, "ms"), (10, "ms"), (2000, "us"), (4e6, "ns"), (1e6, "ns")],
)
def test_times_in_another_unit_are_refused_with_the_fitting_one(tmp_path, step, unit, assert_text):
    text = f"time,battery\n0,12\n{step:g},12\n{2 * step:g},12\n"
    assert_text(refusal(tmp_path, text))
    spec = {"time": ColumnSpec(name="time", unit=unit)}
    assert 0 < read_table(written(tmp_path, text), columns=spec).seconds < 0.1


def test_times_that_fit_no_unit_are_refused(tmp_path, assert_text):
    text = "time,battery\n0,12\n1e12,12\n"
    assert_text(refusal(tmp_path, text))


def test_a_wrong_time_unit_of_a_map_is_refused_too(tmp_path, assert_text):
    message = refusal(tmp_path, GYRO, columns={"time": ColumnSpec(name="time", unit="us")})
    assert_text(message)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"gyrox": ColumnSpec(name="gyro_x")},
            "the columns map names 'gyrox', which rotorfit does not know (did you mean "
            "'gyro_x'?); known are time, gyro_x,",
        ),
        (
            {"gyro_x": ColumnSpec(name="gyr_x")},
            "no column 'gyr_x', which the columns map gives for 'gyro_x' (did you mean "
            "'gyro_x'?); the file has time, gyro_x, gyro_y, gyro_z",
        ),
        (
            {"gyro_x": ColumnSpec(name="gyro_z"), "gyro_y": ColumnSpec(name="gyro_z")},
            "the columns map gives 'gyro_z' for both 'gyro_x' and 'gyro_y': give each its own",
        ),
        (
            {"gyro_x": ColumnSpec(name="gyro_x", unit="m")},
            "column 'gyro_x' for 'gyro_x': unknown unit 'm' of angular velocity: ",
        ),
        (
            {"gyro_x": ColumnSpec(name="gyro_x", scale=0.0)},
            "column 'gyro_x' for 'gyro_x': scale 0 and offset 0 must be finite, and the scale",
        ),
        (
            {"gyro_x": ColumnSpec(name="gyro_x", range=(0.0, 1.0))},
            "column 'gyro_x' for 'gyro_x': only a command has a range",
        ),
        (
            {"vel_x": ColumnSpec(name="gyro_x"), "vel_y": ColumnSpec(name="gyro_y")},
            "column 'vel_z' is missing next to vel_x, vel_y: record vel_x, vel_y, vel_z together, "
            "or name the others in the columns map, too",
        ),
    ],
)
def test_a_wrong_map_is_refused(tmp_path, columns, message):
    assert refusal(tmp_path, GYRO, columns=columns).startswith(message)


# Writing


def test_a_gap_is_written_as_an_empty_cell():
    text = format_table({"time": np.array([0.0, 0.1]), "battery": np.array([np.nan, 0.3])})
    assert text == "time,battery\n0.0,\n0.1,0.3\n"


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"tim": [0.0]}, "'tim' is no column of a flight table: use time, gyro_x, ..."),
        ({"battery": [0.0]}, "a flight table needs the column 'time' [s]"),
        (
            {"time": [0.0], "battery": [1.0, 2.0]},
            "the columns of a flight table differ in length: time 1, battery 2",
        ),
    ],
)
def test_columns_that_make_no_table_are_not_written(columns, message):
    with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
        format_table({name: np.array(column) for name, column in columns.items()})


def test_a_table_replaces_another_only_when_forced(tmp_path):
    path = tmp_path / "a.csv"
    write_table(path, {"time": np.array([0.0])})
    before = path.read_bytes()
    with pytest.raises(OutputError, match="is there already: choose another name, or force"):
        write_table(path, {"time": np.array([1.0])})
    assert path.read_bytes() == before
    write_table(path, {"time": np.array([1.0])}, force=True)
    assert path.read_text() == "time\n1.0\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_a_table_in_no_folder_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match=r"cannot be written \(No such file or directory\)"):
        write_table(tmp_path / "none" / "a.csv", {"time": np.array([0.0])})


@pytest.mark.parametrize("ending", ["", "\n", "\n\n\n"])
@pytest.mark.parametrize("gaps", [False, True])
def test_a_long_table_in_pieces_is_as_in_one(tmp_path, monkeypatch, ending, gaps):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(900, 3)).round(6)
    rows = [[repr(float(x)) for x in row] for row in values]
    if gaps:
        rows[5][2] = rows[777][2] = rows[899][2] = ""
    lines = [f"{0.01 * i:.2f},{','.join(row)}" for i, row in enumerate(rows)]
    path = tmp_path / "long.csv"
    path.write_text("time,gyro_x,gyro_y,gyro_z\n" + "\n".join(lines) + ending)
    whole = read_table(path)
    monkeypatch.setattr("rotorfit.logs.delimited.PIECE_BYTES", 500)
    said = []
    assert fast_numbers(open_delimited(path.read_bytes()), range(4)) is not None
    again = read_log(path, progress=said.append)
    assert np.array_equal(
        again.channels["gyro"].values, whole.channels["gyro"].values, equal_nan=True
    )
    assert again.sha256 == whole.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert len(said) > 20
    assert said == sorted(said)
    assert said[-1] == pytest.approx(1.0, abs=0.02)


@given(
    st.datetimes(datetime(1980, 1, 1), datetime(2100, 1, 1)),
    st.sampled_from([None, UTC, timezone(timedelta(hours=-3, minutes=-30))]),
    st.sampled_from([" ", "T"]),
)
def test_dates_with_a_time_are_seconds(tmp_path_factory, start, zone, between):
    moments = [start.replace(tzinfo=zone) + timedelta(microseconds=4000 * k) for k in range(5)]
    rows = "".join(f"{one.isoformat(between)},1,2,3\n" for one in moments)
    path = written(tmp_path_factory.mktemp("dates"), "time,gyro_x,gyro_y,gyro_z\n" + rows)
    time = read_table(path).channels["gyro"].time
    np.testing.assert_allclose(time - time[0], 0.004 * np.arange(5), atol=1e-6)
    assert time[0] == pytest.approx((start.replace(tzinfo=zone or UTC)).timestamp(), abs=1e-6)


def test_times_of_a_day_are_seconds(tmp_path):
    rows = "".join(f"23:59:{k / 10:07.4f},1,2,3\n" for k in range(5))
    path = written(tmp_path, "time,gyro_x,gyro_y,gyro_z\n" + rows)
    time = read_table(path).channels["gyro"].time
    np.testing.assert_allclose(time, 86340 + 0.1 * np.arange(5), atol=1e-6)
