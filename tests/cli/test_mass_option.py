"""--mass takes kilograms, or grams where it says so."""

import io
import sys

import pytest
import typer

from rotorfit.cli.mass import parse_mass
from rotorfit.errors import ExperimentError


@pytest.mark.parametrize(
    ("text", "mass"),
    [("0.428", 0.428), ("428g", 0.428), ("428 g", 0.428), (".428kg", 0.428), ("12 KG", 12.0)],
)
def test_a_mass_with_a_unit(text, mass):
    assert parse_mass(text) == pytest.approx(mass, rel=1e-12)


def test_a_mass_that_is_meant_in_grams_is_asked_about():
    with pytest.raises(
        ExperimentError, match=r"did you mean 428 g.*--mass 428g; if not, --mass 428kg"
    ):
        parse_mass("428")
    assert parse_mass("428kg") == 428.0


def test_a_plan_takes_the_mass_as_identify_does(run, here):
    given = run("plan", "airframe.toml", "--mass", "1285")
    assert (given.code, given.out) == (1, "")
    assert "give --mass 1285g" in given.err
    unknown = run("plan", "airframe.toml", "--mass", "unknown")
    assert (unknown.code, "weighed or guessed" in unknown.err) == (2, True)


@pytest.mark.parametrize("text", ["g", "", "428 lb", "1,5"])
def test_what_is_no_mass_is_refused(text):
    with pytest.raises(typer.BadParameter, match="is not a mass"):
        parse_mass(text)


@pytest.mark.parametrize("text", ["-1g", "0", "nan", "inf"])
def test_a_mass_below_nothing_is_refused(text):
    with pytest.raises(ExperimentError, match="expected more than 0 kg"):
        parse_mass(text)


def test_a_missing_mass_is_asked_for(run, here, monkeypatch, assert_wording):
    monkeypatch.setattr(sys, "stdin", io.StringIO("1285g\n"))
    ended = run("identify", "flight.csv", "--airframe", "airframe.toml")
    assert ended.code == 0, ended.err
    assert_wording(ended.err)
    given = run("identify", "flight.csv", "--airframe", "airframe.toml", "--mass", "1.285")
    assert given.out == ended.out
