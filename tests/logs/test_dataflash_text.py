"""The text form of a DataFlash log is the same log; messages out of order are sorted."""

import struct

import numpy as np
import pytest
from dataflash_encoder import KINDS, Logging, dataflash, imu, log

from flown import simulated
from rotorfit.logs import read_log

LABELS = {kind.number: kind for kind in KINDS}


def as_text(data: bytes) -> str:
    """Return a binary log as Mission Planner writes it: scaled fields, texts without nulls."""
    lines, position = [], 0
    while position < len(data):
        number = data[position + 2]
        if number == 128:
            fields = struct.unpack_from("<BB4s16s64s", data, position + 3)
            texts = [f.rstrip(b"\0").decode() for f in fields[2:]]
            lines.append(f"FMT, {fields[0]}, {fields[1]}, {', '.join(texts)}")
            position += 89
            continue
        kind = LABELS[number]
        values = struct.unpack_from(kind.packing, data, position + 3)
        cells = [
            value.rstrip(b"\0").decode()
            if isinstance(value, bytes)
            else repr(value / 100)
            if letter in "cCeE"
            else repr(value)
            for letter, value in zip(kind.letters, values, strict=True)
        ]
        lines.append(f"{kind.name}, {', '.join(cells)}")
        position += kind.length
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def binary():
    flight = simulated("quad-x", "noisy", seed=3, seconds=2.0)
    return dataflash(flight, Logging(command_every=4))


def test_text_reads_as_the_binary_log_does(binary, tmp_path):
    (tmp_path / "flight.bin").write_bytes(binary)
    (tmp_path / "flight.log").write_text(as_text(binary))
    one, other = read_log(tmp_path / "flight.bin"), read_log(tmp_path / "flight.log")
    assert other.format == "dataflash"
    assert set(one.channels) == set(other.channels)
    for name, channel in one.channels.items():
        np.testing.assert_array_equal(other.channels[name].time, channel.time)
        np.testing.assert_allclose(other.channels[name].values, channel.values, rtol=1e-7)
    assert (one.notes, one.metadata) == (other.notes, other.metadata)


def test_lines_that_are_no_messages_are_reported_as_damage(binary, tmp_path):
    lines = as_text(binary).splitlines()
    broken = [*lines[:500], "IMU, 12, x, y", *lines[500:]]
    (tmp_path / "flight.log").write_text("\n".join(broken))
    found = read_log(tmp_path / "flight.log")
    assert [finding.kind for finding in found.findings] == ["damaged-log"]
    whole = (tmp_path / "whole.log", as_text(binary))
    whole[0].write_text(whole[1])
    assert len(read_log(whole[0]).channels["gyro"].time) == len(found.channels["gyro"].time)


def messages_of_imu(times):
    return [imu(t, (np.sin(5 * t), 0.1, 0.2), (0.0, 0.0, -9.8)) for t in times]


def test_messages_out_of_order_are_sorted_and_all_kept(tmp_path, assert_wording):
    times = np.arange(1.0, 5.0, 0.0025)
    shuffled = times.reshape(-1, 4)[:, [0, 3, 1, 2]].ravel()
    path = tmp_path / "flight.bin"
    path.write_bytes(log(KINDS, messages_of_imu(shuffled)))
    found = read_log(path)
    np.testing.assert_allclose(found.channels["gyro"].time, times, atol=1e-6)
    np.testing.assert_allclose(found.channels["gyro"].values[:, 0], np.sin(5 * times), atol=1e-5)
    assert any("800 of 1600 messages" in note for note in found.notes)
    assert_wording(found.notes)


def test_a_damaged_time_is_left_out_still(tmp_path):
    times = np.arange(1.0, 5.0, 0.0025)
    times[700] -= 0.4
    path = tmp_path / "flight.bin"
    path.write_bytes(log(KINDS, messages_of_imu(times)))
    assert len(read_log(path).channels["gyro"].time) == 1599
