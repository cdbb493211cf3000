"""The notebooks run from top to bottom, and are kept without their outputs."""

import re
import warnings
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason='notebooks need  pip install "rotorfit[test]"')
nbclient = pytest.importorskip("nbclient", reason='notebooks need  pip install "rotorfit[test]"')

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))


def executed(name: str) -> list[str]:
    """Run a notebook, and return what each of its code cells printed; pictures by their type."""
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(EXAMPLES)}}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the libraries between us and the kernel
        client.execute()
    return [printed(cell) for cell in notebook.cells if cell.cell_type == "code"]


def printed(cell) -> str:
    parts = [out.get("text", "") + " ".join(out.get("data", {})) for out in cell.outputs]
    return "".join(parts)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_outputs_are_not_kept(path):
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert cells
    assert [(c.outputs, c.execution_count) for c in cells] == [([], None)] * len(cells)


def test_tutorial():
    *_, flight, identified, picture, validated, judged, exported = executed("tutorial.ipynb")
    assert "s of it in the air" in flight
    speeds = re.search(r"in the air \[(.*)\] rad/s", flight)
    hover = re.search(r"hover_speed +(\d+)", identified)
    assert speeds and hover
    assert [float(n) for n in speeds[1].split()] == pytest.approx([float(hover[1])] * 4, rel=0.08)
    assert "single-real: 1 flight" in identified and "Izz_com" in identified
    assert "image/svg+xml" in picture
    assert validated.startswith("A2.csv {'Fz'") and "image/svg+xml" in validated
    assert judged.count("true") == 9
    assert judged.count("holds") >= 8  # nine numbers, one in twenty may be missed
    assert "<mujoco" in exported


@pytest.mark.slow
def test_real_log_is_skipped_where_it_is_absent(monkeypatch, tmp_path):
    monkeypatch.setenv("ROTORFIT_DATA", str(tmp_path))
    first, *others = executed("real_log.ipynb")
    assert first.startswith("skipped: no ") and "set ROTORFIT_DATA" in first
    assert [text for text in others if text] == [(EXAMPLES / "cinerat.toml").read_text() + "\n"]


@pytest.mark.flights
@pytest.mark.slow
def test_real_log(monkeypatch, flight_data_dir):
    if not (flight_data_dir / "tudelft-indiflight").is_dir():
        pytest.skip(f"no tudelft-indiflight in {flight_data_dir}")
    monkeypatch.setenv("ROTORFIT_DATA", str(flight_data_dir))
    first, contents, _, identified, picture, bench = executed("real_log.ipynb")
    assert first == ""
    assert contents.startswith("blackbox, ") and "rotor_speed" in contents
    assert "LOG00267: 1 flight" in identified
    assert picture.count("image/svg+xml") == 2
    held = dict(map(within, bench.splitlines()))
    # As the text above these lines says.
    assert {name for name, is_held in held.items() if not is_held} == {"Ixx_com", "kd"}
    assert len(held) == 6


def within(line: str) -> tuple[str, bool]:
    """Return a name, and whether the bench's number lies in the flight's interval."""
    name, _, bench, _, low, _, high = line.split()
    return name, float(low) <= float(bench) <= float(high)
