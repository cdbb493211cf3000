"""The engine as a web worker calls it, and the site's copy of the page that runs it there."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from served import quiet

from rotorfit.app import in_browser
from rotorfit.app.engine import CALLS

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))
from page_site import write_page  # noqa: E402

DATA = (".toml", ".j2", ".html", ".xml", ".sdf", ".urdf", ".txt", ".md", ".css")
"""What rotorfit reads beside its modules."""


class Sent:
    """An array of JavaScript, as far as Python sees it."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def to_bytes(self) -> bytes:
        return self._content


@pytest.fixture
def call(tmp_path):
    def answer(name: str, argument: dict, sent: bytes | None = None) -> dict:
        given = None if sent is None else Sent(sent)
        folder = tmp_path / "page"
        text = in_browser.call(
            name, json.dumps(argument), quiet, given, folder=folder, most_bytes=1000
        )
        return json.loads(text)

    return answer


def test_files_come_and_go(call):
    said = call("add_file", {"name": "../a.toml"}, b"[airframe]\nlayout = 'quad-x'\narm = 0.1\n")
    assert (said["name"], said["kind"]) == ("a.toml", "airframe")
    assert said["form"] == {"airframe": {"layout": "quad-x", "arm": 0.1}}
    assert call("restore", {})["files"] == [said]
    assert call("remove_file", {"name": "a.toml"}) == {}
    assert call("restore", {})["files"] == []


def test_a_table_is_read_by_given_columns(tmp_path, unknown_table):
    def answer(name: str, argument: dict, sent: Sent | None = None) -> dict:
        folder = tmp_path / "page"
        return json.loads(in_browser.call(name, json.dumps(argument), quiet, sent, folder=folder))

    told = answer("add_file", {"name": "own.csv"}, Sent(unknown_table))
    assert [one["channel"] for one in told["table"]["questions"]] == ["gyro", "motors"]
    answers = {"named": {}, "units": {"gyro": "rad/s", "motors": "rad/s"}, "axes": None}
    told = answer("look", {"name": "own.csv", "columns": answers})
    assert told["findings"]["rotors"] == 4


def test_documents_come_as_text(call, assert_text):
    refused = call("document", {"kind": "experiment"})
    assert [*refused] == ["refused"]
    assert_text(refused["refused"])
    call("add_file", {"name": "a.csv"}, b"")
    form = {
        "airframe": {"layout": "quad-x", "arm": 0.1},
        "configuration": [{"mass": 1, "flights": [{"file": "b.csv"}]}],
    }
    said = call("describe", {"form": form})
    assert [problem["place"] for problem in said["problems"]] == [
        "configuration[0].flights[0].file"
    ]
    call("add_file", {"name": "b.csv"}, b"")
    said = call("describe", {"form": form})
    assert_text(said["problems"][0]["words"])


def test_more_than_the_browser_holds_is_refused(call):
    refused = call("add_file", {"name": "a.bin"}, bytes(1001))["refused"]
    assert "rotorfit app takes more" in refused
    assert call("restore", {})["files"] == []


def test_calls_of_a_server_alone_are_refused(call):
    assert call("follow", {}) == {"refused": "no call 'follow' here"}
    assert "follow" not in CALLS


def test_the_site_has_all_that_the_page_runs(tmp_path):
    (tmp_path / "pyodide").mkdir()
    (tmp_path / "pyodide" / "pyodide.js").write_text("")
    write_page(tmp_path / "app", tmp_path / "pyodide")
    settings = json.loads((tmp_path / "app" / "engine.json").read_text())
    assert settings["engine"] == "worker"
    assert (tmp_path / "app" / settings["pyodide"] / "pyodide.js").exists()
    for name in ("engine.js", "worker.js", *settings["archives"]):
        assert (tmp_path / "app" / name).stat().st_size > 0
    # Unpacked as the worker does it; from there alone, without what is installed of rotorfit.
    unpacked = tmp_path / "unpacked"
    with zipfile.ZipFile(tmp_path / "app" / settings["archives"][0]) as archive:
        archive.extractall(unpacked)
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import rotorfit.app.in_browser as b; "
        "print(b.__file__); import jaxtyping; print(jaxtyping.__file__)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, str(unpacked)], capture_output=True, text=True, check=True
    )
    assert all(line.startswith(str(unpacked)) for line in ended.stdout.splitlines())
    package = Path(in_browser.__file__).parents[1]
    data = {path.relative_to(package) for path in package.rglob("*") if path.suffix in DATA}
    own = {path for path in data if path.parts[:2] != ("app", "static")}
    assert len(own) > 20
    assert [path for path in sorted(own) if not (unpacked / "rotorfit" / path).exists()] == []


def test_a_site_without_pyodide_says_so(tmp_path):
    write_page(tmp_path / "app", None)
    assert json.loads((tmp_path / "app" / "engine.json").read_text())["pyodide"] is None
