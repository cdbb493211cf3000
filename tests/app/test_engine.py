"""The page's engine: files, form, identification and exports, without a server."""

import json
import os
import re
from pathlib import Path
from typing import get_args

import pytest
from served import FORM, dropped, quiet

from rotorfit.app.engine import Engine
from rotorfit.app.files import MOST_FILES, receive
from rotorfit.errors import OutputError
from rotorfit.export.targets import OFFERED, AnyTargetName
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.model.vehicle import LAYOUTS
from rotorfit.tools.planning.next_step import advise_flights

DATA = Path(os.environ.get("ROTORFIT_DATA") or Path(__file__).parents[3] / "shared" / "data")


@pytest.fixture(scope="module")
def identified(tmp_path_factory, flight):
    """An engine that has identified the short flight, and its outcome."""
    folder = tmp_path_factory.mktemp("page")
    engine = Engine(folder=folder)
    said = dropped(engine, "flight.csv", flight)
    steps: list[tuple[str, float | None]] = []
    outcome = engine.call("identify", {"form": FORM}, lambda *step: steps.append(step))
    assert "refused" not in outcome, outcome
    return engine, said, outcome, steps


def test_the_result_is_exactly_that_of_the_command_line(identified, tmp_path, flight):
    engine, _, outcome, _ = identified
    (tmp_path / "flight.csv").write_bytes(flight)
    (tmp_path / "experiment.toml").write_text(outcome["experiment"])
    written = load_experiment(tmp_path / "experiment.toml")
    result = json.loads(identify(written, adviser=advise_flights).to_json())
    for part in ("parameters", "derived", "covariance", "flights", "warnings", "diagnostics"):
        assert outcome["result"][part] == result[part]
    kt = next(p["value"] for p in result["parameters"] if p["name"] == "kt")
    shown = {row["name"]: row for table in outcome["tables"] for row in table["rows"]}
    assert shown["kt"]["value"] == kt
    assert json.loads((engine.folder / "result.json").read_text()) == outcome["result"]


def test_nothing_shows_where_the_files_are_kept(identified):
    engine, said, outcome, steps = identified
    everything = json.dumps([said, outcome, steps, engine.call("restore", {}, quiet)])
    for document in ("report", "result", "experiment"):
        everything += engine.document(document).read_text()
    everything += engine.document("findings", "flight.csv").read_text()
    assert str(engine.folder) not in everything
    kept = next((engine.folder / "files").glob("*.log"))
    assert kept.stem not in everything
    assert "flight.csv" in everything


def test_the_doctor_fills_the_form(identified):
    _, said, _, steps = identified
    assert (said["kind"], said["name"], said["logs"]) == ("log", "flight.csv", [])
    found = said["findings"]
    assert (found["rotors"], found["guess"]["speed"]) == (4, "measured")
    assert found["verdict"]["level"] in ("good", "fair", "poor")
    assert found["verdict"]["words"].startswith("This flight ")
    titles = [section["title"] for section in found["sections"]]
    assert titles == ["Flight", "What this flight can show", "Next step"]
    assert ("reading flight.csv", 1.0) in steps


def test_a_new_page_has_what_was_done(identified):
    engine, said, outcome, _ = identified
    kept = engine.call("restore", {}, quiet)
    assert kept["files"] == [said]
    assert kept["form"] == FORM
    assert kept["outcome"] == outcome


def test_the_loop_of_a_log_without_controller_is_one_sentence(identified, assert_wording):
    engine, _, outcome, _ = identified
    loop = outcome["loop"]
    assert (loop["flight"], loop["page"], len(loop["words"])) == ("flight.csv", False, 1)
    assert_wording(loop["words"][0])
    assert engine.document("loop") is None


