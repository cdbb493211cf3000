"""A made-up format: one module and one row give it all that the project knows of a format."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import error_of

from rotorfit.errors import LogError
from rotorfit.inspection.inspect_log import inspect_log
from rotorfit.inspection.seen_airframe import seen_airframe
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.read import format_of

SETTINGS = b"gyro_cutoff=80 log_battery=1"


@pytest.fixture
def path(tmp_path):
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(400, 11))
    rows[:, 0] = 0.01 * np.arange(400)
    rows[:, 7:] = 0.5
    file = tmp_path / "flight.hov"
    file.write_bytes(b"HOVER1\n" + SETTINGS + b"\n" + rows.tobytes())
    return file


def test_its_numbers_are_read_back(path):
    log = read_log(path)
    assert (log.format, log.seconds, log.takes_columns) == ("hoverlog", 3.99, False)
    assert {n: c.values.shape for n, c in log.channels.items()} == {
        "gyro": (400, 3),
        "accel": (400, 3),
        "command": (400, 4),
    }


def test_inspect_knows_settings_filters_and_motor_order(path):
    log = read_log(path)
    report = inspect_log(log)
    assert [s.name for s in report.settings] == ["log_rate"]
    assert report.filters == ("the gyro's low-pass is at 80 Hz (gyro_cutoff)",)
    assert seen_airframe(log, report).order == "px4"


def test_maps_and_second_logs_are_refused(path):
    columns = {"gyro_x": ColumnSpec(name="a")}
    message = error_of(path, options=ReadOptions(columns=columns))
    assert message == "a Hover log names its own fields: leave out a columns map"
    message = error_of(path, options=ReadOptions(log_number=2))
    assert message == "a Hover log is one log, there is no log 2"


@given(st.binary(max_size=400))
def test_any_bytes_end_in_a_log_or_a_log_error(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "any.hov"
    file.write_bytes(b"HOVER1\n" + content)
    assert format_of(file).name == "hoverlog"
    with contextlib.suppress(LogError):
        read_log(file)
