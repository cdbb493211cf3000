"""The columns of an unknown table on the page's engine: proposed, answered, changed, kept."""

import copy

import numpy as np
import pytest
from served import FORM, dropped, quiet

from rotorfit.app.engine import Engine
from rotorfit.app.form import experiment_of
from rotorfit.cli.main import main
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs import read_log
from rotorfit.tools.inspection.inspect_log import inspect_log

REPLIES = {"named": {}, "units": {"gyro": "rad/s", "motors": "rad/s"}, "axes": None}


def looked(engine: Engine, **replies) -> dict:
    columns = {**REPLIES, **replies}
    return engine.call("look", {"name": "own.csv", "columns": columns}, quiet)


def test_what_neither_names_nor_values_show_is_asked(engine, unknown_table):
    told = dropped(engine, "own.csv", unknown_table)
    table = told["table"]
    assert (told["kind"], told["findings"], table["map"]) == ("log", None, None)
    assert [question["channel"] for question in table["questions"]] == ["gyro", "motors"]
    rows = {row["is"]: row for row in table["rows"]}
    assert (rows["gyro_x"]["column"], rows["accel_z"]["unit"]) == ("wx", "m/s^2")
    assert len(rows["accel_z"]["preview"]) == 3
    assert any("gravity in m/s^2; accZ of" in words for words in table["reasons"])
    assert table["names"][:2] == ["t", "wx"]


def test_replies_read_the_table(engine, unknown_table, flight, tmp_path):
    dropped(engine, "own.csv", unknown_table)
    told = looked(engine)
    (tmp_path / "known.csv").write_bytes(flight)
    known = inspect_log(read_log(tmp_path / "known.csv"))
    assert told["table"]["questions"] == []
    assert told["findings"]["seconds"] == pytest.approx(known.seconds)
    assert told["findings"]["guess"]["speed"] == "measured"
    assert told["table"]["map"]["columns"]["rotor_4"] == {"name": "m4", "unit": "rad/s"}


@pytest.mark.parametrize(
    ("replies", "words"),
    [
        ({"axes": "FRD"}, "axes FRD, as stated, but accZ of +9"),
        ({"units": {**REPLIES["units"], "accel": "g"}}, "the accelerometer in g feels 9"),
        ({"units": {**REPLIES["units"], "time": "us"}}, "t in us, as stated, makes rows"),
    ],
)
def test_a_wrong_answer_is_doubted_by_the_values(engine, unknown_table, replies, words):
    dropped(engine, "own.csv", unknown_table)
    table = looked(engine, **replies)["table"]
    assert any(doubt.startswith(words) for doubt in table["doubts"])


def test_a_column_is_chosen_by_hand(engine, unknown_table, assert_wording):
    dropped(engine, "own.csv", unknown_table)
    swapped = {"rotor_1": "m2", "rotor_2": "m1", "rotor_3": "m3", "rotor_4": "m4"}
    table = looked(engine, named=swapped)["table"]
    assert {row["is"]: row["column"] for row in table["rows"]}.items() >= swapped.items()
    turned = {"accel_x": "accZ", "accel_y": "accY", "accel_z": "accX"}
    table = looked(engine, named=turned)["table"]
    assert table["refused"].startswith("gravity lies along accZ")
    assert_wording(table["refused"])
    assert table["map"] is None


def test_names_that_show_nothing_are_asked_for(engine, unknown_table, assert_wording):
    head, _, rows = unknown_table.partition(b"\n")
    letters = [f"c{chr(97 + i)}" for i in range(len(head.split(b",")))]
    table = dropped(engine, "own.csv", b"%s\n%s" % (",".join(letters).encode(), rows))["table"]
    assert_wording(table["refused"])
    wanted = [row["is"] for row in table["rows"]]
    assert wanted[:2] == ["time", "gyro_x"]
    order = [name.decode() for name in head.split(b",")]
    own = dict(zip(order, letters, strict=True))
    named = {"time": own["t"], **{f"gyro_{a}": own[f"w{a}"] for a in "xyz"}}
    named |= {f"accel_{a}": own[f"acc{a.upper()}"] for a in "xyz"}
    named |= {f"rotor_{i}": own[f"m{i}"] for i in range(1, 5)}
    told = looked(engine, named=named)
    assert told["table"]["refused"] is None
    assert told["findings"]["rotors"] == 4


