"""rotorfit export: files, refusals and usage errors as a user meets them."""

import importlib
import json
import os
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
from command_line import AIRFRAME

from rotorfit.cli.export import export
from rotorfit.errors import OutputError
from rotorfit.export.targets import RANDOM_TARGETS, TARGETS
from rotorfit.export.write import columns_of, table_files, write_export
from rotorfit.logs.table import open_parquet
from rotorfit.results.result import IdentificationResult
from rotorfit.results.validation.wrench_comparison import WrenchComparison

sys.path.append(str(Path(__file__).parents[1] / "export"))
from export_material import MASS, YAW_LOST, a_result, changed


@pytest.fixture
def there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    a_result().save(tmp_path / "result.json")
    changed(a_result(), **YAW_LOST).save(tmp_path / "no_yaw.json")
    return tmp_path


def test_the_command_and_the_docs_know_every_target():
    offered = get_args(get_type_hints(export)["target"])
    assert set(offered) == {*TARGETS, *RANDOM_TARGETS, "table"}
    docs = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    first, _, load = docs.partition("## What is never written")
    for target in offered:
        assert f"| `{target}`" in first
        assert f"`{target}`" in load


def test_a_file_is_written_and_reported(run, there):
    ended = run("export", "result.json", "--to", "px4", "-o", "my.params")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines()[0] == "my.params: px4, configuration A"
    assert "CA_ROTOR3_KM" in (there / "my.params").read_text()


def test_an_export_into_a_file_of_the_user_shows_what_changes(run, there, assert_wording):
    mine = "# mine\n1\t1\tSYS_AUTOSTART\t4001\t6\n1\t1\tCA_ROTOR3_KM\t0.5\t9\n"
    (there / "mine.params").write_text(mine)
    asked = ("export", "result.json", "--to", "px4", "--into", "mine.params", "-o")
    ended = run(*asked, "new.params")
    assert (ended.code, ended.err) == (0, "")
    assert "-1\t1\tCA_ROTOR3_KM\t0.5\t9\n  +1\t1\tCA_ROTOR3_KM\t" in ended.out
    assert_wording(ended.out)
    assert "SYS_AUTOSTART" not in ended.out
    assert (there / "new.params").read_text().startswith(mine.partition("0.5")[0])
    assert (there / "mine.params").read_text() == mine
    told = run(*asked, "mine.params", "--force", "--json").json
    assert ["", "1\t1\tCA_AIRFRAME\t0\t6"] in told["changed"]
    assert (there / "mine.params").read_text() == (there / "new.params").read_text()


def test_a_file_to_export_into_is_never_lost(refused, there, assert_text):
    (there / "mine.params").write_text("no parameters")
    asked = ("export", "result.json", "--to", "px4", "--into", "mine.params", "-o", "mine.params")
    assert "--force" in refused(*asked)
    assert_text(refused(*asked, "--force"))
    assert (there / "mine.params").read_text() == "no parameters"
    words = refused("export", "result.json", "--to", "px4", "--into", "none", "-o", "new.params")
    assert words.startswith("rotorfit: none: ")


def test_as_json(run, there):
    told = run("export", "result.json", "--to", "mujoco", "-o", "my.xml", "--json").json
    assert told["target"] == "mujoco"
    assert told["files"] == ["my.xml"]
    mass = next(n for n in told["numbers"] if n["name"] == "mass")
    assert (mass["value"], mass["origin"]) == (MASS, "given")


def test_what_is_not_known_is_refused_in_one_line(refused, there, assert_wording):
    words = refused("export", "no_yaw.json", "--to", "gazebo", "-o", "my.sdf")
    assert_wording(words)
    assert "--assume kd=VALUE" in words


def test_an_assumption_is_reported(run, there, assert_wording):
    asked = ("export", "no_yaw.json", "--to", "gazebo", "-o", "my.sdf", "--assume", "kd=5.2e-8")
    ended = run(*asked)
    assert (ended.code, ended.err) == (0, "")
    assert "kd = 5.2e-08 N" in ended.out
    assert "m s^2/rad^2 is" in ended.out
    assert_wording(ended.out)
    assert "Izz_com = 0.02931 kg" in ended.out
    assert "m^2 is" in ended.out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--assume", "kdd=3"), "did you mean kd?"),
        (("--assume", "kd"), "write NAME=VALUE"),
        (("--assume", "kd=-1"), "it is above 0"),
        (("--to", "unreal"), "unreal"),
    ],
)
def test_wrong_usage(run, there, options, words):
    asked = ("export", "result.json", "--to", "px4", "-o", "my.params", *options)
    ended = run(*asked)
    assert ended.code == 2
    assert words in " ".join(ended.err.split()).replace("│ ", "")
    assert not (there / "my.params").exists()


