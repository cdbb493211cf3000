"""What changes a number is in `fit/`: checks read a fit and yield findings, and change nothing."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from rotorfit.checks.diagnose import DIAGNOSTICS
from rotorfit.findings import Finding
from rotorfit.fit.steps import STEPS

SOURCE = Path(__file__).parents[2] / "src" / "rotorfit"
FITTED = {
    "Fit",
    "Numbers",
    "IntervalTerm",
    "Dataset",
    "TimedDataset",
    "ConfigurationData",
    "LoadedFlight",
    "MotorTiming",
    "MotorsEntry",
    "MotorLaw",
    "Factors",
}
"""Types of what a fit holds: a function that returns one of them makes another fit."""
MADE = {"Fit", "Numbers", "IntervalTerm"}
CHANGING = {"with_terms", "with_record", "found"}
"""Methods by which a step changes a fit or its numbers."""
FITTING = {
    "estimate_additional",
    "fit_flights",
    "fit_rows",
    "joint_estimate",
    "joint_fit",
    "refit",
    "shift_of",
    "time_motors",
}
"""What fits flights: `fit/alternatives/` does so for the checks."""
KEPT = {"fit", "numbers"}
"""Names of what no check may replace."""


def changes(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the words of everything by which a module changes a fit."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.returns is not None:
            returned = {part.strip() for part in ast.unparse(node.returns).split("|")}
            yield from ((node.lineno, f"{node.name} -> {name}") for name in returned & FITTED)
        if isinstance(node, ast.Call):
            yield from ((node.lineno, words) for words in _changing_call(node))


def _changing_call(call: ast.Call) -> Iterator[str]:
    made = ast.unparse(call.func)
    if made in MADE | FITTING or (
        isinstance(call.func, ast.Attribute) and call.func.attr in CHANGING
    ):
        yield f"{made}()"
    if made.rpartition(".")[2] == "replace" and call.args:
        whole = ast.unparse(call.args[0])
        if whole in KEPT or whole.rpartition(".")[2] in KEPT:
            yield f"{made}({whole})"


def test_no_check_changes_a_fit():
    found = [
        f"{path.relative_to(SOURCE)}:{line} {words}"
        for path in sorted((SOURCE / "checks").rglob("*.py"))
        for line, words in changes(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "def widen(fit: Fit) -> Fit: ...",
        "def refitted(fit) -> TimedDataset | None: ...",
        "fit.with_terms(term)",
        "fit.found(finding)",
        "joint_estimate(free, [])",
        "IntervalTerm(name='x')",
        "dataclasses.replace(fit, known={})",
        "replace(fit.numbers, values=2.0 * fit.numbers.values)",
    ],
)
def test_a_change_is_found(line):
    assert len(list(changes(ast.parse(line)))) == 1


@pytest.mark.parametrize("line", ["replace(vehicle, rotors=())", "fit.record_of(Weighing)"])
def test_what_changes_nothing_passes(line):
    assert list(changes(ast.parse(line))) == []


def test_every_diagnostic_yields_findings():
    hints = {one.__annotations__["return"] for one in DIAGNOSTICS}
    plain = {Iterator[Finding], Iterable[Finding], "Iterator[Finding]", "Iterable[Finding]"}
    assert hints <= plain


def test_every_step_is_in_the_fit():
    assert {step.__module__.split(".")[1] for step in STEPS} == {"fit"}


def test_the_recipe_takes_findings_alone_from_the_checks():
    tree = ast.parse((SOURCE / "identification.py").read_text(encoding="utf-8"))
    taken = [
        name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rotorfit.checks")
        for name in node.names
    ]
    assert taken == ["diagnose"]
