"""How many fits and reductions one identification makes; docs/method.md states them."""

import cProfile
import pstats
from pathlib import Path

import pytest

import flown
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, IMU_AND_SPEED, write_flight_table

MOST_FITS = {"measured": 16, "commanded": 34}
MOST_REDUCTIONS = {"measured": 14, "commanded": 22}


@pytest.mark.parametrize(
    ("channels", "speed"), [(IMU_AND_SPEED, "measured"), (IMU_AND_COMMAND, "commanded")]
)
def test_one_identification_makes_few_fits(tmp_path: Path, channels, speed):
    flight = flown.simulated("A", "real", seed=5, seconds=25.0)
    log = tmp_path / "flight.csv"
    write_flight_table(flight, log, channels=channels)
    path = flown.experiment_file(
        tmp_path / "experiment.toml",
        flight.vehicle,
        [log.relative_to(tmp_path)],
        mass=flight.truth.mass,
        extra=f'[motors]\nspeed = "{speed}"',
    )
    profile = cProfile.Profile()
    profile.runcall(flown.quietly_identified, path)
    calls = {
        name: counts[1]
        for (file, _, name), counts in pstats.Stats(profile).stats.items()
        if "rotorfit" in file and file.endswith(".py")  # not what beartype makes of it
    }
    assert 10 <= calls["banded"] <= MOST_FITS[speed]
    assert 5 <= calls["prepared_lines"] <= MOST_REDUCTIONS[speed]
