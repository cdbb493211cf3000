"""Short simulated flights as files, and the command line in process."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.common import without_progress
from command_line import AIRFRAME, EXPERIMENT, Columns, Outcome, called

from rotorfit.logs.table import write_table
from rotorfit.simulation import (
    Scenario,
    SimulatedFlight,
    flight_table,
    paper_vehicle,
    simulate_flight,
    variant,
)
from shared_work import shared_bandwidths as shared_bandwidths
from shared_work import shared_experiments as shared_experiments
from shared_work import shared_manoeuvres as shared_manoeuvres


@pytest.fixture
def run(capsys, monkeypatch) -> Callable[..., Outcome]:
    """Call the command line in process, on a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")

    def outcome(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = called(*arguments)
        printed = capsys.readouterr()
        return Outcome(code, printed.out, without_progress(printed.err))

    return outcome


@pytest.fixture
def refused(run) -> Callable[..., str]:
    """Call the command line, which must refuse properly, and return its one line."""

    def message(*arguments: object) -> str:
        # Where all tests run, others write what they compile.
        if Path("pyproject.toml").exists():
            pytest.fail("change to a folder of the test first")
        before = sorted(Path.cwd().rglob("*"))
        ended = run(*arguments)
        assert ended.code == 1, ended
        assert ended.out == ""
        assert ended.err.startswith("rotorfit: ")
        assert ended.err.count("\n") == 1 and ended.err.endswith("\n")
        assert "Traceback" not in ended.err and "internal error" not in ended.err
        assert sorted(Path.cwd().rglob("*")) == before
        return ended.err

    return message


@pytest.fixture(scope="session")
def simulated() -> SimulatedFlight:
    """A short real-looking flight from the ground and back."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=14.0, ground_seconds=3.0, sensors=sensors)
    return simulate_flight(truth, vehicle, scenario, seed=1)


@pytest.fixture(scope="session")
def columns(simulated) -> Columns:
    """The flight by the names of a flight table."""
    channels = ("gyro", "accel", "rotor_speed", "command")
    text = flight_table(simulated, channels=channels).splitlines()
    numbers = np.loadtxt(text[1:], delimiter=",")
    return dict(zip(text[0].split(","), numbers.T, strict=True))


@pytest.fixture(scope="session")
def table_text(simulated) -> str:
    return flight_table(simulated, channels=("gyro", "accel", "rotor_speed"))


@pytest.fixture
def here(tmp_path, monkeypatch, table_text) -> Path:
    """A working directory with flight.csv, airframe.toml and experiment.toml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.csv").write_text(table_text)
    (tmp_path / "airframe.toml").write_text(AIRFRAME)
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    return tmp_path


@pytest.fixture
def changed(here, columns) -> Callable[[Callable[[Columns], Columns]], Path]:
    """Write flight.csv anew, with what a function makes of its columns."""

    def write(change: Callable[[Columns], Columns]) -> Path:
        write_table(here / "flight.csv", change(dict(columns)), force=True)
        return here / "flight.csv"

    return write
