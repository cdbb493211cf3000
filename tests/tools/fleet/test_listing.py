"""Which logs a fleet has, and what is said of them."""

import os
import re

import pytest

from rotorfit.errors import ExperimentError
from rotorfit.tools.fleet.listing import Defaults, listed_logs


def test_a_folder_gives_every_log_in_it_and_no_more(small_fleet):
    assert [log.name for log in small_fleet.logs] == [
        *("one/flight1.csv", "one/flight2.csv"),
        *("two/empty.bfl", "two/flight1.csv", "two/flight2.csv", "two/flight9.csv"),
        "two/notes.csv",
    ]


def test_the_outputs_of_the_fleet_are_not_listed(small_fleet):
    logs = listed_logs(
        small_fleet.folder, small_fleet.defaults, excluded=small_fleet.folder / "two"
    )
    assert [log.name for log in logs] == ["one/flight1.csv", "one/flight2.csv"]


def test_a_pipe_is_not_waited_for(tmp_path, small_fleet):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ExperimentError, match="there is no flight log in it"):
        listed_logs(tmp_path, small_fleet.defaults)


def table(tmp_path, text: str):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_says_whose_and_how_loaded(tmp_path):
    source = table(
        tmp_path,
        "file,vehicle,configuration,mass,airframe\na.bfl,V1,bare,0.4,v.toml\nb/c.bfl,,,,\n",
    )
    defaults = Defaults(
        mass="unknown", airframe=tmp_path / "x.toml", vehicle_of=re.compile(r"(\w)\.bfl")
    )
    first, second = listed_logs(source, defaults)
    assert (first.vehicle, first.configuration, first.task.mass) == ("V1", "bare", 0.4)
    assert first.task.airframe == str(tmp_path / "v.toml")
    assert (second.name, second.vehicle, second.configuration) == ("b/c.bfl", "c", "A")
    assert (second.task.mass, second.task.airframe) == ("unknown", str(tmp_path / "x.toml"))


def test_a_pattern_may_name_vehicle_and_configuration(tmp_path):
    pattern = re.compile(r"(?P<configuration>\w+)__(?P<vehicle>E\d)")
    source = table(tmp_path, "file\nnormal__E8\n")
    (log,) = listed_logs(
        source, Defaults(mass=0.03, airframe=tmp_path / "a.toml", vehicle_of=pattern)
    )
    assert (log.vehicle, log.configuration) == ("E8", "normal")


def test_a_table_takes_masses_in_grams(tmp_path):
    source = table(tmp_path, "file,mass\na.bfl,428g\n")
    (log,) = listed_logs(source, Defaults(airframe=tmp_path / "a.toml"))
    assert log.task.mass == pytest.approx(0.428)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("path\na.bfl\n", "column 'path'; expected a CSV with the columns file, vehicle"),
        ("mass\n1\n", "no column file; expected"),
        ("file,mass\n,1\n", "line 2: no file named"),
        ("file,mass\na.bfl,heavy\n", "the mass of a.bfl is 'heavy'; expected kilograms"),
        ("file,mass\na.bfl,428\n", "the mass of a.bfl is 428 kg: did you mean 428 g?"),
        ("file,log\na.bfl,0\n", "a.bfl: log is '0'; expected a number from 1"),
        ("file\na.bfl\na.bfl\n", "a.bfl is listed twice"),
        ("file\n", "there is no flight log in it"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(tmp_path, text, words):
    with pytest.raises(ExperimentError, match=re.escape(words)):
        listed_logs(table(tmp_path, text), Defaults(mass=1.0, airframe=tmp_path / "a.toml"))


@pytest.mark.parametrize(
    ("defaults", "words"),
    [
        ({"mass": 1.0}, "no airframe is given"),
        ({"airframe": "a.toml"}, "no mass is given"),
        (
            {"mass": 1.0, "airframe": "a.toml", "vehicle_of": re.compile("x")},
            "does not match a.bfl",
        ),
    ],
)
def test_what_nobody_says_is_asked_for(tmp_path, defaults, words):
    if "airframe" in defaults:
        defaults["airframe"] = tmp_path / "a.toml"
    with pytest.raises(ExperimentError, match=words):
        listed_logs(table(tmp_path, "file\na.bfl\n"), Defaults(**defaults))


def test_a_source_that_is_not_there_is_said(tmp_path):
    with pytest.raises(ExperimentError, match="no such file or folder"):
        listed_logs(tmp_path / "nowhere", Defaults())
