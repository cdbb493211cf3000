"""The demo: the paper's experiment, files that identify reads, numbers that hold.

What README.md and the first page of the documentation show of it is what it makes; both are
rewritten by  pytest --update-golden tests/cli/test_demo.py
"""

import io
import json
import re
import runpy
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from command_line import called

from rotorfit.cli import demo as demo_command
from rotorfit.fit.experiment.experiment import Experiment, load_experiment
from rotorfit.results.result import IdentificationResult

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PICTURE = ROOT / "docs" / "pictures" / "intervals.svg"
SHOWN = re.compile(r"(?<=```text\n) +truth +rotorfit.*?(?=```)", re.S)
FILES = [
    *("A1.csv", "A2.csv", "B1.csv", "B2.csv", "experiment.toml"),
    *("report.html", "result-paper.json", "result.json", "truth.json"),
]


@pytest.fixture(scope="module")
def experiments() -> list[Experiment]:
    """What the demo identified, in the order in which it did."""
    return []


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory, experiments) -> tuple[Path, list[str]]:
    """The folder that demo -o made, and the lines it printed; nothing identified sees the truth."""
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    printed, identify = io.StringIO(), demo_command.identify_quietly

    def identify_without_truth(experiment: Experiment) -> IdentificationResult:
        experiments.append(experiment)
        truth = (folder / "truth.json").read_text()
        (folder / "truth.json").unlink()
        result = identify(experiment)
        (folder / "truth.json").write_text(truth)
        return result

    with redirect_stdout(printed), pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo_command, "identify_quietly", identify_without_truth)
        assert called("demo", "-o", folder) == 0
    return folder, printed.getvalue().splitlines()


def test_files(demonstrated):
    folder, _ = demonstrated
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert (folder / "report.html").read_text().startswith("<!doctype html>")


def test_fits_a_screen(demonstrated):
    _, lines = demonstrated
    assert len(lines) < 44
    assert max(len(line) for line in lines) <= 80


def excerpt(lines: list[str]) -> str:
    """Return the rows that the README shows: the coefficients, and the moments of inertia of A."""
    rows = [line.rstrip() for line in lines]
    wanted = [next(row for row in rows if row.split()[:2] == ["truth", "rotorfit"])]
    for name in ("kt", "kd", "Ixx", "Iyy", "Izz"):
        wanted.append(next(row for row in rows if row.split()[:1] == [name]))
    return "\n".join([*wanted, "  ..."]) + "\n"


def test_the_readme_shows_what_it_prints(demonstrated, request):
    printed = excerpt(demonstrated[1])
    text = README.read_text(encoding="utf-8")
    if request.config.getoption("--update-golden"):
        text = SHOWN.sub(printed.replace("\\", r"\\"), text)
        README.write_text(text, encoding="utf-8", newline="\n")
    assert SHOWN.findall(text) == [printed], "meant so? then  pytest --update-golden"


def test_the_picture_of_the_first_page_is_of_its_numbers(demonstrated, request):
    made = runpy.run_path(str(PICTURE.with_name("make.py")))["picture"](demonstrated[0]) + "\n"
    if request.config.getoption("--update-golden"):
        PICTURE.write_text(made, encoding="utf-8", newline="\n")
    number = re.compile(r"-?\d+\.?\d*")
    shown = PICTURE.read_text(encoding="utf-8")
    assert number.sub("", made) == number.sub("", shown)
    # A fifth of a pixel is a twentieth of a percent of the truth.
    assert [float(x) for x in number.findall(made)] == pytest.approx(
        [float(x) for x in number.findall(shown)], abs=0.2
    ), "meant so? then  pytest --update-golden"


def test_printed_numbers_are_those_of_the_files(demonstrated):
    folder, lines = demonstrated
    truth = json.loads((folder / "truth.json").read_text())["shared"]
    result = IdentificationResult.load(folder / "result.json")
    row = next(line for line in lines if line.split()[:1] == ["kt"])
    words = row.replace("(", " ").replace(")", " ").split()
    assert float(words[1]) == truth["kt"]
    assert float(words[2]) * 1e-6 == pytest.approx(result.parameter("kt").value, rel=1e-3)
    last = lines[-1].split()
    assert last[0] == "B2.csv"
    errors = result.validation[1]["relative_error"]
    assert [float(word) for word in last[1:5]] == pytest.approx(
        [100 * errors[name] for name in ("Fz", "Mx", "My", "Mz")], rel=0.05
    )


def test_intervals_hold_the_truth(demonstrated):
    folder, lines = demonstrated
    truth = json.loads((folder / "truth.json").read_text())
    result = IdentificationResult.load(folder / "result.json")
    held: list[bool] = []
    for name, configuration in [
        ("kt", None),
        ("kd", None),
        *((name, c) for c in "AB" for name in demo_command.BODY),
    ]:
        interval = result.parameter(name, configuration).interval
        own = truth["configurations"][configuration] if configuration else truth["shared"]
        if interval is not None:
            held.append(interval[0] <= own[name] <= interval[1])
    assert len(held) >= 12
    assert sum(held) >= len(held) - 1
    assert f"rotorfit {sum(held)} of {len(held)}, ordinary least squares" in " ".join(lines)


def test_it_identifies_its_own_files_as_the_paper_does_too(demonstrated, experiments):
    written = load_experiment(demonstrated[0] / "experiment.toml")
    ours, as_paper = experiments
    assert ours == written
    assert as_paper.identification.preset == "paper"
    assert as_paper.model_copy(update={"identification": written.identification}) == written


@pytest.mark.slow
def test_takes_seconds_and_holds_at_full_length(run):
    ended = run("demo", "--seed", "2")
    assert ended.code == 0
    ours = [line for line in ended.out.splitlines() if line.rstrip().endswith(("yes", "NO"))]
    assert len(ours) >= 8
