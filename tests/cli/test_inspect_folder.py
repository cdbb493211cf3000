"""inspect DIR looks at the logs of a folder; printed commands name the log of several."""

import pytest

from flown import simulated
from rotorfit.cli.inspect import _logs_in as logs_in
from rotorfit.simulation import write_flight_table
from rotorfit.tools.inspection.inspect_log import LogReport


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("logs")
    flight = simulated("quad-x", "noisy", seed=3, seconds=2.0)
    (made / "b.bin").write_bytes(b"\xa3\x95\x80" + bytes(86))
    write_flight_table(flight, made / "a.csv")
    (made / "notes.txt").write_text("wind, 3\nsun, 1\n")
    (made / ".hidden.csv").write_text("time,gyro_x\n0,1\n")
    (made / "inner").mkdir()
    return made


def test_the_logs_of_a_folder_by_name(folder):
    assert [path.name for path in logs_in(folder)] == ["a.csv", "b.bin"]


def test_a_folder_without_logs_and_a_file_stay(folder):
    assert logs_in(folder / "inner") == [folder / "inner"]
    assert logs_in(folder / "notes.txt") == [folder / "notes.txt"]


@pytest.mark.parametrize(
    ("file", "log", "words"),
    [
        ("a.bin", "1 of 1", "a.bin"),
        ("btfl_all.bbl", "4 of 7", "btfl_all.bbl --log 4"),
        ("my log.bbl", "2 of 2", "'my log.bbl' --log 2"),
    ],
)
def test_a_log_as_commands_take_it(file, log, words):
    report = LogReport(file=file, format="", log=log, seconds=0.0, channels=())
    assert report.as_argument == words
