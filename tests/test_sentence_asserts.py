"""Few asserts compare sentences: kinds, values and kept words (`kept_words.py`) stand for them."""

import ast
from collections.abc import Iterator
from pathlib import Path

from kept_words import WORDS, read_sections

TESTS = Path(__file__).parent
MOST = 30
"""Sentence constants within asserts of all tests; a new one belongs to tests/golden/words."""


def is_sentence(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and len(node.value) > 25
        and node.value.count(" ") >= 4
    )


def sentences_in_asserts(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the string constants within asserts that are sentences."""
    asserts = (node for node in ast.walk(tree) if isinstance(node, ast.Assert))
    return (node for found in asserts for node in ast.walk(found) if is_sentence(node))


def test_asserts_compare_values_and_kept_words():
    found = [
        f"{path.relative_to(TESTS)}:{node.lineno}"
        for path in sorted(TESTS.rglob("*.py"))
        for node in sentences_in_asserts(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert len(found) <= MOST, "\n".join(found)


def test_a_sentence_in_an_assert_is_found():
    (whole,) = sentences_in_asserts(ast.parse("assert 'the motors never turn in this log' in said"))
    assert whole.col_offset == 7
    for short in ("assert 'turns at 1.1 times' in said", "said('the motors never turn in a log')"):
        assert not list(sentences_in_asserts(ast.parse(short)))


def test_kept_words_belong_to_tests_that_compare_them():
    for path in WORDS.rglob("*.txt"):
        of = TESTS / path.relative_to(WORDS).with_suffix(".py")
        names = {
            node.name
            for node in ast.walk(ast.parse(of.read_text(encoding="utf-8")))
            if isinstance(node, ast.FunctionDef)
            and {"assert_text", "assert_wording"} & {one.arg for one in node.args.args}
        }
        kept = {head.split("[")[0].split(" ")[0] for head in read_sections(path)}
        assert kept <= names, path
