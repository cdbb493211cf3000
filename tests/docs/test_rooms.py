"""The picture of the rooms is drawn from the imports, and the walk names what is there."""

import ast
import re
import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "rotorfit"
sys.path.append(str(ROOT / "docs" / "pictures"))

import rooms  # noqa: E402

from rotorfit.fit.intervals.interval_terms import TERM_KINDS  # noqa: E402

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
STOPS = re.findall(r"^(\d+)\. `([\w/]+\.py)` `(\w+)`", CONTRIBUTING, re.MULTILINE)
BUDGET = re.findall(
    r"^  ([a-z ]+?) +[\d.]+ %  #+ +([\w/]+\.py) +(\w+)$", CONTRIBUTING, re.MULTILINE
)
"""Terms of the interval of Ixx, each with the function that makes it."""
MOST_MODULES = 16
MOST_FOLDERS = 13


def test_the_picture_shows_the_imports_as_they_are(request):
    """Drawn anew with  python docs/pictures/rooms.py"""
    if request.config.getoption("--update-golden"):
        rooms.main()
    assert rooms.PICTURE.read_text(encoding="utf-8") == rooms.picture()


def test_an_arrow_stands_for_an_import():
    found = rooms.rooms()
    assert "estimation" in found["fit"].uses
    assert "regressor" not in found
    assert "model" not in found["estimation"].uses
    assert rooms.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {
        "a": {"b"},
        "b": {"c"},
        "c": set(),
    }


def test_no_modules_import_one_another():
    """Imports inside functions and for types alone count, too."""
    modules = {
        ".".join(("rotorfit", *path.relative_to(SOURCE).with_suffix("").parts)): path
        for path in SOURCE.rglob("*.py")
        if path.name != "__init__.py"
    }
    used = {name: set() for name in modules}
    for name, path in modules.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                deeper = {f"{node.module}.{alias.name}" for alias in node.names}
                used[name] |= (deeper | {node.module}) & set(modules) - {name}
    order = list(TopologicalSorter(used).static_order())  # raises CycleError, naming the circle
    assert set(order) == set(modules)


def test_there_are_at_most_13_folders():
    folders = [path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file()]
    assert len(folders) <= MOST_FOLDERS
    assert set(folders) <= set(rooms.rooms())


@pytest.mark.parametrize("room", ["fit", "checks", "results", "tools", "model", "simulation"])
def test_a_room_is_small_and_says_what_it_is(room):
    found = rooms.rooms()[room]
    own = [path for path in (SOURCE / room).rglob("*.py") if path.name != "__init__.py"]
    assert max(Counter(path.parent for path in own).values()) <= MOST_MODULES  # of each folder
    assert found.what.endswith(".")
    assert f"`{room}/`" in CONTRIBUTING


def test_the_walk_has_twelve_stops_at_most():
    assert [int(number) for number, _, _ in STOPS] == list(range(1, len(STOPS) + 1))
    assert 8 <= len(STOPS) <= 12


@pytest.mark.parametrize(("number", "module", "function"), STOPS)
def test_a_stop_of_the_walk_is_there(number, module, function):
    tree = ast.parse((SOURCE / module).read_text(encoding="utf-8"))
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_the_budget_of_ixx_has_its_six_largest_terms():
    assert len(BUDGET) == 6
    assert {term for term, _, _ in BUDGET} <= set(TERM_KINDS)


@pytest.mark.parametrize(("term", "module", "function"), BUDGET)
def test_a_line_of_the_budget_names_a_function_that_is_there(term, module, function):
    tree = ast.parse((SOURCE / module).read_text(encoding="utf-8"))
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
