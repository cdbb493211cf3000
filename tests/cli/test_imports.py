"""A refusal imports nothing that it does not use."""

import subprocess
import sys
from pathlib import Path

import pytest

SLOW = {"scipy.stats", "scipy.signal", "scipy.interpolate", "jinja2", "matplotlib", "rich"}
"""Modules that take longer to import than a short log takes to identify, or draw pictures."""

PROGRAM = """
import sys
from rotorfit.cli.main import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules)
"""


def imported(*arguments: str) -> set[str]:
    """Run a command in a process of its own, and return the modules that it imports."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False
    )
    return set(run.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("identify", "--help"),
        ("identify", "missing.bfl", "--mass", "1", "--airframe", "airframe.toml"),
        ("identify", "missing.bfl", "--mas", "1"),
        ("airframe", "missing.bfl"),
    ],
)
def test_help_and_a_missing_log_need_no_numpy(arguments: tuple[str, ...]) -> None:
    assert imported(*arguments).isdisjoint({"numpy", "scipy", "jinja2", "jaxtyping"})


def test_a_missing_mass_is_refused_without_the_fit(tmp_path: Path) -> None:
    log = tmp_path / "flight.csv"
    log.write_text("time,gyro_x\n0.0,0.1\n0.1,0.1\n")
    found = imported("identify", str(log), "--airframe", "airframe.toml")
    assert found.isdisjoint({"scipy.stats", "scipy.signal", "jinja2", "rotorfit.simulation"})
    assert not any(name.startswith("rotorfit.fit") for name in found)


def test_inspect_refuses_a_missing_log_without_its_checks() -> None:
    found = imported("inspect", "missing.bfl")
    assert found.isdisjoint({"scipy", "rotorfit.tools.inspection", "rotorfit.simulation", "jinja2"})


def test_a_missing_experiment_file_needs_no_numpy() -> None:
    found = imported("identify", "missing.toml")
    assert found.isdisjoint({"numpy", "scipy", "jinja2", "jaxtyping"})


@pytest.mark.parametrize(
    "arguments",
    [
        ("inspect", "flight.csv"),
        ("identify", "flight.csv", "--mass", "1.285", "--airframe", "airframe.toml"),
    ],
)
@pytest.mark.usefixtures("here")
def test_inspect_and_identify_import_only_what_they_use(
    arguments: tuple[str, ...],
) -> None:
    found = imported(*arguments)
    assert "rotorfit.fit.fit" in found
    assert found.isdisjoint(SLOW)


@pytest.mark.usefixtures("here")
def test_airframe_and_settings_load_no_fit_of_the_flight() -> None:
    found = imported("settings", "flight.csv")
    assert "rotorfit.tools.inspection.recording" in found
    assert not any(name.startswith(("rotorfit.fit", "rotorfit.tools.planning")) for name in found)
    found = imported("airframe", "flight.csv", "-o", "new.toml")
    assert "rotorfit.tools.inspection.flown_part" in found
    assert found.isdisjoint(
        {"rotorfit.tools.inspection.prospects", "rotorfit.tools.planning.next_step"}
    )
