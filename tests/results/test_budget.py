"""The budget of a number: contributions largest first, their shares, and what shrinks each."""

import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.checks.verdicts.judge import ADVICE, Parameter
from rotorfit.errors import OutputError
from rotorfit.fit.intervals.interval_terms import TERM_KINDS, NumberTerm, half_width_of_number
from rotorfit.results.budget import budget_lines, budgets_named

sys.path.append(str(Path(__file__).parents[1] / "export"))
from export_material import a_result


def number(pairs, name="Ixx"):
    terms = tuple(NumberTerm(name=n, half_width=h, source="made up") for n, h in pairs)
    std = half_width_of_number(terms) / 1.96
    return Parameter(
        name=name,
        configuration="A",
        value=1.0,
        std=std,
        interval=(1.0 - 1.96 * std, 1.0 + 1.96 * std),
        unit="kg m^2",
        verdict="identified",
        interval_terms=terms,
    )


def test_contributions_stand_largest_first_with_their_share():
    lines = budget_lines(number([("weight", 3.0), ("noise", 4.0)]))
    assert [line.name for line in lines] == ["noise", "weight"]
    assert [line.share for line in lines] == pytest.approx([0.64, 0.36])
    assert [line.remedy for line in lines] == ["fly", "measure"]
    assert lines[0].action == ADVICE["roll"]
    assert lines[1].action == TERM_KINDS["weight"].action


def test_a_linear_term_has_the_share_by_which_it_adds():
    """From 4 to 5: 9 of 25, as much as 3 in quadrature."""
    lines = budget_lines(number([("noise", 4.0), ("gyro filter", 1.0)]))
    assert [line.share for line in lines] == pytest.approx([16.0 / 25.0, 9.0 / 25.0])


def test_a_term_of_a_later_version_is_shown_in_quadrature():
    lines = budget_lines(number([("noise", 3.0), ("tide", 4.0)]))
    assert [line.share for line in lines] == pytest.approx([0.64, 0.36])
    assert (lines[0].name, lines[0].remedy) == ("tide", "none")


@given(
    pairs=st.lists(st.tuples(st.sampled_from(sorted(TERM_KINDS)), st.floats(1e-6, 1e3)), min_size=1)
)
def test_shares_add_up_to_one_and_fall(pairs):
    shares = [line.share for line in budget_lines(number(pairs))]
    assert sum(shares) == pytest.approx(1.0)
    assert shares == sorted(shares, reverse=True)
    assert min(shares) >= 0.0


def test_an_unknown_number_is_refused_with_the_nearest_name():

    with pytest.raises(OutputError, match="did you mean Ixx"):
        budgets_named(a_result(), "Ixxx")
    [found] = budgets_named(a_result(), "Ixx")
    assert found.full_name == "Ixx@A"
    assert budgets_named(a_result(), "Ixx@A") == (found,)
