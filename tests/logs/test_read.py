import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults

from rotorfit.errors import LogError
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.formats import FORMATS, load
from rotorfit.logs.read import kind_of

READS = "; rotorfit reads " + ", ".join(known.title for known in FORMATS)
TABLE = b"time,battery,rotor_1\n0,12,400\n0.01,11.5,\n0.02,,402\n0.03,11,403\n"


def written(tmp_path, content, name="log"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def test_a_table_is_recognised_under_any_name(tmp_path):
    for name in ("flight.csv", "flight.bbl", "flight"):
        log = read_log(written(tmp_path, TABLE, name))
        assert log.format == "table"
        np.testing.assert_array_equal(log.channels["battery"].values[:, 0], [12, 11.5, 11])


def test_options_reach_the_table_reader(tmp_path):
    text = b"t,rotor_1,gyro_x,gyro_y,gyro_z\n0,7,1,2,3\n10,7,1,2,3\n"
    columns = {
        "time": ColumnSpec(name="t", unit="ms"),
        "rotor_1": ColumnSpec(name="rotor_1", unit="erpm"),
    }
    options = ReadOptions(format="table", columns=columns, axes="FRD", motor_poles=14)
    log = read_log(written(tmp_path, text), options=options)
    assert log.seconds == pytest.approx(0.01)
    assert log.channels["rotor_speed"].values[0, 0] == pytest.approx(2 * np.pi / 60)
    assert log.channels["gyro"].values[0].tolist() == [1, -2, -3]


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"\x28\xb5\x2f\xfd\x04", "a zstd archive: unpack it first"),
        (b"%PDF-1.7\n", "a PDF document"),
        (b"\x89PNG\r\n\x1a\n", "an image"),
        (b"\xff\xd8\xff\xe0", "an image"),
        (
            b"MATLAB 5.0 MAT-file, Platform",
            "a MATLAB file: give the log from which it was made (.bin of ArduPilot), or save its "
            "signals with writetable as CSV",
        ),
        (b'{"time": 0}', "JSON: save a recording as the columns of a CSV or Parquet file"),
        (b"[1, 2]", "JSON: save a recording as the columns of a CSV or Parquet file"),
        (
            b'# mine\nname = "x"\n\n[tool.ruff]\nlayout = "quad-x"\n',
            "a TOML file: name the log itself, and an airframe file with --airframe",
        ),
        (b"<!DOCTYPE html>", "a web page or other XML"),
    ],
)
def test_formats_not_read_are_named(tmp_path, content, what):
    path = written(tmp_path, content)
    what, _, remedy = what.partition(": ")
    advice = remedy or "give a flight log"
    message = f"{path}: looks like {what}, which rotorfit does not read: {advice}"
    with pytest.raises(LogError, match=f"^{re.escape(message)}$"):
        read_log(path)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b'[airframe]\nlayout = "quad-x"\n', "an airframe file"),
        (b"[airframe]\n[[configuration]]\nmass = 1.0\n", "an experiment file"),
        (b'{"schema": 1, "parameters": [], "covariance": {}}', "a result of rotorfit identify"),
        (b'{"shared": {}, "configurations": {}}', "the truth of a simulated flight"),
    ],
)
def test_our_own_files_are_named_for_what_they_are(tmp_path, content, what):
    path = written(tmp_path, content)
    message = f"{path}: this is {what}; give a flight log in its place"
    with pytest.raises(LogError, match=f"^{re.escape(message)}$"):
        read_log(path)
    assert kind_of(path) == what


def test_a_flight_log_is_named_so(tmp_path):
    assert kind_of(written(tmp_path, b"time,gyro_x\n0,1\n0.1,2\n")) == "a flight log"
    assert kind_of(written(tmp_path, b"\x00\x01\x02\xfe rest")) is None
    assert kind_of(tmp_path / "none") is None


def test_unknown_bytes_are_shown(tmp_path):
    path = written(tmp_path, b"\x00\x01\x02\xfe rest")
    message = f"{path}: unknown format (begins with 00 01 02 fe 20 72 65 73){READS}"
    with pytest.raises(LogError, match=f"^{re.escape(message)}$"):
        read_log(path)


@pytest.mark.parametrize(
    ("options", "content", "message"),
    [
        (
            ReadOptions(format="word"),
            TABLE,
            "unknown format 'word': one of " + ", ".join(known.name for known in FORMATS),
        ),
        (ReadOptions(log_number=2), TABLE, "a table is one log, there is no log 2"),
        (
            ReadOptions(format="blackbox", columns={"time": ColumnSpec(name="t")}),
            TABLE,
            "a Blackbox log names its own fields and axes: leave out a columns map",
        ),
        (
            ReadOptions(format="blackbox", axes="FRD"),
            TABLE,
            "a Blackbox log names its own fields and axes: leave out axes",
        ),
        (ReadOptions(), b"", "is empty (0 bytes), expected a flight log: copy it again"),
    ],
)
def test_options_that_do_not_suit_the_file_are_refused(tmp_path, options, content, message):
    with pytest.raises(LogError, match=f"{re.escape(message)}$"):
        read_log(written(tmp_path, content), options=options)


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(LogError, match="is a directory"):
        read_log(tmp_path)


def test_the_names_of_the_formats_are_distinct():
    names = [candidate.name for candidate in FORMATS]
    assert len(set(names)) == len(names) >= 2