def test_the_experiment_file_keeps_the_columns(
    engine, unknown_table, flight, tmp_path, capsys, assert_text
):
    """By the page and by the command line, both ways."""
    dropped(engine, "own.csv", unknown_table)
    form = copy.deepcopy(FORM)
    form["configuration"][0]["flights"] = [{"file": "own.csv"}]
    form["table"] = looked(engine)["table"]["map"]
    text = engine.call("describe", {"form": form}, quiet)["text"]
    assert '[table.columns]\ntime = { name = "t", unit = "s" }\n' in text
    (tmp_path / "own.csv").write_bytes(unknown_table)
    path = tmp_path / "experiment.toml"
    path.write_text(text)
    entry = load_experiment(path).configuration[0].flights[0]
    assert entry.columns["gyro_x"].name == "wx"
    with pytest.raises(SystemExit) as ended:
        main(["inspect", str(tmp_path / "own.csv"), "--airframe", str(path)])
    assert ended.value.code in (None, 0)
    assert "gyro" in capsys.readouterr().out
    again = Engine(folder=tmp_path / "other")
    again.folder.mkdir()
    filled = dropped(again, "experiment.toml", text.encode())["form"]
    again.call("describe", {"form": filled}, quiet)
    told = dropped(again, "own.csv", unknown_table)
    assert_text(told["table"]["reasons"])
    assert told["findings"]["guess"]["speed"] == "measured"


def test_a_table_of_poses_is_mapped_and_identified_by_them(engine):
    """A camera's table has no IMU: the page takes the motion from the poses, unasked."""
    time = 0.01 * np.arange(400)
    lean = 0.1 * np.sin(2.0 * time)
    x = -9.81 * 0.1 / 4.0 * np.sin(2.0 * time)
    columns = [time, x, 0 * time, np.minimum(time, 1.0), np.cos(lean / 2), 0 * time]
    columns += [np.sin(lean / 2), 0 * time, *(500 + 20 * np.sin(3 * time + i) for i in range(4))]
    head = "t,px,py,pz,qw,qx,qy,qz,m1_rpm,m2_rpm,m3_rpm,m4_rpm"
    rows = [",".join(f"{value:.9g}" for value in row) for row in np.array(columns).T]
    told = dropped(engine, "own.csv", "\n".join([head, *rows]).encode())
    assert told["table"]["refused"] is None
    assert told["table"]["doubts"] == []
    form = copy.deepcopy(FORM)
    form["configuration"][0]["flights"] = [{"file": "own.csv"}]
    form["table"] = told["table"]["map"]
    assert experiment_of(engine.folder, form).identification.source == "mocap"


def test_a_table_of_own_names_needs_no_map(engine, flight, tmp_path, unknown_table):
    """Beside an unknown one the same [table] is not taken for it."""
    assert dropped(engine, "flight.csv", flight)["table"] is None
    dropped(engine, "own.csv", unknown_table)
    form = {**FORM, "table": looked(engine)["table"]["map"]}
    text = engine.call("describe", {"form": form}, quiet)["text"]
    (tmp_path / "flight.csv").write_bytes(flight)
    (tmp_path / "experiment.toml").write_text(text)
    experiment = load_experiment(tmp_path / "experiment.toml")
    assert experiment.configuration[0].flights[0].columns is None


def test_known_names_without_motors_are_read_as_they_are(engine, flight):
    lines = [line.rsplit(",", 4)[0] for line in flight.decode().splitlines()]
    assert lines[0].endswith("accel_z")
    told = dropped(engine, "imu.csv", "\n".join(lines).encode())
    assert (told["kind"], told["table"]) == ("log", None)
    assert told["findings"]["rotors"] is None


def test_what_is_no_flight_says_so(engine):
    told = dropped(engine, "notes.csv", b"t,a,b\n" + b"1,2,3\n" * 20)
    assert (told["kind"], told["table"]) == ("other", None)
    assert "no column for gyro" in told["words"][0] or "no time" in told["words"][0]
