"""Every reader of long logs tells how far it is; nobody is told who did not ask."""

import pytest
from flight_writers import RECORDING_WRITERS, WRITERS, in_whole_rpm
from rosbag_writers import messages_of, write_messages_ros2

from flown import simulated
from rotorfit.logs import read_log
from rotorfit.logs.files import report_progress, watched

SMALL = {
    "rotorfit.logs.delimited.PIECE_BYTES": 20_000,
    "rotorfit.logs.files.BLOCK": 50_000,
    "rotorfit.logs.ulog.messages.BLOCK_BYTES": 50_000,
    "rotorfit.logs.blackbox.scan.WINDOW": 5_000,
    "rotorfit.logs.crazyflie_records.LARGEST_BLOCK": 256,
    "rotorfit.logs.table.ROWS_AT_ONCE": 200,
}


FORMATS = (*WRITERS, *RECORDING_WRITERS)


@pytest.fixture(scope="module")
def flight():
    return in_whole_rpm(simulated("quad-x", "noisy", seed=3, seconds=3.0, sample_rate=500.0))


@pytest.mark.parametrize("name", FORMATS)
def test_a_reader_shows_how_far_it_is(name, flight, tmp_path, monkeypatch):
    file, write = {**WRITERS, **RECORDING_WRITERS}[name]
    path = tmp_path / file
    write(flight, path)
    for place, size in SMALL.items():
        monkeypatch.setattr(place, size)
    said, seen = [], []
    with watched(lambda file, done: seen.append((file, done))):
        log = read_log(path, progress=said.append)
    # A bag of a few seconds is one chunk.
    in_one = name in ("ros1", "mcap")
    assert len(said) >= (1 if in_one else 4)
    assert said == sorted(said)
    assert 0.0 < said[0] < (1.0 if in_one else 0.5)
    assert said[-1] == 1.0
    assert seen == [(path, done) for done in said]
    assert read_log(path).sha256 == log.sha256  # asked by nobody
    assert seen == [(path, done) for done in said]


def test_a_recording_of_several_files_is_gone_through_once(flight, tmp_path):
    messages = sorted(messages_of(flight), key=lambda sent: sent.received)
    folder = tmp_path / "parts"
    folder.mkdir()
    for k in range(3):
        part = messages[k * len(messages) // 3 : (k + 1) * len(messages) // 3]
        write_messages_ros2(part, tmp_path / f"part_{k}")
        (tmp_path / f"part_{k}" / f"part_{k}.db3").rename(folder / f"part_{k}.db3")
    said = []
    log = read_log(folder, progress=said.append)
    assert len(log.channels["gyro"].time) == len(flight.time)
    assert said == sorted(said)
    for third in range(3):
        assert sum(third / 3 < done < (third + 0.8) / 3 for done in said) >= 5
    assert said[-1] == 1.0


def test_nobody_is_notified_outside_of_reading():
    said = []
    with watched(lambda file, done: said.append(done)):
        report_progress(1, 2)
    assert said == []
