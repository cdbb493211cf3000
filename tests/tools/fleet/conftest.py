"""A small fleet on disk: two vehicles, two short flights each, and what lies beside logs."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.flown import airframe_table, simulated

from rotorfit.simulation import write_flight_table
from rotorfit.tools.fleet.listing import Defaults, ListedLog, listed_logs
from rotorfit.tools.fleet.run import Fleet, Workers, read_fleet

SECONDS = 8.0


@dataclass(frozen=True, slots=True)
class SmallFleet:
    """Where its logs are, what they are, what was read of them, and where that is kept."""

    folder: Path
    logs: tuple[ListedLog, ...]
    defaults: Defaults
    fleet: Fleet
    cache: Path


@pytest.fixture(scope="session")
def small_fleet(tmp_path_factory) -> SmallFleet:
    folder = tmp_path_factory.mktemp("fleet") / "logs"
    for seed, vehicle in ((10, "one"), (20, "two")):
        (folder / vehicle).mkdir(parents=True)
        for number in (1, 2):
            flight = simulated("A", "real", seed=seed + number, seconds=SECONDS)
            write_flight_table(flight, folder / vehicle / f"flight{number}.csv")
    (folder / "airframe.toml").write_text(
        f'{airframe_table(flight.vehicle)}[motors]\nspeed = "measured"\n', encoding="utf-8"
    )
    shutil.copy(folder / "one" / "flight1.csv", folder / "two" / "flight9.csv")
    (folder / "two" / "empty.bfl").write_bytes(b"")
    (folder / "two" / "notes.csv").write_text("day,weather\n1,2\n3,4\n", encoding="utf-8")
    (folder / "README.md").write_text("Logs of two vehicles.\n", encoding="utf-8")
    defaults = Defaults(mass=flight.truth.mass, airframe=folder / "airframe.toml")
    logs = listed_logs(folder, defaults)
    cache = tmp_path_factory.mktemp("cache")
    return SmallFleet(folder, logs, defaults, read_fleet(logs, cache, Workers(count=0)), cache)
