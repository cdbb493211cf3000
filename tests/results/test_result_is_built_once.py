"""The result is built once, after the last check, and never rewritten."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "rotorfit"
ON_THE_WAY = [
    SOURCE / "identification.py",
    *(
        SOURCE / "results" / f"{name}.py"
        for name in (
            "assemble",
            "command_units",
            "full_throttle",
            "joint_tables",
            "law_tables",
            "row_tables",
            "tables",
        )
    ),
]
"""Modules that have a part in a result."""
VALIDATED = "dataclasses.replace(result, validation=rows)"
"""What is added to a result: how well it predicts flights that it has not seen."""


def results_made(tree: ast.AST) -> list[str]:
    """Return where a module makes a result, or makes one of another."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    made = [ast.unparse(one.func) for one in calls]
    changed = [
        ast.unparse(one)
        for one, name in zip(calls, made, strict=True)
        if (name.endswith("replace") and one.args and ast.unparse(one.args[0]) == "result")
        or name == "result.found"
    ]
    return [*(name for name in made if name == "IdentificationResult"), *changed]


def test_one_function_makes_the_result():
    made = {path.name: results_made(ast.parse(path.read_text("utf-8"))) for path in ON_THE_WAY}
    assert {name: found for name, found in made.items() if found} == {
        "identification.py": [VALIDATED],
        "tables.py": ["IdentificationResult"],
    }


@pytest.mark.parametrize(
    "line",
    ["replace(result, derived=())", "result.found(note)", "IdentificationResult(name='again')"],
)
def test_another_one_is_found(line):
    assert len(results_made(ast.parse(line))) == 1
