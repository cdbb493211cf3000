"""Real logs, skipped where they are not."""

from collections.abc import Callable
from pathlib import Path

import pytest

import flown
from rotorfit.model.vehicle import Vehicle
from rotorfit.results.result import IdentificationResult


@pytest.fixture(scope="session")
def indiflight_logs(flight_data_dir) -> Path:
    folder = flight_data_dir / "tudelft-indiflight"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    return folder


@pytest.fixture(scope="session")
def on_commands(flight_data_dir, tmp_path_factory) -> Callable[..., IdentificationResult]:
    """Identify one log by its commands."""

    def result(name: str, vehicle: Vehicle, *, mass: float | str) -> IdentificationResult:
        log = flight_data_dir / name
        if not log.is_file():
            pytest.skip(f"no {log}")
        path = tmp_path_factory.mktemp("on_commands") / "experiment.toml"
        commands = '[motors]\nspeed = "commanded"\n'
        flown.experiment_file(path, vehicle, [log], mass=mass, extra=commands)
        return flown.quietly_identified(path)

    return result
