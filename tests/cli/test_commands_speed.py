"""The benchmark of whole commands: what it runs, how it measures, what it writes."""

import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from benchmarks.commands_speed import (
    HEAD,
    Build,
    Row,
    Spent,
    chosen_cases,
    median_of,
    runs_in_turns,
    seconds_of_reading,
    table,
)
from benchmarks.speed_cases import AIRFRAMES, CASES, RESULTS, ROOT, Case, write_declarations
from typer.main import get_command

from rotorfit.cli.main import app

OWN = Build(python=Path(sys.executable), source=ROOT / "src")


def spent(seconds, megabytes=100.0, code=0):
    return Spent(seconds=seconds, megabytes=megabytes, code=code)


def row(name, before, now, logs=0):
    case = Case(name=name, arguments=("inspect", "LOG"), logs=logs)
    return Row(case=case, before=spent(before, 200.0), now=spent(now, 140.0), reading=0.25)


def test_the_program_has_every_option_of_the_cases():
    commands = get_command(app).commands
    for case in CASES:
        command = commands[case.arguments[0]]
        options = {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
        given = {one for one in case.arguments[1:] if one.startswith("-")}
        assert given <= options, case.name


def test_cases_have_names_of_their_own_and_make_every_result():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert set(RESULTS.values()) <= set(names)


def test_every_file_of_the_cases_is_written(tmp_path):
    (tmp_path / "made").mkdir()
    write_declarations(tmp_path / "made", tmp_path)
    written = {f"{{made}}/{path.name}" for path in (tmp_path / "made").iterdir()}
    made = {one for case in CASES for one in case.arguments if one.startswith("{made}/")}
    simulated = {one for one in made if one.endswith("/experiment.toml")}
    assert made - simulated - set(RESULTS) <= written
    for name in (*AIRFRAMES, "cinerat"):
        text = (tmp_path / "made" / f"{name}.toml").read_text(encoding="utf-8")
        assert tomllib.loads(text)["motors"]["speed"] in ("measured", "commanded")


def test_cases_without_their_logs_are_left_out(tmp_path):
    names = {case.name for case in chosen_cases([], tmp_path)}
    assert "refusal: missing file" in names
    assert "identify 75 s at 200 Hz, measured" in names
    assert "identify LOG00271" not in names
    assert {case.name for case in chosen_cases(["missing"], tmp_path)} == {"refusal: missing file"}


def test_a_refusal_takes_time_and_memory_in_both_builds(tmp_path):
    [case] = chosen_cases(["missing"], tmp_path)
    write_declarations_in = tmp_path / "made"
    write_declarations_in.mkdir()
    write_declarations(write_declarations_in, tmp_path)
    places = {"data": tmp_path, "made": write_declarations_in}
    for one in runs_in_turns((OWN, OWN), case, places):
        assert one.code == 1
        assert one.seconds > 0.02  # Python alone takes longer to start
        assert 10.0 < one.megabytes < 2000.0


def test_answers_are_typed_and_files_written(tmp_path):
    case = Case(
        name="airframe without a log",
        arguments=("airframe", "-o", "{made}/airframe.toml", "--speed", "measured"),
        typed="quad-x\npx4\n100\n120\n",
    )
    [one] = runs_in_turns((OWN,), case, {"made": tmp_path})
    assert one.code == 0
    written = tomllib.loads((tmp_path / "airframe.toml").read_text(encoding="utf-8"))
    assert written["airframe"]["spacing"] == [0.1, 0.12]


def test_reading_counts_the_flights_of_an_experiment(tmp_path):
    rows = ["time,gyro_x,gyro_y,gyro_z"] + [f"{0.001 * i},0.1,{i % 7},0.3" for i in range(60000)]
    (tmp_path / "flight.csv").write_text("\n".join(rows), encoding="utf-8")
    shutil.copy(tmp_path / "flight.csv", tmp_path / "again.csv")
    write_declarations(tmp_path, tmp_path)
    airframe = (tmp_path / "cinerat.toml").read_text(encoding="utf-8")
    flights = '[[configuration]]\nmass = 1.0\nflights = ["flight.csv", "again.csv"]\n'
    (tmp_path / "two.toml").write_text(f"{airframe}\n{flights}", encoding="utf-8")
    one = seconds_of_reading(OWN, [str(tmp_path / "flight.csv")])
    two = seconds_of_reading(OWN, [str(tmp_path / "two.toml")])
    assert two > 1.2 * one > 0.0


def test_the_median_is_of_runs_that_end_alike():
    runs = [spent(3.0, 110.0), spent(1.0, 90.0), spent(1.5, 300.0)]
    assert median_of(runs) == spent(1.5, 110.0)
    with pytest.raises(RuntimeError, match=r"exit codes \[0, 1\]"):
        median_of([spent(1.0), spent(1.0, code=1)])


def test_a_row_has_both_versions_and_their_ratios():
    assert row("inspect LOG", 8.0, 2.0).text == (
        "| inspect LOG | 8.00 | 2.00 | 4.0 | 0.25 | 200 | 140 | 0.70 |"
    )
    case = Case(name="inspect LOG", arguments=("inspect", "LOG"))
    ended = Row(case=case, before=spent(1.0, code=1), now=spent(1.0), reading=None)
    assert ended.text.startswith("| inspect LOG (exit 1, now 0) |")


def test_the_table_says_how_time_grows_and_what_a_core_does():
    rows = [
        row("identify 75 s at 200 Hz, measured", 2.0, 1.0),
        row("identify 600 s at 200 Hz, measured", 20.0, 6.0),
        row("identify 20 flights of 75 s, measured", 50.0, 15.0),
        row("fleet of 4 throws", 40.0, 8.0, logs=4),
    ]
    lines = table(rows).splitlines()
    assert lines[0] == HEAD
    assert lines[0].count("|") == lines[1].count("|") == lines[2].count("|")
    assert lines[-3:] == [
        "- 600 s at 200 Hz cost 6.0 times as much as 75 s, measured (before 10.0; at most 8.5)",
        "- 20 flights of 75 s cost 15.0 times as much as 75 s, measured (before 25.0; at most 20)",
        "- fleet of 4 throws: 30.0 logs per minute and core (before 6.0, 5.0 times)",
    ]
