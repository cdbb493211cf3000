"""Interval terms combine by one rule: in order, in quadrature or, of a known sign, linearly."""

import ast
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import made_fit
import rotorfit
from rotorfit.fit.intervals.interval_terms import (
    TERM_KINDS,
    IntervalTerm,
    NumberTerm,
    combined_half_width,
    half_width_of_number,
    scale_terms,
    stretch_term,
)

SOURCE = Path(rotorfit.__file__).parent
sizes = st.floats(0.0, 1e6)
term_lists = st.lists(st.tuples(st.sampled_from(sorted(TERM_KINDS)), sizes), max_size=12)


def term(name, *half):
    return IntervalTerm(name=name, half_width=np.array(half), source="made up")


def number_terms(pairs):
    return [NumberTerm(name=name, half_width=half, source="made up") for name, half in pairs]


def test_terms_add_in_quadrature_and_known_signs_linearly():
    terms = [term("noise", 3.0, 0.3), term("weight", 4.0, 0.4), term("gyro filter", 1.0, 0.0)]
    assert combined_half_width(terms, 2) == pytest.approx([6.0, 0.5], rel=1e-15)
    terms.append(term("frame sides", 8.0, 1.2))
    assert combined_half_width(terms, 2) == pytest.approx([10.0, 1.3], rel=1e-15)
    assert combined_half_width([], 2).tolist() == [0.0, 0.0]


@given(pairs=term_lists)
def test_the_rule_is_the_documented_one(pairs):
    """Written once more, from the docstring of the module."""
    half = 0.0
    for name, size in pairs:
        linear = TERM_KINDS[name].rule == "linear"
        half = half + size if linear else math.sqrt(half**2 + size**2)
    assert half_width_of_number(number_terms(pairs)) == pytest.approx(half, rel=1e-12)


@given(pairs=term_lists, factor=st.floats(0.0, 1e3))
def test_terms_in_proportion_have_a_half_width_in_proportion(pairs, factor):
    terms = number_terms(pairs)
    scaled = half_width_of_number(scale_terms(terms, factor))
    assert scaled == pytest.approx(factor * half_width_of_number(terms), rel=1e-12, abs=1e-250)


@given(half=st.floats(1e-9, 1e6), factor=st.floats(1.0, 1e6))
def test_a_stretch_in_quadrature_multiplies(half, factor):
    stretched = stretch_term(np.array([half]), np.array([factor]))
    assert math.hypot(half, stretched[0]) == pytest.approx(half * factor, rel=1e-14)


def test_an_endless_interval_stays_endless():
    half, factor = np.array([np.inf, 1.0, np.inf, 0.0]), np.array([1.0, np.inf, 2.0, 3.0])
    total = np.hypot(half, stretch_term(half, factor))
    assert total.tolist() == [np.inf, np.inf, np.inf, 0.0]


def test_numbers_compute_their_half_width_from_the_terms():
    numbers = made_fit.no_numbers("kt", "kd", values=[1.0, 2.0], half_width=[3.0, 0.5])
    wider = numbers.with_terms(term("weight", 4.0, 0.0), term("arm lengths", 0.0, 0.0))
    assert wider.half_width == pytest.approx([5.0, 0.5])
    assert [t.name for t in wider.terms] == ["noise", "weight"]
    assert [(t.name, t.half_width) for t in wider.terms_of("kd")] == [("noise", 0.5)]
    known = wider.limited_to(np.array([np.inf, 0.2]), source="an earlier result")
    assert known.half_width == pytest.approx([5.0, 0.2])
    assert [t.name for t in known.terms_of("kd")] == ["earlier flights"]


def test_every_term_has_its_kind_and_every_kind_its_term():
    """Found in the syntax tree: the names by which terms are made, and the rows of the table."""
    made = set()
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in (
                "IntervalTerm",
                "NumberTerm",
            ):
                named = (k.value for k in node.keywords if k.arg == "name")
                made |= {value.value for value in named if isinstance(value, ast.Constant)}
    made |= {"arm lengths", "IMU position"}  # named by `other_geometries`
    assert made == set(TERM_KINDS)
    assert all(kind.action or kind.remedy == "fly" for kind in TERM_KINDS.values())


def test_the_page_explains_every_term():
    page = (Path(__file__).parents[2] / "docs" / "budget.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert sorted(re.findall("`([^`]+)`", " ".join(rows))) == sorted(TERM_KINDS)
    linear = {name for name, kind in TERM_KINDS.items() if kind.rule == "linear"}
    said = page.split("3. Terms named ")[1].split(" are the largest error")[0]
    assert set(re.findall("`([^`]+)`", said)) == linear


def test_no_half_width_is_widened_anywhere_else():
    """A total is computed in one place: nobody gives numbers another half-width."""
    offenders = [
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*.py")
        if "with_half_width" in (text := path.read_text(encoding="utf-8"))
        or "hypot(numbers.half_width" in text
        or "hypot(fit.numbers.half_width" in text
    ]
    assert offenders == []