def test_the_loop_of_a_log_of_px4_has_a_page(engine, assert_wording):
    log = DATA / "autopilot-sitl" / "px4-heavy-recommended.ulg"
    if not log.exists():
        pytest.skip(f"no real logs: {log} is absent")
    dropped(engine, "flight.ulg", log.read_bytes())
    places = (("ccw", 1, -1), ("ccw", -1, 1), ("cw", 1, 1), ("cw", -1, -1))
    rotors = [{"position": [0.21 * x, 0.28 * y, 0.0], "spin": spin} for spin, x, y in places]
    form = {
        "airframe": {"rotors": rotors},
        "motors": {"speed": "commanded"},
        "configuration": [{"name": "A", "mass": 3.2, "flights": [{"file": "flight.ulg"}]}],
    }
    loop = engine.call("identify", {"form": form}, quiet)["loop"]
    assert loop["page"] is True
    assert_wording(loop["words"][0])
    page = engine.document("loop").read_text()
    assert "Predicted and measured" in page
    assert str(engine.folder) not in page + str(loop)


def test_an_export_asks_for_what_is_missing(identified):
    engine, _, _, _ = identified
    refused = engine.call("export", {"target": "mujoco"}, quiet)
    assert "or supply com_z, " in refused["refused"]
    units = {one["name"]: one["unit"] for one in refused["missing"]}
    assert units["motor_lag"] == "s"
    inertia = {"Ixx_com": 0.018, "Iyy_com": 0.018, "Izz_com": 0.029}
    own = {"motor_lag": 0.03, "max_speed": 1500.0, "kd": 5e-8, "Jr": 1e-5, **inertia}
    assume = {name: own.get(name, 0.0) for name in units}
    made = engine.call("export", {"target": "mujoco", "assume": assume}, quiet)
    assert made["name"] == "mujoco.xml"
    assert "<mujoco" in made["text"]
    [assumed] = [note for note in made["notes"] if note.endswith(" are assumed")]
    assert "motor_lag = 0.03 s" in assumed


def test_exports_without_sense_are_refused(identified):
    engine, _, _, _ = identified
    wrong = engine.call("export", {"target": "px4", "assume": {"max_speed": -1}}, quiet)
    assert "above 0" in wrong["refused"]
    assert "targets: " in engine.call("export", {"target": "nothing"}, quiet)["refused"]


def test_every_layout_and_target_is_offered(engine):
    offered = engine.call("options", {}, quiet)
    assert [(one["layout"], one["order"]) for one in offered["layouts"]] == list(LAYOUTS)
    assert set(OFFERED) == set(get_args(AnyTargetName)) - {"table"}
    assert {one["target"] for one in offered["targets"]} == set(OFFERED)


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ({"airframe": {"layout": "quad-x"}}, "airframe", "spacing"),
        ({"airframe": {"layout": "quad-y", "arm": 0.2}}, "airframe", "no layout 'quad-y'"),
        ({"airframe": {"rotors": []}}, "airframe", "0 rotors"),
        ({"configuration": []}, "configuration", "too few"),
        ({"configuration": [{"flights": []}]}, "configuration[0].mass", "missing"),
        (
            {"configuration": [{"mass": "1.2", "flights": [{"file": "a"}]}]},
            "configuration[0].mass",
            "'1.2'",
        ),
        (
            {"configuration": [{"mass": 1, "flights": [{"file": "a.bfl"}]}]},
            "configuration[0].flights[0].file",
            "no file a.bfl is on the page",
        ),
        ({"colour": "red"}, "colour", "unknown key"),
        ({"motors": {"result": "../other.json"}}, "motors.result", "no file other.json"),
        ({"motors": 7}, "motors", "table"),
        ({"configuration": "A"}, "configuration", "list"),
        ({"configuration": [7, None]}, "configuration[0]", "table"),
    ],
)
def test_what_is_wrong_has_its_place(engine, change, place, words):
    said = engine.call("describe", {"form": {**FORM, **change}}, quiet)
    assert said["text"] is None
    problems = {problem["place"]: problem["words"] for problem in said["problems"]}
    assert words in problems[place]
    assert (said["rotors"] is None) == ("airframe" in change)
    assert engine.call("restore", {}, quiet)["form"] == {**FORM, **change}


