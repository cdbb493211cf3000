"""Check that a saved result is whole and consistent.

Files that `rotorfit identify -o` wrote always are. Every command that takes a result takes
whole ones only.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.model.parameters import DERIVED, PARAMETERS, effective_unit
from rotorfit.results.result import Derived, IdentificationResult, Parameter, Verdict

if TYPE_CHECKING:
    from pathlib import Path

LARGEST: Final = 1e9
"""No SI number of a vehicle comes near it, and sums and squares of such ones stay finite."""
SMALLEST: Final = 1e-18
"""No mass, inertia or coefficient of a vehicle is under it."""
ABOVE_ZERO: Final = ("mass", "kt", "kd")


def load_sound(path: Path) -> IdentificationResult:
    """Load a saved result; raise `OutputError` where it is none, or not whole."""
    try:
        result = IdentificationResult.load(path)
    except (AttributeError, RecursionError) as error:  # a list or text where a table was
        raise OutputError(
            f"{path} is not a rotorfit result ({error}); give the JSON file that rotorfit "
            "identify -o wrote"
        ) from error
    try:
        refuse_unsound(result)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    return result


def refuse_unsound(result: IdentificationResult) -> None:
    """Raise `OutputError` at the first number that no identification gives, and state why."""
    found = _structure_fault(result)
    if found is None:
        entries = (*result.parameters, *result.derived)
        found = next(
            (words for e in entries if (words := _entry_fault(e))), None
        ) or _doubled_number(result)
    if found is not None:
        raise OutputError(f"the result was changed since it was written ({found}); identify again")


def _structure_fault(result: IdentificationResult) -> str | None:
    tables: tuple[tuple[str, Any], ...] = (
        ("settings", result.settings),
        ("versions", result.versions),
    )
    for name, table in tables:
        if not isinstance(table, dict):
            return f"{name} is not a table"
    covariance = result.covariance
    if not (np.abs(covariance) <= LARGEST**2).all():
        return "the covariance holds something that is not a number"
    names: tuple[Any, ...] = result.covariance_names
    if not all(isinstance(name, str) for name in names):
        return "the covariance has names that are not text"
    if result.axes != "FLU":
        return f"axes are {result.axes!r}, but FLU in every result"
    return None


def _doubled_number(result: IdentificationResult) -> str | None:
    """Describe the first number that is there twice."""
    for entries in (result.parameters, result.derived):
        counted = Counter((e.name, e.configuration) for e in entries)
        twice = next((name for (name, _), count in counted.items() if count > 1), None)
        if twice is not None:
            return f"{twice} is listed twice"
    return None


def _entry_fault(entry: Parameter | Derived) -> str | None:
    """Describe the first fault of one number."""
    name: Any = entry.name
    known = PARAMETERS if isinstance(entry, Parameter) else DERIVED
    if not isinstance(name, str) or name not in known:
        return f"there is no number {name!r}"
    texts: list[tuple[str, Any]] = [("unit", entry.unit), ("configuration", entry.configuration)]
    if isinstance(entry, Parameter):
        texts += [("reason", entry.reason), ("with", entry.partner)]
        if entry.verdict not in get_args(Verdict):
            return f"{name} has the verdict {entry.verdict!r}, which does not exist"
    for field, text in texts:
        if not isinstance(text, str) and (text is not None or field == "unit"):
            return f"{field} of {name} is {text!r}, not text"
    unit = known[name].unit
    if entry.unit.removesuffix(" per kg") not in (unit, effective_unit(name, unit)):
        return f"{name} is in {entry.unit!r}, but its unit is {unit}"
    return (
        _value_fault(name, entry.value) or _interval_fault(name, entry) or _terms_fault(name, entry)
    )


def _terms_fault(name: str, entry: Parameter | Derived) -> str | None:
    """Describe the fault of the interval terms: a name, a source, and a half-width each."""
    for term in entry.interval_terms:
        texts: tuple[Any, ...] = (term.name, term.source)
        half: Any = term.half_width
        if not all(isinstance(text, str) for text in texts):
            return f"an interval term of {name} has no name or no source"
        if (
            isinstance(half, bool)
            or not isinstance(half, int | float)
            or not 0.0 <= half < math.inf
        ):
            return f"the interval term {term.name!r} of {name} is {half!r}, not a half-width"
    return None


def _value_fault(name: str, value: Any) -> str | None:
    """Describe the fault of a value: none is fine, NaN is not."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return f"{name} is {value!r}, not a number"
    small = name in ABOVE_ZERO and 0.0 < value < SMALLEST
    if abs(value) > LARGEST or small:
        return f"{name} is {value:.3g}, which nothing that flies has"
    return None


def _interval_fault(name: str, entry: Parameter | Derived) -> str | None:
    """Describe the fault of an interval: two ends in order, the value between them."""
    ends: Any = entry.interval
    if ends is None:
        return None
    right = len(ends) == 2 and all(
        isinstance(end, int | float) and not isinstance(end, bool) and math.isfinite(end)
        for end in ends
    )
    if not right or ends[0] > ends[1]:
        return f"the interval of {name} is {list(ends)!r}"
    return None
