"""The budget in words and as a bar whose parts are as wide as their share."""

import re

import pytest

from rotorfit.report.budget import WIDTH, budget_bar, budget_text, in_short, size_words
from rotorfit.results.budget import Budget, BudgetLine


def line(name, half, share, remedy="fly", action="fly longer"):
    return BudgetLine(
        name=name, half_width=half, share=share, source="made up", remedy=remedy, action=action
    )


LINES = (
    line("noise", 4.0, 0.64),
    line("weight", 2.9, 0.355, "measure", "weigh it"),
    line("arm lengths", 0.3, 0.005, "measure", "measure the arms"),
)


def budget(value=100.0, half=5.0, lines=LINES, **more):
    return Budget(
        name="Ixx",
        configuration="A",
        unit="kg m^2",
        value=value,
        half_width=half,
        verdict="identified",
        **{"reason": None, "advice": None, **more},
        lines=lines,
    )


def test_sizes_are_in_percent_or_near_zero_in_the_unit():
    assert size_words(4.0, budget()) == "4 %"
    assert size_words(4.0, budget(value=1.0)) == "4 kg m^2"
    assert size_words(4.0, budget(value=0.0)) == "4 kg m^2"


def test_a_line_in_short_names_the_largest_contributions(assert_text):
    assert_text(in_short(budget()))


def test_a_budget_says_what_shrinks_it_and_what_that_gives(assert_text):
    """Half of 4: 5 becomes the root of 25 - 12."""
    lines = budget_text([budget()]).splitlines()
    assert lines[1].split() == ["noise", "4", "%", "#" * 13]
    assert lines[3].split() == ["1", "smaller", "0.35", "%"]
    assert lines[4:7] == ["To shrink it:", "  noise: fly longer", "  weight: weigh it"]
    assert_text(lines[7])


def test_a_number_without_an_interval_says_why(assert_text):
    lost = budget(value=None, half=None, lines=(), reason="nobody rolled", advice="roll")
    assert_text(budget_text([lost]))


def test_the_parts_of_a_bar_are_as_wide_as_their_share():
    widths = [float(w) for w in re.findall(r'<rect[^>]* width="([\d.]+)"', budget_bar(LINES))]
    assert widths == pytest.approx([WIDTH * one.share for one in LINES], abs=0.01)
    styles = re.findall(r"remedy-(\w+)", budget_bar(LINES))
    assert styles == ["fly", "measure", "measure"]
