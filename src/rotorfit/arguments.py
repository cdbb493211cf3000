"""Checks of the arguments of public functions: paths may be text, a wrong type is refused.

The refusal is one line that names the argument and says what makes the right thing, instead of an
error from deep inside. Pydantic's `validate_call` refuses with messages of its own, for which the
words below would be needed all the same, and looks into every field of a dataclass.
"""

from __future__ import annotations

import builtins
import collections.abc
import functools
import inspect
import os
import pathlib
import re
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, Union, cast, get_args, get_origin, get_type_hints

import rotorfit

MADE_BY: Final = {
    "AirframeEntry": "experiment.airframe is one",
    "Experiment": "rotorfit.load_experiment makes one",
    "FlightLog": "rotorfit.read_log makes one",
    "FlightPlan": "rotorfit.plan makes one",
    "IdentificationResult": "rotorfit.identify and rotorfit.IdentificationResult.load make one",
    "MotorsEntry": "experiment.motors is one",
    "WrenchComparison": "rotorfit.validate_file makes one",
}
"""Where a caller gets an instance."""
ENTRIES: Final = {
    "AirframeEntry": "rotorfit.fit.experiment.airframe_table",
    "MotorsEntry": "rotorfit.fit.experiment.experiment",
}
"""Modules of types that are no public names themselves."""
SIMPLE: Final[dict[Any, tuple[type | tuple[type, ...], str]]] = {
    Path: ((str, os.PathLike), "a path"),
    bool: (bool, "True or False"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    str: (str, "text"),
    NoneType: (NoneType, "None"),
}


def checked(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Wrap a function under its public name: check its arguments, convert text to paths."""
    signature = inspect.signature(function)
    hints = _types_of(function)

    @functools.wraps(function)
    def checked_call(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # refused in Python's own words
        for argument, value in given.arguments.items():
            hint = hints[argument]
            if not _fits_type(value, hint):
                is_plain = isinstance(value, str | float | int | NoneType)
                shown = repr(value) if is_plain else f"of type {type(value).__name__}"
                raise TypeError(
                    f"{name}: {argument} is {shown}, expected {_expected_type(value, hint)}"
                )
            if Path in (hint, *get_args(hint)) and value is not None:
                given.arguments[argument] = Path(value)
        return function(*given.args, **given.kwargs)

    # Other processes find it where it is public.
    checked_call.__module__, checked_call.__qualname__ = "rotorfit", name
    return checked_call


def _types_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the types of a function's arguments, those that its module imports for them alone too.

    A type without a place here passes.
    """
    text = " ".join(str(annotation) for annotation in function.__annotations__.values())
    names = set(re.findall(r"[A-Za-z]\w*", text)) - vars(builtins).keys()
    known = inspect.unwrap(function).__globals__.keys()
    return get_type_hints(function, localns={n: _type_named(n) for n in names - known})


def _type_named(name: str) -> Any:
    for module in (collections.abc, typing, pathlib):
        if hasattr(module, name):
            return getattr(module, name)
    if name in ENTRIES:
        return getattr(import_module(ENTRIES[name]), name)
    return getattr(rotorfit, name) if name in dir(rotorfit) else Any


def _fits_type(value: Any, hint: Any) -> bool:
    """Return whether a value has a type; unknown types pass."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint in SIMPLE:
        # True is a number to Python, and a slip of the caller's.
        return isinstance(value, SIMPLE[hint][0]) and (hint is bool or not isinstance(value, bool))
    if origin in (Union, UnionType):
        return any(_fits_type(value, part) for part in parts)
    if origin is Literal:
        return value in parts
    if origin is tuple:
        return isinstance(value, tuple) and len(cast("tuple[Any, ...]", value)) == len(parts)
    if origin is Sequence:
        return isinstance(value, list | tuple) and _all_fit(cast("list[Any]", value), parts[0])
    if origin is Mapping:
        entries = cast("Mapping[Any, Any]", value)
        return isinstance(value, Mapping) and _all_fit(entries.values(), parts[1])
    if origin is Callable:
        return callable(value)
    return hint is Any or not inspect.isclass(hint) or isinstance(value, hint)


def _all_fit(values: Iterable[Any], hint: Any) -> bool:
    return all(_fits_type(value, hint) for value in values)


def _expected_type(value: object, hint: Any) -> str:
    """Describe the expected type in words."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint in SIMPLE:
        return SIMPLE[hint][1]
    if origin in (Union, UnionType):
        return " or ".join(_expected_type(value, part) for part in parts)
    if origin is Literal:
        near = get_close_matches(str(value), parts, n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        return f"{' or '.join(repr(part) for part in parts)}{meant}"
    if origin is tuple:
        return f"a tuple of {len(parts)}"
    if origin is Sequence:
        return f"a list, each {_expected_type(value, parts[0])}"
    if origin is Mapping:
        return f"a dict from name to {_expected_type(value, parts[1])}"
    if origin is Callable:
        return "a function"
    how = MADE_BY.get(hint.__name__)
    return f"{hint.__name__}{f' ({how})' if how else ''}"
