"""The real DataFlash log against pymavlink, and what is said of it."""

import json
from contextlib import contextmanager

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from rotorfit.logs import read_log
from rotorfit.logs.dataflash.columns import columns
from rotorfit.logs.dataflash.messages import find_messages
from rotorfit.tools.inspection.inspect_log import inspect_log

pytestmark = pytest.mark.flights
LOG = "ardupilot-dronekit/log171.bin"


@pytest.fixture(scope="module")
def path(flight_data_dir):
    return flight_data_dir / LOG


@contextmanager
def pymavlink_reader(path):
    reader = DFReader_binary(str(path))
    yield reader
    reader.data_map.close()
    reader.filehandle.close()


def test_every_count_and_every_value_is_pymavlinks(path):
    found = find_messages([path.read_bytes()])
    assert (found.damaged_places, found.skipped_bytes, found.trailing_bytes) == (0, 0, 0)
    ours = {
        form.name: {k: v.tolist() for k, v in columns(found, form.name, form.labels).items()}
        for i, form in enumerate(found.formats)
        if found.counts[i]
    }
    place = dict.fromkeys(ours, 0)
    compared = 0
    with pymavlink_reader(path) as reader:
        theirs = {reader.formats[i].name: n for i, n in enumerate(reader.counts) if n}
        while (message := reader.recv_msg()) is not None:
            name = message.get_type()
            row = place[name]
            place[name] += 1
            for label, raw, element in zip(
                message._fieldnames, message._elements, message.fmt.msg_fmts, strict=True
            ):
                # Mode numbers (M) are turned into names there; texts are bytes here.
                expected = raw if element == "M" else getattr(message, label)
                value = ours[name][label][row]
                if isinstance(expected, str):
                    value = value.decode("utf-8", "replace")
                assert value == expected or (value != value and expected != expected), (name, label)
                compared += 1
    assert {f.name: n for f, n in zip(found.formats, found.counts, strict=True) if n} == theirs
    assert place == theirs
    assert sum(theirs.values()) == 91_530
    assert compared == 841_706


def test_what_is_read_of_it(path):
    log = read_log(path)
    assert {n: len(c.time) for n, c in log.channels.items()} == {
        "gyro": 11_916,
        "accel": 11_916,
        "command": 11_916,
        "battery": 2384,
        "velocity": 2383,
        "reference": 2383,
        "attitude": 2383,
    }
    accel = log.channels["accel"]
    at = accel.time.tolist().index(11.6)
    # The file has -0.0720, -0.6322, -9.5844 there, z down.
    np.testing.assert_allclose(accel.values[at], [-0.0720104, 0.6321859, 9.5844154], atol=1e-6)
    assert 10.0 < np.median(log.channels["battery"].values) < 17.0
    assert log.seconds == pytest.approx(242.6, abs=0.1)
    assert log.metadata["airframe"].splitlines()[1] == 'layout = "quad-x"'
    assert log.metadata["Firmware revision"] == "APM:Copter V3.3-dev (ae3192b8)"
    assert log.warnings == ()


def test_attitude_agrees_with_gyro_and_velocity_with_flight(path):
    log = read_log(path)
    attitude, gyro = log.channels["attitude"], log.channels["gyro"]
    w, x, y, z = attitude.values.T
    roll = np.unwrap(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    rate = np.gradient(roll, attitude.time)
    # The difference spans 0.2 s: ten samples of the gyro.
    slow = np.convolve(gyro.values[:, 0], np.full(10, 0.1), mode="same")
    measured = np.interp(attitude.time, gyro.time, slow)
    flying = (attitude.time > 90) & (attitude.time < 220)
    assert np.corrcoef(rate[flying], measured[flying])[0, 1] > 0.8
    # In hover and slow flight the body's up-axis velocity is small beside 7 m/s forward.
    speed = np.abs(log.channels["velocity"].values[flying])
    assert np.percentile(speed[:, 2], 90) < 3.0


def test_weak_data_are_said(path, assert_wording):
    report = inspect_log(read_log(path))
    notes, trouble = "\n".join(report.notes), "\n".join(report.trouble)
    assert "at 50 Hz" in notes
    assert "at 50 Hz" in notes
    assert_wording(notes)
    assert "set LOG_BITMASK = 917503" in notes
    assert "SERVO_BLH_BDMASK = 15 (the" in notes
    assert "IMU 1 of 3 is used" in notes
    assert_wording(trouble)
    assert json.dumps(report.metadata)
