"""A refusal imports nothing that it does not use."""

import subprocess
import sys
from pathlib import Path

import pytest

SLOW = {"scipy.stats", "scipy.signal", "scipy.interpolate", "scipy.optimize", "scipy.ndimage"}
SLOW |= {"scipy.spatial", "scipy.fft", "jinja2", "matplotlib", "rich", "jaxtyping"}
"""Modules that take longer to import than a short log takes to identify, draw pictures, or serve
annotations alone."""

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


NNLS = {"scipy.optimize", "scipy.spatial", "scipy.fft"}
"""`scipy.optimize` and what it imports."""
FITTED = ("rotorfit.fit.fit", "rotorfit.fit.joint", "rotorfit.fit.experiment.experiment")
"""Beginnings of modules that an identification needs, and no look at a log."""


@pytest.mark.usefixtures("here")
def test_inspect_imports_neither_the_fit_nor_the_simulator() -> None:
    found = imported("inspect", "flight.csv")
    assert "rotorfit.tools.inspection.prospects" in found
    assert SLOW - found == SLOW
    assert not {n for n in found if n.startswith((*FITTED, "rotorfit.simulation."))}


@pytest.mark.usefixtures("here")
def test_identify_imports_only_what_it_uses() -> None:
    found = imported("identify", "flight.csv", "--mass", "1.285", "--airframe", "airframe.toml")
    assert "rotorfit.fit.fit" in found
    # The residuals of yaw are a sum of terms that cannot be negative: `scipy.optimize.nnls`.
    assert (SLOW - NNLS) - found == SLOW - NNLS
    # The terminal draws no charts.
    assert "rotorfit.report.text" in found
    assert found.isdisjoint({"rotorfit.report.motor_law", "rotorfit.report.chart"})


SAVED = """
import sys
from rotorfit.results import compare, sound_result
from rotorfit.report import budget
print(*sys.modules)
"""


def test_a_saved_result_is_read_without_the_fit() -> None:
    run = subprocess.run([sys.executable, "-c", SAVED], capture_output=True, text=True, check=True)
    found = set(run.stdout.split())
    assert "rotorfit.results.result" in found
    unused = (
        "scipy",
        "jaxtyping",
        "rotorfit.fit.fit",
        "rotorfit.fit.joint",
        "rotorfit.fit.dataset",
    )
    assert not any(name.startswith(unused) for name in found)


@pytest.mark.usefixtures("here")
def test_airframe_and_settings_load_no_fit_of_the_flight() -> None:
    found = imported("settings", "flight.csv")
    assert "rotorfit.tools.inspection.recording" in found
    unused = ("rotorfit.fit", "rotorfit.tools.planning", "scipy")
    assert not any(name.startswith(unused) for name in found)
    found = imported("airframe", "flight.csv", "-o", "new.toml")
    assert "rotorfit.tools.inspection.flown_part" in found
    assert found.isdisjoint(
        {"rotorfit.tools.inspection.prospects", "rotorfit.tools.planning.next_step"}
    )


def test_a_command_imports_no_other() -> None:
    found = imported("why", "missing.json")
    assert {name for name in found if name.startswith("rotorfit.cli.")} == {
        "rotorfit.cli.main",
        "rotorfit.cli.postponed_imports",
        "rotorfit.cli.terminal",
        "rotorfit.cli.why",
    }
