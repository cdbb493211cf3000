"""The accuracy wanted of each number, and the accuracy that one way to fly gives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Literal

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rotorfit.results.result import Verdict

WANTABLE: Final[Mapping[str, str]] = {
    **{name: name for name in ("kt", "kd", "Jr")},
    **{name: f"{name}_com@A" for name in ("Ixx", "Iyy", "Izz")},
    **{name: f"{name}@A" for name in ("com_x", "com_y", "com_z")},
}
"""What can be asked for, and its name among the predicted numbers; inertia about the CoM."""
IN_MM: Final = ("com_x", "com_y", "com_z")
"""Wanted in millimetres; everything else in percent."""
USUAL: Final = ("kt", "kd", "Ixx", "Iyy", "Izz")
"""What a single percentage is wanted of."""
ScheduleName = Literal["hover", "axes", "sticks", "doublets", "wiggles", "turns", "mixed"]


@frozen_dataclass
class Wanted:
    """The accuracy wanted.

    Attributes
    ----------
    limits
        By the names of `WANTABLE`: percent of the value, for the CoM millimetres.
    """

    limits: Mapping[str, float]

    def met_by(self, half_widths: Mapping[str, float], values: Mapping[str, float]) -> bool:
        """State whether half-widths (SI) of these values are all small enough."""
        return self.worst(half_widths, values) <= 1.0

    def worst(self, half_widths: Mapping[str, float], values: Mapping[str, float]) -> float:
        """Compute the largest half-width in parts of its limit; what has no number is infinite."""
        shares = [
            shown_width(name, half_widths.get(name, math.inf), values.get(name, 1.0)) / limit
            for name, limit in self.limits.items()
        ]
        return max(shares)


def shown_width(name: str, half_width: float, value: float) -> float:
    """Return a half-width in the unit it is wanted in: millimetres for the CoM, else percent."""
    return 1e3 * half_width if name in IN_MM else 100.0 * half_width / abs(value)


def wanted_accuracy(text: str) -> Wanted:
    """Parse the accuracy of words such as ``5`` or ``kd=2,Izz=3,com_x=1``.

    Parameters
    ----------
    text
        One percentage for kt, kd, Ixx, Iyy and Izz, or names with their own: half of the 95 %
        interval in percent of the value, for the CoM in mm.

    Raises
    ------
    ExperimentError
        If they name nothing known, or no sensible number.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1 and "=" not in parts[0]:
        return Wanted(limits=dict.fromkeys(USUAL, _parse_limit(parts[0], "accuracy")))
    limits: dict[str, float] = {}
    for part in parts:
        name, sign, number = (word.strip() for word in part.partition("="))
        if not sign or name not in WANTABLE:
            raise ExperimentError(
                f"accuracy {part!r}, expected one percentage such as 5, or names with percentages "
                f"such as kd=2,Izz=3; names: {', '.join(WANTABLE)} ({', '.join(IN_MM)} in mm)"
            )
        limits[name] = _parse_limit(number, name)
    return Wanted(limits=limits)


def _parse_limit(text: str, name: str) -> float:
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not (math.isfinite(limit) and limit > 0):
        raise ExperimentError(f"{name} {text!r} is no accuracy; give a number over 0, such as 5")
    return limit


@frozen_dataclass
class PredictedNumber:
    """One number as `identify` would give it: half of its 95 % interval, SI, and its verdict.

    `largest_term`: name of the largest contribution to the interval.
    """

    name: str
    value: float
    half_width: float
    verdict: Verdict
    largest_term: str = "noise"


@frozen_dataclass
class Candidate:
    """One way to fly, for some seconds each flight, and the numbers by the names of `WANTABLE`.

    With a `payload` it is flown bare and again with the payload; `meets`: all that is wanted.
    """

    schedule: ScheduleName
    seconds: float
    payload: bool
    numbers: Mapping[str, PredictedNumber]
    meets: bool

    @property
    def total_seconds(self) -> float:
        """Of all its flights together [s]."""
        return self.seconds * (2.0 if self.payload else 1.0)


def worst(candidate: Candidate, wanted: Wanted) -> float:
    """Compute the largest half-width in parts of what is wanted."""
    numbers = candidate.numbers.values()
    return wanted.worst({n.name: n.half_width for n in numbers}, {n.name: n.value for n in numbers})


def candidate_rows(candidates: Sequence[Candidate], wanted: Wanted) -> list[tuple[str, ...]]:
    """Format candidates as rows, nearest to what is wanted first."""
    return [
        (
            candidate_title(c),
            "yes" if c.meets else "no",
            *(
                f"{shown_width(name, n.half_width, n.value):.2g}" if n and n.value else "-"
                for name in wanted.limits
                for n in [c.numbers.get(name)]
            ),
        )
        for c in sorted(candidates, key=lambda c: worst(c, wanted))
    ]


def candidate_columns(candidates: Sequence[Candidate]) -> dict[str, list[Any]]:
    """Tabulate candidates: what is flown, and half of the interval of each number, SI."""
    names = list(dict.fromkeys(name for c in candidates for name in c.numbers))
    fields = ("schedule", "seconds", "payload", "total_seconds", "meets")
    columns: dict[str, list[Any]] = {f: [getattr(c, f) for c in candidates] for f in fields}
    for name in names:
        found = [c.numbers.get(name) for c in candidates]
        columns[name] = [None if n is None else n.half_width for n in found]
    return columns


def candidate_title(candidate: Candidate) -> str:
    """Describe the flights of a candidate."""
    twice = ", bare and with payload" if candidate.payload else ""
    return f"{candidate.schedule} {candidate.seconds:g} s{twice}"
