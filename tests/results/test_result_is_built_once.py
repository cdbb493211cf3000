"""The result is built once, after the last check, and never rewritten."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "rotorfit"
MADE = ["IdentificationResult"]
COPY = "replace of IdentificationResult in {}"
COPIES = {
    # The page shows uploaded files by their own names.
    "app/outcome.py": [COPY.format("_with_shown_names")],
    # A simulation's truth is read from a file, and names a delay as the results beside it.
    "cli/compare.py": [*MADE, COPY.format("_with_delay_of_commands")],
}


def results_made(tree: ast.AST) -> list[str]:
    """Return where a module makes a result, or makes one of another.

    A result is what is annotated as one, or named `result` or `draft`.
    """
    made = [
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "IdentificationResult"
    ]
    if isinstance(tree, ast.Module):
        made += copies_made(tree, "the module", {"result", "draft"})
    return made


def copies_made(tree: ast.AST, where: str, results: set[str]) -> list[str]:
    """Return the copies of a result with other fields in a function, and in those inside it."""
    copies: list[str] = []
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            own = {a.arg for a in arguments if is_result(a.annotation)}
            copies += copies_made(node, node.name, results | own)
            continue
        if isinstance(node, ast.ClassDef):
            own = {"self"} if node.name == "IdentificationResult" else set[str]()
            copies += copies_made(node, node.name, results | own)
            continue
        if is_copy(node, results):
            copies.append(COPY.format(where))
        copies += copies_made(node, where, results)
    return copies


def is_copy(node: ast.AST, results: set[str]) -> bool:
    """Return whether a node is a call of `replace` with a result."""
    if not isinstance(node, ast.Call) or not node.args:
        return False
    return is_replace(node.func) and ast.unparse(node.args[0]) in results


def is_replace(called: ast.expr) -> bool:
    """Return whether what is called is `replace` or `dataclasses.replace`."""
    if isinstance(called, ast.Attribute):
        module = called.value
        is_of_module = isinstance(module, ast.Name) and module.id == "dataclasses"
        return is_of_module and called.attr == "replace"
    return isinstance(called, ast.Name) and called.id == "replace"


def is_result(annotation: ast.expr | None) -> bool:
    return isinstance(annotation, ast.Name) and annotation.id == "IdentificationResult"


def test_one_function_makes_the_result():
    found = {
        str(path.relative_to(SOURCE)): results_made(ast.parse(path.read_text("utf-8")))
        for path in SOURCE.rglob("*.py")
    }
    assert {name: made for name, made in found.items() if made} == {
        "results/tables.py": MADE,
        "results/result.py": MADE,
        **COPIES,
    }


@pytest.mark.parametrize(
    "line",
    [
        "replace(result, derived=())",
        "def advise(found: IdentificationResult): return dataclasses.replace(found, parameters=())",
        "class IdentificationResult:\n def found(self): return replace(self, findings=())",
        "IdentificationResult(name='again')",
    ],
)
def test_another_one_is_found(line):
    assert len(results_made(ast.parse(line))) == 1
