"""rotorfit fly: screen, page, JSON and refusals as a user meets them."""

import json
import re
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from rotorfit.cli import fly
from rotorfit.export.vehicle_model import vehicle_model

sys.path.append(str(Path(__file__).parents[1] / "export"))
from export_material import UNKNOWN, a_result, changed, parameter

needs_mujoco = pytest.mark.skipif(find_spec("mujoco") is None, reason="mujoco is not installed")
GIVEN = ("kd=5.11e-8", "com_z=0", "Ixx_com=0.018", "Ixy_com=0", "Ixz_com=0", "Iyz_com=0")
KNOWN = tuple(word for given in GIVEN for word in ("--assume", given))
BENCH = ("--bench", "Ixx_com=0.036", "--bench", "kt=3.6e-6")


@pytest.fixture(scope="module")
def identified(tmp_path_factory, table_text):
    """A folder with a flight and its result, in which kd is known only together with Izz."""
    from command_line import EXPERIMENT, called

    folder = tmp_path_factory.mktemp("fly")
    (folder / "flight.csv").write_text(table_text)
    (folder / "experiment.toml").write_text(EXPERIMENT)
    made = called("identify", folder / "experiment.toml", "-o", folder / "result.json")
    assert made == 0
    return folder


@pytest.fixture
def there(identified, tmp_path, monkeypatch):
    """A working directory of one's own, whose result names the flight in the common folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "result.json").write_bytes((identified / "result.json").read_bytes())
    return tmp_path


@needs_mujoco
def test_the_screen(run, there, assert_wording):
    ended = run("fly", "result.json", *KNOWN, *BENCH)
    assert (ended.code, ended.err) == (0, "")
    lines = ended.out.splitlines()
    assert "of 0.5 s" in lines[0]
    assert_wording(lines[0])
    labels = [line[2:20].strip() for line in lines if line.startswith("  ")]
    assert labels.count("identified") == labels.count("bench") == 2
    steps = [line.split() for line in lines if line.startswith(("  hover", "  roll 0.25 rad"))]
    assert [words.count("m") for words in steps] == [2, 0]
    assert [words.count("in") for words in steps] == [0, 2]
    assert max(map(len, lines)) <= 80
    assert any("after 0.5 s:" in line for line in lines)
    assert_wording(lines)
    words = " ".join(ended.out.split())
    assert "kd = 5.11e-08 N" in words
    assert "m s^2/rad^2 are" in words
    assert_wording(words)
    assert_wording(ended.out)
    assert "Ixx_com=0.036, kt=3.6e-06; all" in ended.out


@needs_mujoco
def test_json_page_and_figures(run, there):
    ended = run(
        *("fly", "result.json", *KNOWN, *BENCH, "--json", "-o", "fly.json"),
        *("--report", "fly.html", "--figures", "figures"),
    )
    assert ended.code == 0
    told = ended.json
    assert told == json.loads((there / "fly.json").read_text())
    end = told["rate_errors"][-1]
    assert end["seconds"] == pytest.approx(0.5)
    # Twice the inertia, and the replay of this very flight says so.
    assert end["rms"]["bench"]["roll"] > 1.5 * end["rms"]["identified"]["roll"]
    assert end["identified_over"]["bench"]["roll"] < 0.67
    assert end["rms"]["identified"]["roll"] < end["rms"]["constant rate"]["roll"]
    assert end["band"]["roll"] > 0.0
    assert told["draws"] == fly.DRAWS
    assert told["flights"][0]["flight"] == "flight.csv"
    assert told["manoeuvres"]["identified"]["hover"]["height_off_m"] < 0.1
    assert told["manoeuvres"]["identified"]["roll"]["settling_time_s"] < 0.7
    page = (there / "fly.html").read_text()
    assert page.count("<svg class=") + page.count('<svg viewBox="0 0 920') >= 3
    assert "does it fly?" in page
    assert "http:" not in page and "https:" not in page
    names = {path.name for path in (there / "figures").iterdir()}
    assert set(fly.FIGURES) <= names


def test_against_another_result(run, there, assert_wording):
    (there / "same.json").write_bytes((there / "result.json").read_bytes())
    # It lacks kd as well: the assumed number stands for both.
    same = run("fly", "result.json", *KNOWN, "--against", "same.json", "--json").json
    assert same["rate_errors"][-1]["identified_over"]["same"]["yaw"] == 1.0
    changed(a_result(), Iyy_com=UNKNOWN).save(there / "lacking.json")
    words = run("fly", "result.json", *KNOWN, "--against", "lacking.json").err
    assert_wording(words)
    a_result().save(there / "other.json")
    ended = run("fly", "result.json", *KNOWN, "--against", "other.json")
    assert ended.code == 0
    assert "after 0.5 s" in ended.out
    assert_wording(ended.out)


def test_another_flight_is_replayed_instead(run, refused, there, identified):
    moved = there / "moved.csv"
    moved.write_bytes((identified / "flight.csv").read_bytes())
    assert "of moved.csv" in run("fly", "result.json", *KNOWN, "--flight", "moved.csv").out
    assert "nowhere.csv" in refused("fly", "result.json", *KNOWN, "--flight", "nowhere.csv")


def test_thrust_is_compared_where_the_turns_cannot_be_replayed(run, refused, there):
    ended = run("fly", "result.json")
    assert ended.code == 0
    assert "cannot be replayed: " in ended.err
    # Products of inertia and the places of a hover are done without.
    flags = "--assume com_z=VALUE --assume Izz_com=VALUE --assume kd=VALUE"
    assert flags in ended.err
    [(thrust, yaw)] = re.findall(r"^  flight\.csv  A +(\S+) .* (\S+)$", ended.out, re.M)
    assert 0.0 < float(thrust) < 5.0
    assert yaw == "-"
    assert "Does it fly as flown?" in ended.out
    assert flags in refused("fly", "result.json", "--json")
    assert flags in refused("fly", "result.json", *BENCH)


def elsewhere(there, change):
    """Write the result as if its flight lay in this folder."""
    text = (there / "result.json").read_text()
    data = json.loads(text)
    old = data["settings"]["configuration"][0]["flights"][0]["file"]
    new = str(there / "flight.csv")
    (there / "result.json").write_text(text.replace(json.dumps(old)[1:-1], json.dumps(new)[1:-1]))
    return change(Path(old), Path(new))


def test_a_flight_that_is_gone(refused, there, assert_wording):
    elsewhere(there, lambda old, new: None)
    words = refused("fly", "result.json", *KNOWN)
    assert_wording(words)
    assert "--flight" in words


def test_a_flight_that_has_changed(refused, there, assert_wording):
    def shortened(old, new):
        new.write_text("\n".join(old.read_text().splitlines()[:-40]) + "\n")

    elsewhere(there, shortened)
    words = refused("fly", "result.json", *KNOWN)
    assert_wording(words)


def test_commands_without_a_law_take_nothing_per_rad_s(refused, there, assert_wording):
    result = a_result(law=None).to_json().replace('"measured"', '"commanded"')
    result = result.replace('"N s^2/rad^2"', '"N per squared command"')
    (there / "commands.json").write_text(result)
    words = refused("fly", "commands.json", "--assume", "kd=1e-8", "--assume", "max_speed=900")
    assert_wording(words)


def test_other_vehicles_are_refused(refused, there, assert_wording):
    six = [((0.2, 0.1 * i, 0.0), "ccw" if i % 2 else "cw") for i in range(6)]
    a_result(rotors=six).save(there / "six.json")
    words = refused("fly", "result.json", *KNOWN, "--against", "six.json")
    assert "has 6 rotors," in words
    assert "result 4" in words
    assert_wording(words)


def test_without_mujoco_the_flights_are_replayed(run, there, monkeypatch, assert_wording):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    ended = run(
        *("fly", "result.json", *KNOWN, *BENCH, "-o", "fly.json"),
        *("--report", "fly.html", "--figures", "figures"),
    )
    assert ended.code == 0
    assert "after 0.5 s:" in ended.out
    assert_wording(ended.out)
    assert "In MuJoCo" not in ended.out
    words = " ".join(ended.out.split())
    assert_wording(words)
    assert "motors' lag is not known" not in words  # nothing was taken for it
    told = json.loads((there / "fly.json").read_text())
    assert told["manoeuvres"] == {}
    assert told["rate_errors"][-1]["rms"]["identified"]["roll"] > 0.0
    page = (there / "fly.html").read_text()
    assert "The model in MuJoCo" not in page and "How the error grows" in page
    names = {path.name for path in (there / "figures").iterdir()}
    assert "replay-errors.svg" in names and "manoeuvres.svg" not in names


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--bench", "Ixx"), "write NAME=VALUE"),
        (("--bench", "Ixxx=3"), "did you mean Ixx"),
        (("-o", "same.html", "--report", "same.html"), "name the same file"),
    ],
)
def test_wrong_usage(run, there, options, words):
    ended = run("fly", "result.json", *options)
    assert ended.code == 2
    assert words in " ".join(ended.err.split()).replace("│ ", "")


def test_nothing_is_overwritten(refused, there):
    (there / "fly.html").write_text("mine")
    assert "fly.html exists" in refused("fly", "result.json", *KNOWN, "--report", "fly.html")
    assert "is an input" in refused("fly", "result.json", *KNOWN, "-o", "result.json", "--force")


def test_terms_of_the_replay_are_not_said_to_be_missing_from_it(assert_wording):
    term = parameter("twist", 1.2e-5, "A")
    drag = parameter("drag_x", 0.1, "A")
    result = replace(a_result(), parameters=(*a_result().parameters, term, drag))
    notes = fly.replay_notes(result, vehicle_model(result), {})
    assert any("twist = (1.200" in note for note in notes)
    assert_wording(notes)
    assert not any("has no place for" in note for note in notes)
