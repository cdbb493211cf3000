"""A short flight as a file, and a server that all tests of this folder share."""

from collections.abc import Iterator

import pytest

pytest.importorskip("starlette", reason="the page needs the extra app")
pytest.importorskip("uvicorn", reason="the page needs the extra app")

from served import MOST, Client, served

from rotorfit.app.engine import Engine
from rotorfit.app.server import Served
from rotorfit.simulation import (
    Scenario,
    flight_table,
    paper_vehicle,
    simulate_flight,
    variant,
)


@pytest.fixture
def engine(tmp_path) -> Engine:
    (tmp_path / "page").mkdir()
    return Engine(folder=tmp_path / "page")


@pytest.fixture(scope="session")
def flight() -> bytes:
    """A short real-looking flight from the ground and back, as a table."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=14.0, ground_seconds=3.0, sensors=sensors)
    flown = simulate_flight(truth, vehicle, scenario, seed=1)
    return flight_table(flown, channels=("gyro", "accel", "rotor_speed")).encode()


@pytest.fixture(scope="session")
def unknown_table(flight) -> bytes:
    """The same flight by names of its own, from which neither gyro nor motors tell their unit."""
    head, _, rows = flight.decode().partition("\n")
    own = {"time": "t", "battery": "vbat"}
    own |= {f"gyro_{a}": f"w{a}" for a in "xyz"} | {f"accel_{a}": f"acc{a.upper()}" for a in "xyz"}
    own |= {f"rotor_{i}": f"m{i}" for i in range(1, 5)}
    return f"{','.join(own.get(name, name) for name in head.split(','))}\n{rows}".encode()


@pytest.fixture(scope="session")
def server() -> Iterator[Served]:
    with served(most_bytes=MOST) as one:
        yield one


@pytest.fixture
def page(server) -> Client:
    """A new page of the server; those that tests before this one have left make room."""
    return Client(server.address).opened()
