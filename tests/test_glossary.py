"""The names of the source and the terms of `docs/glossary.md`.

What a reader meets in a name is a word of the field, of plain English or of the glossary. The words
below were the project's own, for which the field has others.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WORDS = {
    r"(un|fore)?told|tells?|telling": "known, identifiable, logged, given; report; informative",
    r"(un)?heard": "received, logged",
    r"hangs?|hanging": "depends_on",
    r"swallow\w*": "absorbed",
    r"taken_back": "withheld",
    r"witness\w*": "instrument, reference",
    r"beside": "alongside, additional",
    r"pull|pulls|pulled": "bias, influence",
    r"tied": "correlated, error_correlation",
    r"apart": "difference, separate, outlying",
    r"answer\w*": "response; reply of a person",
    r"opinions?": "estimate, evidence",
    r"surer": "more_certain",
    r"steered": "closed_loop, controlled",
}
"""By the pattern of a word, or of several in a row, what to write in its place."""
PHRASES = re.compile(
    r"^(Return|Do) (what|the same|that of)\b"
    r"|\b((un|fore)?told|(un)?heard|witness\w*|hang(s|ing)?|swallow\w*|surer|steered|opinions?)\b"
)
"""Of the first line of a docstring, which names its thing by the field's words."""
ALLOWED: dict[str, str] = {}
"""By name the reason why it stays, such as a field that is the key of a JSON file."""


def words_of(name):
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


@cache  # most names are bound many times
def replacement(name):
    parts = words_of(name)
    found = (new for word, new in WORDS.items() if re.search(rf"(^|_)({word})(_|$)", parts))
    return None if name in ALLOWED else next(found, None)


def names_bound(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            yield name
        case ast.ClassDef(name=name):
            yield name
        case ast.arg(arg=name):
            yield name
        case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
            yield name
        case ast.ExceptHandler(name=str(name)) | ast.alias(asname=str(name)):
            yield name
        case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
            yield name
        case _:
            pass


def names_in(text):
    """Yield line and name of everything that a module defines, itself or inside."""
    for node in ast.walk(ast.parse(text)):
        for name in names_bound(node):
            yield getattr(node, "lineno", 0), name


def test_names_of_the_source_are_words_of_the_field():
    files = sorted((ROOT / "src").rglob("*.py"))
    assert len(files) > 100
    found = [
        f"{file.relative_to(ROOT)}:{line} {name}: {new}"
        for file in files
        for line, name in names_in(file.read_text(encoding="utf-8"))
        if (new := replacement(name)) is not None
    ] + [
        f"{file.relative_to(ROOT)}: {new}"
        for file in files
        if (new := replacement(file.stem)) is not None
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "def is_told(): ...",
        "class ToldMotors: ...",
        "class A:\n    answered: bool = False",
        "NOT_ANSWERING = 1",
        "def f(*, beside): ...",
        "def f(**told): ...",
        "lambda apart: 0",
        "[0 for pulls in x]",
        "(heard := 1)",
        "self.tied = 1",
        "from a import b as telling",
        "try: ...\nexcept OSError as told: ...",
        "match x:\n    case [*apart]: ...",
    ],
)
def test_every_kind_of_name_is_read(text):
    assert [name for _, name in names_in(text) if replacement(name)] != []


def first_lines(text):
    """Yield line and first line of every docstring of a module."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = ast.get_docstring(node)
            if docstring is not None:
                yield getattr(node, "lineno", 1), docstring.splitlines()[0]


def test_first_lines_of_docstrings_name_their_thing():
    found = [
        f"{file.relative_to(ROOT)}:{line} {first}"
        for file in sorted((ROOT / "src").rglob("*.py"))
        for line, first in first_lines(file.read_text(encoding="utf-8"))
        if PHRASES.search(first)
    ]
    assert found == []


@pytest.mark.parametrize(
    "first",
    [
        "Return what is open of the numbers.",
        "Return the same where a fit moves the times.",
        "Gravity as a witness.",
        "Widen what hangs on the inertia.",
    ],
)
def test_phrases_that_name_nothing_are_found(first):
    [(_, read)] = first_lines(f"def f():\n    {first!r}")
    assert PHRASES.search(read)


@pytest.mark.parametrize("name", ["telltale", "apartment", "united", "pulley", "change", "teller"])
def test_words_that_only_begin_alike_are_free(name):
    assert replacement(name) is None


def test_terms_of_the_glossary_are_unique_and_sorted():
    text = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    (entries,) = re.findall(r"(?ms)^```\{glossary\}\n(.*?)^```", text)
    terms = re.findall(r"(?m)^(?! |$)(.+)$", entries)
    assert len(terms) > 30
    assert len(set(terms)) == len(terms)
    assert terms == sorted(terms, key=str.lower)
