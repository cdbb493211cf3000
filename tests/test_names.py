"""Of every test: a name short enough for one line of a report, and something that it asserts."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

Function = ast.FunctionDef | ast.AsyncFunctionDef
LONGEST = 60
TESTS = Path(__file__).parent
ASSERTING = ("raises", "warns", "fail")
"""Of pytest; and of numpy.testing and the like, whatever is named `assert_...`."""


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def own_tests(path: Path) -> list[Function]:
    """Return the tests of a file."""
    return [
        node
        for node in ast.walk(parsed(path))
        if isinstance(node, Function) and node.name.startswith("test_")
    ]


@cache
def helpers(path: Path) -> dict[str, Function]:
    """Return what else is defined in a file, by name."""
    return {
        node.name: node
        for node in ast.walk(parsed(path))
        if isinstance(node, Function) and not node.name.startswith("test_")
    }


@cache
def imports(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Return the imports of a file, those inside functions too."""
    return [
        node for node in ast.walk(parsed(path)) if isinstance(node, ast.Import | ast.ImportFrom)
    ]


@cache
def modules() -> dict[str, Path]:
    return {path.stem: path for path in TESTS.rglob("*.py") if path.name != "conftest.py"}


def places(path: Path, name: str) -> Iterator[Path]:
    """Yield where a name that a file calls may be defined: here, where it is from, a conftest."""
    yield path
    for node in imports(path):
        if isinstance(node, ast.ImportFrom) and node.module in modules():
            if any((alias.asname or alias.name) == name for alias in node.names):
                yield modules()[node.module]
        elif isinstance(node, ast.Import):
            yield from (modules()[alias.name] for alias in node.names if alias.name in modules())
    for folder in path.relative_to(TESTS).parents:
        if (fixtures := TESTS / folder / "conftest.py").is_file():
            yield fixtures


def called(node: Function) -> Iterator[str]:
    """Yield the names of the functions, methods and fixtures that a function calls."""
    for call in (n for part in node.body for n in ast.walk(part) if isinstance(n, ast.Call)):
        if isinstance(call.func, ast.Name):
            yield call.func.id
        elif isinstance(call.func, ast.Attribute):
            yield call.func.attr


def asserts(path: Path, node: Function, seen: tuple[str, ...] = ()) -> bool:
    """Return whether a function asserts, itself or by a helper of the tests that it calls."""
    if any(isinstance(n, ast.Assert) for part in node.body for n in ast.walk(part)):
        return True
    names = set(called(node)) - set(seen)
    if any(name in ASSERTING or name.startswith("assert_") for name in names):
        return True
    return any(
        asserts(place, helpers(place)[name], (*seen, *names))
        for name in names
        for place in places(path, name)
        if name in helpers(place)
    )


def test_no_test_name_is_longer_than_60_characters():
    too_long = [
        f"{path}: {node.name}"
        for path in sorted(TESTS.rglob("*.py"))
        for node in own_tests(path)
        if len(node.name) > LONGEST
    ]
    assert too_long == []


def test_every_test_asserts_something():
    silent = [
        f"{path.name}: {node.name}"
        for path in sorted(TESTS.rglob("test_*.py"))
        for node in own_tests(path)
        if not asserts(path, node)
    ]
    assert silent == []


def test_a_test_that_only_runs_something_is_found():
    path = TESTS / "test_names.py"
    runs, checks, by_helper = (
        ast.parse(f"def test_one(golden):\n    {line}").body[0]
        for line in ("len('')", "assert len('') == 0", "golden('one.txt', '')")
    )
    assert [asserts(path, node) for node in (runs, checks, by_helper)] == [False, True, True]
