"""The names of the tests: short enough to be read in one line of a report."""

import ast
from pathlib import Path

LONGEST = 60


def test_no_test_name_is_longer_than_60_characters():
    too_long = [
        f"{path}: {node.name}"
        for path in sorted(Path(__file__).parent.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test_")
        and len(node.name) > LONGEST
    ]
    assert too_long == []
