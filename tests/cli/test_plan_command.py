"""rotorfit plan: what it prints and writes, and how it refuses."""

import dataclasses
import json
import re

import pytest

from rotorfit.report.plan_card import card_html, card_text
from rotorfit.report.plan_text import plan_text, remedy_sentences
from rotorfit.simulation import paper_vehicle
from rotorfit.tools.planning.plan import PlanRequest, plan
from rotorfit.tools.planning.wanted import wanted_accuracy

QUICK = ("--mass", "1.285", "--payload", "0", "--seconds", "20")


@pytest.fixture(scope="module")
def planned():
    """A plan that ends with a payload, for the words of it."""
    return plan(
        PlanRequest(
            name="airframe.toml",
            vehicle=paper_vehicle("A").vehicle,
            mass=1.285,
            wanted=wanted_accuracy("kd=2.5,com_x=1"),
            seconds=(20.0, 40.0),
        )
    )


def test_the_plan_as_text(planned, golden):
    text = plan_text(planned)
    assert text == golden("plan.txt", text)


@pytest.mark.parametrize(
    ("speed", "words"),
    [
        ("measured", "Flying longer does not reach it: "),
        ("commanded", "Neither flying longer nor measured rotor speed reaches it: "),
    ],
)
def test_what_was_tried_in_vain_is_what_was_left_to_try(planned, speed, words):
    request = dataclasses.replace(planned.request, speed=speed)
    in_vain = dataclasses.replace(planned, request=request, remedies=())
    (said,) = remedy_sentences(in_vain)
    assert said.startswith(words)


def test_the_card_as_text(planned, golden):
    text = card_text(planned)
    assert text == golden("plan_card.txt", text)
    assert max(map(len, card_text(planned).splitlines())) <= 78


def test_the_card_as_a_page(planned):
    page = card_html(planned)
    words = re.sub(r"<[^>]+>", " ", page)
    text = card_text(planned)
    for said in ("70 deg/s: 5 s to the left", "__________ g", "&plusmn;"):
        assert said in words
    for step in ("on the ground", "take off", "land"):
        assert step in words and step in text
    assert page.count('class="box"') == 2 * page.count('class="seconds"')  # a box a flight
    assert page.count('class="load"') == 2
    assert "<script" not in page and "http" not in page.replace("http-equiv", "")


@pytest.mark.slow
def test_from_the_command_line(run, here):
    files = ("--card", "card.html", "-o", "plan.json")
    ended = run("plan", "airframe.toml", *QUICK, *files, "--guess", "Izz=0.03")
    assert ended.code == 0
    assert ended.err == "wrote plan.json\nwrote card.html\n"
    assert "turns while rolling, 20 s" in ended.out
    saved = json.loads((here / "plan.json").read_text())
    assert saved["recommended"]["schedule"] == "turns"
    assert saved["payload"] == []
    turns = next(c for c in saved["candidates"] if c["schedule"] == "turns")
    kd = next(n for n in turns["numbers"] if n["name"] == "kd")
    assert 0 < kd["half_width"] <= 0.05 * kd["value"]
    hover = next(c for c in saved["candidates"] if c["schedule"] == "hover")
    assert next(n for n in hover["numbers"] if n["name"] == "kd")["half_width"] is None
    assert saved["vehicle"]["Izz"] == pytest.approx(0.03)
    assert "Ixx" in saved["vehicle"]["guessed"] and "Izz" not in saved["vehicle"]["guessed"]
    assert (here / "card.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("airframe.toml", "--mass", "nan"), "expected more than 0 kg"),
        (("airframe.toml", "--mass", "612"), "did you mean 612 g?"),
        (("airframe.toml", "--mass", "612kg"), "expected 0.01 to 200 kg"),
        (("missing.toml", "--mass", "1"), "no file missing.toml"),
        (("flight.csv", "--mass", "1"), "this is a flight log; give an airframe"),
        (("airframe.toml", "--mass", "1", "--seconds", "3"), "between 10 and 600 s"),
        (("airframe.toml", "--mass", "1", "--seconds", "soon"), "between 10 and 600 s"),
        (("airframe.toml", "--mass", "1", "--payload", "-1"), "or 0 for none"),
        (("airframe.toml", "--mass", "1", "--guess", "Izz"), "NAME=VALUE"),
        (("airframe.toml", "--mass", "1", "--guess", "m=1"), "known: Ixx"),
        (("airframe.toml", "--mass", "1", "--log-rate", "0"), "samples per second"),
        (("airframe.toml", "--mass", "1", "--accuracy", "good"), "no accuracy"),
        (("airframe.toml", "--mass", "1", "--after", "flight.csv"), "a flight log, no result"),
        (("airframe.toml", "--mass", "1", "-o", "airframe.toml"), "is an input"),
        (("airframe.toml", "--mass", "1", "--card", "nowhere/c.html"), "no folder"),
    ],
)
def test_what_is_wrong_is_refused(refused, here, arguments, words):
    assert words in refused("plan", *arguments)


def test_an_airframe_that_is_wrong_names_the_place(refused, here):
    for text, words in (
        ('[airframe]\nlayout = "octopus"\narm = 0.2\n', "no layout 'octopus'"),
        ('[airframe]\nlayout = "quad-x"\narm = nan\n', "arm"),
        ('[airframe]\nlayout = "quad-x"\narm = 20.0\n', "metres"),
        ('[airframe]\nlayout = "octo-coax-x"\narm = 0.3\n', "coaxial"),
    ):
        (here / "odd.toml").write_text(text)
        assert words in refused("plan", "odd.toml", "--mass", "2")


def test_wrong_usage_is_code_two(run, here):
    without = run("plan", "airframe.toml")
    assert without.code == 2 and "--mass KG" in without.err
    card = run("plan", "airframe.toml", "--mass", "1", "--card", "card.pdf")
    assert card.code == 2 and ".html" in card.err
