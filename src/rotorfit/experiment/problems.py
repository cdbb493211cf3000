"""What is wrong with an experiment file, in the words of TOML and of people who fly."""

import difflib

from pydantic_core import ErrorDetails

EXPECTED: dict[str, str] = {
    "tuple_type": "should be a list [ ... ]",
    "model_type": "should be a table { ... }",
    "dict_type": "should be a table { ... }",
    "string_type": 'should be text in "quotes"',
    "too_short": "has too few entries",
}
"""The checker's types in the words of TOML."""


def problems_in_words(details: list[ErrorDetails], known: list[str]) -> list[tuple[str, str]]:
    """Return every problem that the checker found, once for each place: the place, and a sentence.

    Parameters
    ----------
    details
        From pydantic.
    known
        Every key of the format, for the nearest to an unknown one.
    """
    by_place: dict[str, list[ErrorDetails]] = {}
    for detail in details:
        if not _is_echo(detail):
            by_place.setdefault(_place(detail["loc"]), []).append(detail)
    return [(place, _problem(place, found, known)) for place, found in by_place.items()]


def _is_echo(detail: ErrorDetails) -> bool:
    """Whether a problem only repeats another one: a list that is empty without its bad entries."""
    given = detail["input"]
    if detail["type"] == "too_short":
        return bool(given) and detail.get("ctx", {}).get("actual_length") == 0
    return detail["type"] == "string_type" and isinstance(given, dict)


def _problem(place: str, details: list[ErrorDetails], known: list[str]) -> str:
    """Return the problem at one place, with the nearest known key for an unknown one."""
    detail = details[0]
    if detail["type"] == "extra_forbidden":
        return f"unknown key {place}{_nearest(str(detail['loc'][-1]), known)}"
    if detail["type"] == "missing":
        return f"{place} is missing"
    given = detail["input"]
    message = ", or ".join(_expected(d) for d in details)
    shown = "" if isinstance(given, dict | list | tuple) else f" (it is {given!r})"
    return f"{place}: {message}{shown}" if place else message


def _expected(detail: ErrorDetails) -> str:
    message = detail["msg"].removeprefix("Value error, ")
    return EXPECTED.get(detail["type"], message.replace("Input should", "should", 1))


def _nearest(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f", did you mean {close[0]!r}?" if close else f"; known keys: {', '.join(known)}"


def _place(location: tuple[int | str, ...]) -> str:
    """Return a place such as configuration[0].mass, without the checker's own words."""
    words: list[str] = []
    for part in location:
        if isinstance(part, int):
            words[-1:] = [f"{words[-1]}[{part}]"] if words else [f"[{part}]"]
        elif part.isidentifier() and part not in ("float", "str", "ColumnEntry", "int"):
            words.append(part)
    return ".".join(words)