def test_nothing_is_overwritten_without_force(run, refused, there):
    (there / "my.params").write_text("mine")
    words = refused("export", "result.json", "--to", "px4", "-o", "my.params")
    assert "my.params exists" in words
    assert (there / "my.params").read_text() == "mine"
    assert run("export", "result.json", "--to", "px4", "-o", "my.params", "--force").code == 0
    assert "CA_ROTOR" in (there / "my.params").read_text()


def test_the_result_itself_is_never_the_output(refused, there):
    words = refused("export", "result.json", "--to", "px4", "-o", "result.json", "--force")
    assert "result.json is an input" in words


def test_a_file_that_is_no_result(refused, there):
    (there / "other.json").write_text("{}")
    assert "is not a rotorfit result" in refused(
        "export", "other.json", "--to", "px4", "-o", "my.params"
    )


def test_a_table_of_a_flight(run, here, assert_wording):
    assert run("identify", "experiment.toml", "-o", "r.json").code == 0
    ended = run("export", "r.json", "--to", "table", "-o", "wrenches.csv")
    assert ended.code == 0
    assert "low-pass 3 Hz" in ended.out
    assert_wording(ended.out)
    lines = (here / "wrenches.csv").read_text().splitlines()
    names = lines[0].split(",")
    assert names[0] == "time"
    assert "residual/Fz [N]" in names
    rows = [[float(v) for v in line.split(",")] for line in lines[1:]]
    at = names.index("body/Fz [N]")
    for row in rows[:: max(len(rows) // 20, 1)]:
        assert row[at] - row[at + 1] == pytest.approx(row[at + 2], abs=1e-6)
        assert row[at] == pytest.approx(MASS * 9.8, rel=0.5)
    known = IdentificationResult.load(here / "r.json")
    assert ("residual/Mz [N m]" in names) == (known.parameter("kd").value is not None)

    told = run("export", "r.json", "--to", "table", "-o", "wrenches.parquet", "--json").json
    assert told["files"] == ["wrenches.parquet"]
    table = open_parquet((here / "wrenches.parquet").read_bytes())
    assert table.names == tuple(names)
    fz = table.numbers(["body/Fz [N]"])[:, 0]
    assert fz == pytest.approx([row[at] for row in rows], rel=1e-6)
    schema = importlib.import_module("pyarrow.parquet").read_schema(here / "wrenches.parquet")
    assert "flight flight.csv (sha256 " in schema.metadata[b"rotorfit"].decode()


def test_a_table_takes_no_assumptions(run, there):
    asked = ("export", "result.json", "--to", "table", "-o", "t.csv", "--assume", "kd=1e-8")
    assert run(*asked).code == 2


def test_a_table_of_a_flight_that_is_gone(refused, there):
    words = refused("export", "result.json", "--to", "table", "-o", "t.csv")
    assert "A1--long.csv" in words


def of(flight, **errors):
    return WrenchComparison(
        configuration="A",
        flight=flight,
        sha256="",
        used_in_fit=True,
        time=np.zeros(1),
        body_wrench=np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]),
        rotor_wrench=np.zeros((1, 6)),
        relative_error=errors,
        whiteness={},
    )


def test_columns_are_of_known_components_and_per_kilogram():
    found = columns_of(of("A1.csv", Fz=0.1, Mx=0.1), a_result())
    assert list(found) == [
        "time",
        *(f"{side}/Fz [N]" for side in ("body", "rotors", "residual")),
        *(f"{side}/Mx [N m]" for side in ("body", "rotors", "residual")),
    ]
    assert (found["residual/Fz [N]"][0], found["body/Mx [N m]"][0]) == (3.0, 4.0)
    light = changed(a_result(), mass={"value": None, "verdict": "not-identified"})
    assert "body/Fz [N per kg]" in columns_of(of("A1.csv", Fz=0.1), light)


def test_files_of_several_flights_have_their_names():

    files = table_files(Path("w.csv"), [of("A1.csv"), of("A2.bfl")])
    assert [str(f) for f in files] == ["w_A1.csv", "w_A2.csv"]
    files = table_files(Path("w.csv"), [of("A1.csv"), of("A1.bfl"), of("B.csv")])
    assert [str(f) for f in files] == ["w_A1_1.csv", "w_A1_2.csv", "w_B.csv"]


