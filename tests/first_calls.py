"""Types checked by beartype at the first calls of each function in a test, not at every one.

Checking all of the calls takes a third of the tests' time: the loops of an estimate call the same
functions with the same shapes tens of thousands of times. `CALLS=all pytest` checks them all.
"""

import ast
import functools
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path

import jaxtyping
from beartype import beartype
from jaxtyping import _import_hook as hook

ALL_CALLS = os.environ.get("CALLS") == "all"
"""Whether every call is checked, in every test."""

CALLS = float("inf") if ALL_CALLS else 10
"""Two for each call: of the arguments, and of what is returned."""

TYPED = (
    "estimation",
    "fit",
    "flight",
    "identification",
    "model",
    "results/test_samples.py",
    "test_first_calls.py",
    "tools/fleet/test_random_effects.py",
)
"""Folders and files whose tests check types and shapes where `--jaxtyping-packages` is given.

Other tests pass stand-ins for typed arguments; `CALLS=all` checks them nevertheless.
"""
UNTYPED = (
    "fit/experiment",
    "fit/motor_law",
    "fit/test_inertia_uncertainty.py",
    "fit/test_other_settings.py",
    "fit/test_rotor_groups.py",
    "fit/test_term_choice.py",
    "fit/test_timing_search.py",
    "fit/test_unequal_flights.py",
    "flight/test_align.py",
)
"""Of these, what takes longest to check; others that are checked call the same functions."""

_counts: dict[str, int] = {}
_left_out: list[Callable[..., object]] = []


def is_typed(path: Path) -> bool:
    """Return whether the tests of a file check types and shapes."""
    within, left_out = (
        any(path.is_relative_to(Path(__file__).parent / one) for one in some)
        for some in (TYPED, UNTYPED)
    )
    return ALL_CALLS or (within and not left_out)


def checked_at_first(function: Callable[..., object]) -> Callable[..., object]:
    """Check a function's types and shapes at its first calls in a test, and prepare it only then.

    Most functions are never checked, those within others are made anew at every call, and to
    prepare one takes as long as a hundred calls of it.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    typed: Callable[..., object] | None = None
    config = jaxtyping.config

    @functools.wraps(function)
    def call(*args: object, **kwargs: object) -> object:
        nonlocal typed
        if config.jaxtyping_disable or _counts.get(name, 0) >= CALLS:
            return function(*args, **kwargs)
        if typed is None:
            typed = jaxtyping.jaxtyped(function, typechecker=checked)
        return typed(*args, **kwargs)

    return call


def checked_class(made: type) -> type:
    """Check what a data class is made of; not where all share one `__init__`, which takes anything.

    That of `rotorfit.frozen_dataclass` is called half a million times by the tests of `fit`.
    """
    if getattr(made.__init__, "__module__", None) == "rotorfit.frozen_dataclass":
        return made
    return jaxtyping.jaxtyped(made, typechecker=checked)


def checked(function: Callable[..., object]) -> Callable[..., object]:
    """Check a function's types as beartype does, until it has been called often enough."""

    @functools.cache
    def check() -> Callable[..., object]:  # when called: most functions never are
        return beartype(function)

    name = f"{function.__module__}.{function.__qualname__}"

    @functools.wraps(function)
    def counted(*args: object, **kwargs: object) -> object:
        _counts[name] = _counts.get(name, 0) + 1
        if _counts[name] == CALLS:
            _leave_out(function.__module__, function.__qualname__)
        return check()(*args, **kwargs)

    return counted


class TransformerWithTypes(hook.JaxtypingTransformer):
    """The transformer of the hook, for which modules also import the types of annotations."""

    def visit_Module(self, node: ast.Module) -> ast.AST:
        makes_names = any(
            isinstance(one, ast.FunctionDef) and one.name == "__getattr__" for one in node.body
        )
        for statement in [] if makes_names else node.body:
            for_types = (
                isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING"
            )
            if for_types and not statement.orelse:  # with it a module finds these names otherwise
                statement.test = ast.Constant(True)
        return super().visit_Module(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        own = set(node.decorator_list)
        super().visit_ClassDef(node)
        if node.decorator_list and node.decorator_list[0] not in own:
            node.decorator_list[0] = _decorator("checked_class", node)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        own = set(node.decorator_list)
        super().visit_FunctionDef(node)
        if node.decorator_list and node.decorator_list[-1] not in own:
            node.decorator_list[-1:] = (
                [] if _has_nothing_to_check(node) else [_decorator("checked_at_first", node)]
            )
        return node


def _decorator(name: str, place: ast.AST) -> ast.expr:
    """Return the expression of a decorator of this module, where the function or class stands."""
    return ast.copy_location(
        ast.parse(f"__import__('first_calls').{name}", mode="eval").body, place
    )


def _has_nothing_to_check(node: ast.FunctionDef) -> bool:
    """Return whether a function takes anything and returns nothing, or anything."""
    taken = node.args
    arguments = (*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg)
    every = [one.annotation for one in arguments if one is not None]
    names = {ast.unparse(one) for one in (*every, node.returns) if one is not None}
    return names <= {"Any", "object", "None"}


hook.JaxtypingTransformer = TransformerWithTypes


def check_all_again() -> None:
    """Begin to count anew."""
    _counts.clear()
    while _left_out:
        del _left_out.pop().__no_type_check__


def _leave_out(module: str, qualified_name: str) -> None:
    """Mark a function of a module; one within another is out of reach and stays checked."""
    *classes, name = qualified_name.split(".")
    owner = sys.modules[module]
    for part in classes:
        if part == "<locals>":
            return
        owner = getattr(owner, part)
    found = vars(owner).get(name)
    for inner in ("fget", "func", "__func__"):
        found = getattr(found, inner, found)
    if found is None:
        return
    function = inspect.unwrap(found)
    function.__no_type_check__ = True
    _left_out.append(function)
