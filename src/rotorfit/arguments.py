"""What is handed to a public function, looked at once, at the door.

A path may be text. What is of the wrong kind is refused in one line that names the argument and
says what makes the right thing, instead of an error from deep inside.
"""

import functools
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, Union, cast, get_args, get_origin, get_type_hints

MADE_BY: Final = {
    "AirframeEntry": "experiment.airframe is one",
    "Experiment": "rotorfit.load_experiment makes one",
    "FlightLog": "rotorfit.read_log makes one",
    "FlightPlan": "rotorfit.plan makes one",
    "IdentificationResult": "rotorfit.identify and rotorfit.IdentificationResult.load make one",
    "MotorsEntry": "experiment.motors is one",
    "WrenchComparison": "rotorfit.validate_file makes one",
}
"""Where a thing comes from that a caller did not hand over."""
SIMPLE: Final[dict[Any, tuple[type | tuple[type, ...], str]]] = {
    Path: ((str, os.PathLike), "a path"),
    bool: (bool, "True or False"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    str: (str, "text"),
    NoneType: (NoneType, "None"),
}


def checked(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a public function that takes paths as text too, and refuses the wrong kind of thing.

    Parameters
    ----------
    function
        With a type for each of its arguments.
    name
        Under which it is public.
    """
    signature = inspect.signature(function)
    hints = get_type_hints(function)

    @functools.wraps(function)
    def at_the_door(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # refused in Python's own words
        for argument, value in given.arguments.items():
            hint = hints[argument]
            if not _fits(value, hint):
                raise TypeError(_refusal(f"{name}: {argument}", value, hint))
            if Path in (hint, *get_args(hint)) and value is not None:
                given.arguments[argument] = Path(value)
        return function(*given.args, **given.kwargs)

    # Other processes find it where it is public.
    at_the_door.__module__, at_the_door.__qualname__ = "rotorfit", name
    return at_the_door


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of a kind; what is not known here is let through."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint in SIMPLE:
        # True is a number to Python, and a slip of the caller's.
        return isinstance(value, SIMPLE[hint][0]) and (hint is bool or not isinstance(value, bool))
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Literal:
        return value in parts
    if origin is tuple:
        return isinstance(value, tuple) and len(_each(value)) == len(parts)
    if origin is Sequence:
        return isinstance(value, list | tuple) and all(_fits(v, parts[0]) for v in _each(value))
    if origin is Mapping:
        return isinstance(value, Mapping) and all(_fits(v, parts[1]) for v in _each(value))
    if origin is Callable:
        return callable(value)
    return not inspect.isclass(hint) or isinstance(value, hint)


def _each(value: Any) -> list[Any]:
    """Return what is in a row, or the values of a mapping."""
    if isinstance(value, Mapping):
        return list(cast("Mapping[Any, Any]", value).values())
    return list(value)


def _refusal(argument: str, value: object, hint: Any) -> str:
    shown = (
        repr(value)
        if isinstance(value, str | float | int | NoneType)
        else f"of type {type(value).__name__}"
    )
    return f"{argument} is {shown}, expected {_expected(value, hint)}"


def _expected(value: object, hint: Any) -> str:
    """Return what was wanted, in words."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint in SIMPLE:
        return SIMPLE[hint][1]
    if origin in (Union, UnionType):
        return " or ".join(_expected(value, part) for part in parts)
    if origin is Literal:
        near = get_close_matches(str(value), parts, n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        return f"{' or '.join(repr(part) for part in parts)}{meant}"
    if origin is tuple:
        return f"a tuple of {len(parts)}"
    if origin is Sequence:
        return f"a list, each {_expected(value, parts[0])}"
    if origin is Mapping:
        return f"a dict from name to {_expected(value, parts[1])}"
    if origin is Callable:
        return "a function"
    how = MADE_BY.get(hint.__name__)
    return f"{hint.__name__}{f' ({how})' if how else ''}"
