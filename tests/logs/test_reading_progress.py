"""Every reader of long logs tells how far it is; nobody is told who did not ask."""

import pytest
from flight_writers import WRITERS, in_whole_rpm

from flown import simulated
from rotorfit.logs import read_log
from rotorfit.logs.progress import tell, watched

SMALL = {
    "rotorfit.logs.delimited.PIECE_BYTES": 20_000,
    "rotorfit.logs.dataflash.read.BLOCK": 50_000,
    "rotorfit.logs.ulog.messages.BLOCK_BYTES": 50_000,
    "rotorfit.logs.blackbox.scan.WINDOW": 5_000,
    "rotorfit.logs.crazyflie_records.LARGEST_BLOCK": 256,
}


@pytest.fixture(scope="module")
def flight():
    return in_whole_rpm(simulated("quad-x", "noisy", seed=3, seconds=3.0, sample_rate=500.0))


@pytest.mark.parametrize("name", ["table", "ulog", "dataflash", "crazyflie", "blackbox", "ros1"])
def test_a_reader_tells_how_far_it_is(name, flight, tmp_path, monkeypatch):
    path = tmp_path / WRITERS[name][0]
    WRITERS[name][1](flight, path)
    for place, size in SMALL.items():
        monkeypatch.setattr(place, size)
    told, seen = [], []
    with watched(lambda file, done: seen.append((file, done))):
        log = read_log(path, progress=told.append)
    # A bag of a few seconds is one chunk.
    assert len(told) >= (1 if name == "ros1" else 4)
    assert told == sorted(told)
    assert 0.0 < told[0] < (1.0 if name == "ros1" else 0.5)
    assert told[-1] == 1.0
    assert seen == [(path, done) for done in told]
    assert read_log(path).sha256 == log.sha256  # asked by nobody
    assert seen == [(path, done) for done in told]


def test_nobody_is_told_outside_of_reading():
    told = []
    with watched(lambda file, done: told.append(done)):
        tell(1, 2)
    assert told == []
