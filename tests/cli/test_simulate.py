"""rotorfit simulate: files ready for identify, whole or not at all, nothing overwritten."""

import json
import os
from pathlib import Path

import pytest

from rotorfit.cli.simulate import simulate
from rotorfit.errors import OutputError
from rotorfit.simulation.experiment_files import write_all

FILES = ["A1.csv", "A2.csv", "experiment.toml", "truth.json"]
QUICK = ("simulate", "single", "--seconds", "15", "--variant", "real")


@pytest.fixture(scope="module")
def flown_files(tmp_path_factory):
    """Files of the quick simulation by name."""
    folder = tmp_path_factory.mktemp("simulated")
    simulate("single", folder, seconds=15.0)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def broken_disk(monkeypatch):
    """Let the file of a name fail at the moment in which it is moved to its place."""
    whole = os.replace

    def break_disk(name: str, fault: BaseException) -> None:
        def faulty(source, target, **options):
            if Path(target).name == name:
                raise fault
            whole(source, target, **options)

        monkeypatch.setattr(os, "replace", faulty)
        monkeypatch.setattr(Path, "replace", faulty)

    return break_disk


def test_files_are_ready_for_identify(run, tmp_path, flown_files):
    ended = run(*QUICK, "-o", tmp_path / "new" / "folder")
    assert (ended.code, ended.out.split()[0]) == (0, "wrote")
    folder = tmp_path / "new" / "folder"
    assert ended.err == f"next: rotorfit identify {folder / 'experiment.toml'}\n"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == flown_files
    assert sorted(flown_files) == FILES
    assert run("identify", folder / "experiment.toml", "--json").code == 0


def test_json_lists_the_files(run, tmp_path):
    ended = run(*QUICK, "-o", tmp_path, "--json")
    assert ended.json == {"folder": str(tmp_path), "files": FILES}


def test_nothing_is_overwritten_unless_forced(run, tmp_path, flown_files, assert_wording):
    (tmp_path / "truth.json").write_text("mine")
    ended = run(*QUICK, "-o", tmp_path)
    assert ended.code == 1
    assert_wording(ended.err)
    assert [path.name for path in tmp_path.iterdir()] == ["truth.json"]
    assert run(*QUICK, "-o", tmp_path, "--force").code == 0
    assert (tmp_path / "truth.json").read_bytes() == flown_files["truth.json"]


def test_interrupted_flights_leave_nothing(broken_disk, run, tmp_path):
    broken_disk("A1.csv", KeyboardInterrupt())
    assert run(*QUICK, "-o", tmp_path / "new").code == 130
    assert list(tmp_path.iterdir()) == []


def test_failed_writing_replaces_nothing(broken_disk, tmp_path):
    (tmp_path / "a.csv").write_text("old")
    broken_disk("b.csv", OSError(28, "no space left"))
    with pytest.raises(OutputError, match="no space left"):
        write_all(tmp_path, {"a.csv": "new", "b.csv": "new"})
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.csv": "old"}


def test_truth_has_every_configuration(flown_files):
    truth = json.loads(flown_files["truth.json"])
    assert (truth["scenario"], truth["variant"], truth["seed"]) == ("single", "real", 1)
    assert list(truth["configurations"]) == ["A"]
    assert truth["configurations"]["A"]["mass"] == pytest.approx(1.4)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("simulate", "octopus", "-o", "x"), 2, "octopus"),
        (("simulate", "paper"), 2, "--output"),
        (("simulate", "paper", "-o", "x", "--variant", "wild"), 2, "wild"),
        (("simulate", "paper", "-o", "x", "--seed", "-1"), 2, "seed"),
        (("simulate", "paper", "-o", "x", "--seconds", "3"), 1, "between 15 and 1000 s"),
    ],
)
def test_refusals(run, tmp_path, monkeypatch, arguments, code, words):
    monkeypatch.chdir(tmp_path)
    ended = run(*arguments)
    assert (ended.code, ended.out) == (code, "")
    assert words in ended.err
    assert list(tmp_path.iterdir()) == []
