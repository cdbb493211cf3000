"""Strict tables of the experiment file: numbers, known keys and terms, problems as sentences."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING, Annotated, Any, Final, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from rotorfit.errors import LIST_ROTORS
from rotorfit.model.terms.registry import OPTIONAL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydantic_core import ErrorDetails

# Strict: neither true nor "1.285" is a number.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Finite, Field(gt=0)]
NotNegative = Annotated[Finite, Field(ge=0)]
Vector = tuple[Finite, Finite, Finite]


class Strict(BaseModel):
    """A table: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


EXPECTED: dict[str, str] = {
    "tuple_type": "should be a list [ ... ]",
    "model_type": "should be a table { ... }",
    "dict_type": "should be a table { ... }",
    "string_type": 'should be text in "quotes"',
    "too_short": "has too few entries",
}
"""The checker's types in the words of TOML."""
MOTORS, AIRFRAME = ": write it under [motors]", ": write it under [airframe]"
TABLES: dict[str, str] = {
    "mass": ": [[configuration]] of an experiment file, or give --mass",
    **dict.fromkeys(("speed", "law", "lag", "delay", "poles"), MOTORS),
    **dict.fromkeys(("layout", "order", "spacing", "arm", "rotors", "imu", "axes"), AIRFRAME),
}
"""Where a key belongs that stands in a table without it."""
SECONDS = ". It is in seconds (40 ms are 0.04)"
ELSE: dict[str, str] = {
    "airframe.order": f". Of any other order, {LIST_ROTORS}",
    "airframe.propeller": ". It is the diameter in metres (10 inch are 0.254)",
    **dict.fromkeys(("motors.lag", "motors.lag_std", "motors.lag_down", "motors.delay"), SECONDS),
}
"""What to do where no choice is right, or what the unit is, by place."""


def problem_sentences(details: list[ErrorDetails], known: list[str]) -> list[tuple[str, str]]:
    """Describe the problems that pydantic found: each place once, with a sentence.

    For an unknown key the sentence names the nearest of the known ones.
    """
    by_place: dict[str, list[ErrorDetails]] = {}
    for detail in details:
        if not _is_echo(detail):
            by_place.setdefault(_place_words(detail["loc"]), []).append(detail)
    return [(place, _describe_problem(place, found, known)) for place, found in by_place.items()]


def _is_echo(detail: ErrorDetails) -> bool:
    """Recognise a problem that repeats another one: a list is empty without its bad entries."""
    given = detail["input"]
    if detail["type"] == "too_short":
        return bool(given) and detail.get("ctx", {}).get("actual_length") == 0
    return detail["type"] == "string_type" and isinstance(given, dict)


def _describe_problem(place: str, details: list[ErrorDetails], known: list[str]) -> str:
    detail = details[0]
    if detail["type"] == "extra_forbidden":
        key = str(detail["loc"][-1])
        if key in TABLES:
            return f"{place}: {key} belongs to another table{TABLES[key]}"
        if place == key and key in known:
            return (
                f"{key} belongs in an experiment file, beside its [[configuration]]: leave it out, "
                "or run rotorfit identify EXPERIMENT.toml"
            )
        return f"unknown key {place}{_nearest_key(key, known)}"
    if detail["type"] == "missing":
        return f"{place} is missing"
    given = detail["input"]
    message = ", or ".join(_expected_words(d) for d in details)
    shown = "" if isinstance(given, dict | list | tuple) else f" (it is {given!r})"
    return f"{place}: {message}{shown}{ELSE.get(place, '')}" if place else message


def _expected_words(detail: ErrorDetails) -> str:
    message = detail["msg"].removeprefix("Value error, ")
    return EXPECTED.get(detail["type"], message.replace("Input should", "should", 1))


def _nearest_key(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f", did you mean {close[0]!r}?" if close else f"; known keys: {', '.join(known)}"


def _place_words(location: tuple[int | str, ...]) -> str:
    """Format a place such as configuration[0].mass, without the names of pydantic's types."""
    parts: list[str] = []
    for part in location:
        if isinstance(part, int):
            parts[-1:] = [f"{parts[-1]}[{part}]"] if parts else [f"[{part}]"]
        elif part.isidentifier() and part not in ("float", "str", "ColumnEntry", "int"):
            parts.append(part)
    return ".".join(parts)


TERM_NAMES: Final = tuple(term.name for term in OPTIONAL)
"""Names of the optional terms of the model, in the order of the documentation."""


def known_terms(given: object, info: Any) -> object:
    """Check the terms that a file names; each is named once.

    Raises `ValueError` if a name is no term, with the nearest one; or if the method has its own.
    """
    if given is None or not isinstance(given, list | tuple):
        return given
    if info.data.get("method", "banded") != "banded" or info.data.get("preset") is not None:
        raise ValueError('they belong to method = "banded"; the other methods have their own')
    names = [str(name) for name in cast("Sequence[object]", given)]
    for name in names:
        if name not in TERM_NAMES:
            close = difflib.get_close_matches(name, TERM_NAMES, n=1, cutoff=0.4)
            nearest = f", did you mean {close[0]!r}?" if close else ";"
            raise ValueError(f"no term {name!r}{nearest} known terms: {', '.join(TERM_NAMES)}")
    return tuple(dict.fromkeys(names))


Terms = Annotated[tuple[str, ...], BeforeValidator(known_terms)]
"""What stands under ``terms`` of an experiment."""