def test_the_file_of_the_form_is_what_the_command_line_reads(engine, flight, tmp_path, assert_text):
    dropped(engine, "flight.csv", flight)
    configuration = {**FORM["configuration"][0], "validation": [{"file": "flight.csv", "log": 1}]}
    said = engine.call("describe", {"form": {**FORM, "configuration": [configuration]}}, quiet)
    assert said["problems"] == []
    assert [rotor["spin"] for rotor in said["rotors"]] == ["ccw", "ccw", "cw", "cw"]
    (tmp_path / "experiment.toml").write_text(said["text"])
    experiment = load_experiment(tmp_path / "experiment.toml")
    assert experiment.airframe.arm == 0.2
    assert experiment.configuration[0].validation[0].log == 1
    again = dropped(engine, "my experiment.toml", said["text"].encode())
    assert again["kind"] == "experiment"
    assert again["form"] == {**FORM, "configuration": [configuration]}
    assert_text(again["words"])


@pytest.mark.parametrize(
    ("name", "content", "kind", "words"),
    [
        (
            "a.bfl",
            b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n",
            "other",
            "a.bfl",
        ),
        ("b.ulg", b"ULog\x01\x12\x35" + bytes(9), "other", "b.ulg"),
        ("c.toml", b"airframe = [", "other", "c.toml is not valid TOML"),
        ("d.toml", b'motors = { result = "/etc/passwd" }\n', "other", "airframe is missing"),
        ("e.json", b'{"candidates": []}', "other", "e.json"),
        ("f.json", b'{"parameters": [], "covariance": {}}', "result", "motors' law"),
        ("g.csv", b"time,nothing\n0,1\n", "other", "g.csv"),
        ("h.bin", b"", "other", "empty"),
        ("i.png", b"\x89PNG\r\n\x1a\n" + bytes(99), "other", "i.png"),
    ],
)
def test_what_is_no_log_is_reported_in_one_line(engine, name, content, kind, words):
    said = dropped(engine, name, content)
    assert said["kind"] == kind
    assert len(said["words"]) == 1 and "\n" not in said["words"][0]
    assert words in said["words"][0]
    assert str(engine.folder) not in said["words"][0]
    refused = engine.call("identify", {"form": {**FORM, "configuration": [
        {"mass": 1, "flights": [{"file": name}]}]}}, quiet)  # fmt: skip
    assert "\n" not in refused["refused"]
    assert refused["problems"][0]["place"] == "configuration[0].flights[0].file"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("../../x.csv", "x.csv"),
        ("/etc/passwd", "passwd"),
        ("C:\\logs\\LOG1.BFL", "LOG1.BFL"),
        ("a\x00b.csv", "ab.csv"),
        ("..", "flight"),
        ("", "flight"),
        ("\u202egnp.bfl", "gnp.bfl"),
        ("Flug über Köln 飛行.csv", "Flug über Köln 飛行.csv"),
        ("x" * 500 + ".csv", "x" * 108 + ".csv"),
    ],
)
def test_a_name_is_only_shown(engine, name, shown):
    own, path = engine.receive(name)
    assert own == shown
    assert path.parent == engine.folder / "files"
    assert re.fullmatch(r"[0-9a-f]{16}\.log", path.name)


def test_two_files_of_one_name_are_two(engine):
    assert [engine.receive("LOG.BFL")[0] for _ in range(3)] == ["LOG.BFL", "LOG-2.BFL", "LOG-3.BFL"]
    engine.call("remove_file", {"name": "LOG.BFL"}, quiet)
    assert engine.receive("LOG.BFL")[0] == "LOG.BFL"


def test_there_is_an_end_to_files(engine):
    for _ in range(MOST_FILES):
        receive(engine.folder, "a")
    with pytest.raises(OutputError, match="remove some first"):
        receive(engine.folder, "a")


@pytest.mark.parametrize(
    ("name", "argument"),
    [("look", {}), ("look", {"name": ["a"]}), ("describe", {"form": 7}), ("identify", {}),
     ("plan", {"form": {"airframe": 3}}), ("export", {}), ("remove_file", {"name": None})],
)  # fmt: skip
def test_calls_without_sense_are_refused_in_one_line(engine, name, argument):
    refused = engine.call(name, argument, quiet)["refused"]
    assert "\n" not in refused
    assert refused


def test_no_document_but_the_known_ones(engine):
    for kind in ("../form", "form.json", "", "report"):
        assert engine.document(kind) is None
