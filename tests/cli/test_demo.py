"""The demo: files that a user could have written, numbers that hold, a truth nobody reads."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rotorfit.identification.result import IdentificationResult

PROGRAM = Path(sys.executable).with_name("rotorfit")


def demonstrated(folder: Path, seed: int) -> str:
    """Fly the demo into a folder and return what it printed."""
    ended = subprocess.run(
        [PROGRAM, "demo", "-o", folder, "--seed", str(seed)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr and str(folder) in ended.stderr
    return ended.stdout


def held(printed: str) -> list[bool]:
    """Return for every number that is shown beside its truth whether its interval holds it."""
    rows = [re.search(r"\+-.*?\b(yes|NO)\b", line) for line in printed.splitlines()]
    return [row.group(1) == "yes" for row in rows if row]


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    return folder, demonstrated(folder, 1)


def test_files(demo):
    folder, _ = demo
    names = {path.name for path in folder.iterdir()}
    assert {"experiment.toml", "truth.json", "result.json"} < names
    assert any(name.endswith(".csv") for name in names)
    assert "truth" not in (folder / "experiment.toml").read_text()
    result = IdentificationResult.load(folder / "result.json")
    assert result.parameter("kt").value == pytest.approx(3.63e-6, rel=0.05)


def test_most_intervals_hold_the_truth(demo):
    _, printed = demo
    inside = held(printed)
    assert len(inside) >= 6
    assert sum(inside) >= 0.8 * len(inside), printed
    assert all(len(line) <= 100 for line in printed.splitlines())


def test_identify_gives_the_same_without_the_truth(run, demo):
    folder, _ = demo
    stored = json.loads((folder / "result.json").read_text())
    (folder / "truth.json").unlink(missing_ok=True)
    ended = run("identify", folder / "experiment.toml", "--json")
    assert (ended.code, ended.err) == (0, "")
    assert ended.json == stored


@pytest.mark.slow
def test_five_seeds_hold_nine_tenths(tmp_path):
    inside = [held(demonstrated(tmp_path / str(seed), seed)) for seed in range(1, 6)]
    flat = [one for seed in inside for one in seed]
    assert sum(flat) >= 0.9 * len(flat), inside