fuzzed = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@fuzzed
@given(st.binary(min_size=1, max_size=300))
@example(b"PAR1" + bytes(40) + b"PAR1")
@example(b'time,battery\n0,"1\n0.1,2\n')
@example(b"time,battery\n0,1_0\n0.1,2\n")
@example(b"time,battery\n-1e308,1\n1e308,2\n")
@example(b"time,battery\n0,\x00\n0.1,2\n")
@example(b"\xff\xfe\x00\xd8")
@example(b"#")
@example(b",")
def test_any_bytes_end_in_a_log_or_a_log_error(tmp_path, content):
    path = written(tmp_path, content)
    assert faults(path, ended(path)) == []


@fuzzed
@given(
    st.lists(
        st.tuples(
            st.integers(0, len(TABLE)),
            st.integers(0, 4),
            st.sampled_from(
                [
                    b"",
                    b",",
                    b"\n",
                    b'"',
                    b"#",
                    b"-",
                    b"e",
                    b"9",
                    b"nan",
                    b"\r",
                    b"\x00",
                    b";",
                    b"\xff",
                ]
            ),
        ),
        max_size=6,
    )
)
def test_a_damaged_table_ends_in_a_log_or_a_log_error(tmp_path, damage):
    content = TABLE
    for start, length, inserted in damage:
        content = content[:start] + inserted + content[start + length :]
    path = written(tmp_path, content or b" ")
    assert faults(path, ended(path)) == []


def test_importing_the_readers_is_cheap():
    heavy = {"pyarrow", "scipy", "pydantic", "rich", "typer"}
    code = f"import sys, rotorfit.logs; print(sorted({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# Real flights


@pytest.mark.flights
def test_nanobench_reads_by_a_columns_map(flight_data_dir):
    columns = {"time": ColumnSpec(name="t"), "battery": ColumnSpec(name="pwr_pm_vbat")}
    for axis in "xyz":
        columns[f"gyro_{axis}"] = ColumnSpec(name=f"imu_gyro_{axis}")
        columns[f"accel_{axis}"] = ColumnSpec(name=f"imu_acc_{axis}", unit="g")
        columns[f"pos_{axis}"] = ColumnSpec(name=f"p{axis}")
    columns |= {f"quat_{axis}": ColumnSpec(name=f"q{axis}") for axis in "wxyz"}
    columns |= {
        f"command_{i}": ColumnSpec(name=f"motor_motor_m{i}", unit="counts", range=(0.0, 65535.0))
        for i in (1, 2, 3, 4)
    }
    path = flight_data_dir / "nanobench-crazyflie" / "B8_star_fast_rep1.csv"
    log = read_log(path, options=ReadOptions(columns=columns))
    assert set(log.channels) == {"gyro", "accel", "position", "attitude", "command", "battery"}
    assert log.seconds == pytest.approx(42.26, abs=0.01)
    assert log.channels["accel"].values[:, 2].mean() == pytest.approx(9.9, abs=0.1)
    assert log.channels["command"].values.max() <= 1
    assert log.channels["command"].values.mean() == pytest.approx(0.75, abs=0.01)
    assert log.channels["position"].resolution == pytest.approx(1e-6)
    np.testing.assert_allclose(np.linalg.norm(log.channels["attitude"].values, axis=1), 1)


@pytest.mark.flights
def test_optitrack_reads_by_a_columns_map(flight_data_dir):
    columns = {"time": ColumnSpec(name="t")}
    columns |= {f"pos_{axis}": ColumnSpec(name=axis) for axis in "xyz"}
    columns |= {f"quat_{axis}": ColumnSpec(name=f"q{axis}") for axis in "wxyz"}
    path = flight_data_dir / "optitrack-airgarage" / "20240824_00_08_07.csv"
    log = read_log(path, options=ReadOptions(columns=columns))
    assert {name: len(channel.time) for name, channel in log.channels.items()} == {
        "position": 2577,
        "attitude": 2577,
    }
    assert np.median(np.diff(log.channels["position"].time)) == pytest.approx(0.0198, abs=1e-4)


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_every_function_of_a_row_is_there(form):
    places = (form.recognises, form.recognises_folder, form.read, form.list_logs)
    functions = [load(place) for place in (*places, form.advice, form.filters) if place]
    assert len(functions) >= 2
    assert all(map(callable, functions))


def test_a_table_is_read_without_the_readers_of_other_formats(tmp_path):
    path = written(tmp_path, b"time,gyro_x,gyro_y,gyro_z\n0,1,2,3\n0.01,1,2,3\n")
    code = (
        "import sys; from pathlib import Path; from rotorfit import read_log; "
        "read_log(Path(sys.argv[1])); print([m for m in sys.modules if m.endswith('.read')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "['rotorfit.logs.read']"


def test_a_battery_of_no_volts_was_not_measured(tmp_path):
    text = "time,battery,rotor_1\n0,0,400\n0.01,11.5,401\n0.02,11,402\n"
    log = read_log(written(tmp_path, text.encode()))
    np.testing.assert_array_equal(log.channels["battery"].values[:, 0], [np.nan, 11.5, 11])
    none = read_log(written(tmp_path, text.replace("11.5", "0").replace("11,", "-1,").encode()))
    assert "battery" not in none.channels
    assert any("is never above 0 V" in note for note in none.notes)


@pytest.mark.parametrize(("volts", "said"), [(3700.0, "mV"), (1680.0, "hundredths"), (52.0, "")])
def test_a_battery_that_reads_hundreds_of_volts_is_scaled(tmp_path, volts, said):
    rows = "".join(f"{0.01 * k:.2f},{volts:g},400\n" for k in range(4))
    log = read_log(written(tmp_path, f"time,battery,rotor_1\n{rows}".encode()))
    true = {3700.0: 3.7, 1680.0: 16.8, 52.0: 52.0}[volts]
    np.testing.assert_allclose(log.channels["battery"].values[:, 0], true)
    assert any("it is taken as" in note and said in note for note in log.notes) is bool(said)