@pytest.mark.parametrize("target", sorted(TARGETS))
@pytest.mark.parametrize(
    ("name", "value"), [("kd", float("nan")), ("mass", 1e-300), ("com_x", 1e308)]
)
def test_a_damaged_result_is_refused_by_every_target(
    refused, there, target, name, value, assert_wording
):
    data = json.loads((there / "result.json").read_text())
    for entry in (*data["parameters"], *data["derived"]):
        if entry["name"] == name:
            entry["value"] = value
    (there / "damaged.json").write_text(json.dumps(data))
    words = refused("export", "damaged.json", "--to", target, "-o", "out")
    assert f"written ({name} is" in words
    assert_wording(words)
    assert not (there / "out").exists()


@pytest.mark.parametrize(
    "command",
    [
        ("compare", "damaged.json", "damaged.json"),
        ("validate", "damaged.json", "flight.csv"),
        ("plan", "airframe.toml", "--after", "damaged.json"),
        ("fly", "damaged.json"),
    ],
    ids=lambda command: command[0],
)
def test_a_damaged_result_is_refused_by_every_command(refused, there, command, assert_wording):
    data = json.loads((there / "result.json").read_text())
    next(entry for entry in data["parameters"] if entry["name"] == "kd")["value"] = float("nan")
    (there / "damaged.json").write_text(json.dumps(data))
    (there / "airframe.toml").write_text(AIRFRAME)
    (there / "flight.csv").write_text("time\n")
    words = refused(*command)
    assert_wording(words)


@pytest.mark.parametrize("airframe", ["x", None, 3, {"rotors": []}])
def test_settings_that_describe_no_vehicle_are_refused(refused, there, airframe, assert_wording):
    data = json.loads((there / "result.json").read_text())
    data["settings"]["airframe"] = airframe
    (there / "damaged.json").write_text(json.dumps(data))
    words = refused("export", "damaged.json", "--to", "urdf", "-o", "out")
    assert refused("fly", "damaged.json") == words
    assert_wording(words)


def test_a_lag_below_zero_is_refused(refused, there, assert_wording):
    changed(a_result(), motor_lag={"value": -0.01, "interval": (-0.02, 0.0)}).save(
        there / "early.json"
    )
    words = refused("export", "early.json", "--to", "mujoco", "-o", "out.xml")
    assert "is -0.01 s," in words
    assert_wording(words)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_device_or_a_pipe_is_never_replaced(refused, there, assert_wording):
    """As root, a file would else be moved into the place of /dev/null."""
    os.mkfifo(there / "pipe")
    words = refused("export", "result.json", "--to", "px4", "-o", "pipe", "--force")
    assert_wording(words)
    assert (there / "pipe").is_fifo()
    refused("fly", "result.json", "-o", "pipe", "--force")
    refused("fly", "result.json", "--report", "pipe", "--force")
    with pytest.raises(OutputError, match="no file"):
        write_export(there / "pipe", a_result(), "px4", force=True)
    assert (there / "pipe").is_fifo()


def test_drawn_vehicles_are_written_with_the_rejected_share(run, there, assert_text):
    asked = ("export", "result.json", "--to", "samples", "--samples", "7", "-o", "v.npz")
    ended = run(*asked)
    assert (ended.code, ended.err) == (0, "")
    assert_text(ended.out.splitlines())
    assert len(np.load(there / "v.npz")["kt"]) == 7
    told = run(
        "export", "result.json", "--to", "mujoco", "--samples", "2", "-o", "m", "--json"
    ).json
    assert told["files"] == ["m/mujoco-1.xml", "m/mujoco-2.xml"]
    assert (told["count"], told["seed"], told["rejected"]) == (2, 0, 0.0)
    assert all((there / file).exists() for file in told["files"])


def test_drawn_vehicles_overwrite_nothing(run, refused, there):
    (there / "m").mkdir()
    (there / "m" / "mujoco-2.xml").write_text("mine")
    words = refused("export", "result.json", "--to", "mujoco", "--samples", "2", "-o", "m")
    assert "m already holds mujoco-2.xml" in words
    wrong = run("export", "result.json", "--to", "table", "--samples", "2", "-o", "t.csv")
    assert wrong.code == 2 and "takes no --samples" in " ".join(wrong.err.split())
    code = run("export", "result.json", "--to", "samples", "--project", "-o", "s.npz").code
    assert code == 2
