"""One way to fly, what it would give, and how it is shown beside others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rotorfit.planning.wanted import Wanted, shown_width
from rotorfit.results.result import Verdict

ScheduleName = Literal["hover", "axes", "sticks", "doublets", "wiggles", "turns", "mixed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedNumber:
    """One number as `identify` would give it: half of its 95 % interval, SI, and its verdict."""

    name: str
    value: float
    half_width: float
    verdict: Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One way to fly, and what it would give.

    Attributes
    ----------
    schedule
        What is flown.
    seconds
        Of each flight [s].
    payload
        Whether it is flown bare and again with the payload.
    numbers
        By the names of `WANTABLE`.
    meets
        Whether all that is wanted is reached.
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
    """Return the largest half-width in parts of what is wanted."""
    numbers = candidate.numbers.values()
    return wanted.worst({n.name: n.half_width for n in numbers}, {n.name: n.value for n in numbers})


def candidate_rows(candidates: Sequence[Candidate], wanted: Wanted) -> list[tuple[str, ...]]:
    """Return candidates as rows of text, nearest to what is wanted first."""
    return [
        (
            flight_words(c),
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
    """Return candidates as columns: what is flown, and half of the interval of each number, SI."""
    names = list(dict.fromkeys(name for c in candidates for name in c.numbers))
    fields = ("schedule", "seconds", "payload", "total_seconds", "meets")
    columns: dict[str, list[Any]] = {f: [getattr(c, f) for c in candidates] for f in fields}
    for name in names:
        found = [c.numbers.get(name) for c in candidates]
        columns[name] = [None if n is None else n.half_width for n in found]
    return columns


def flight_words(candidate: Candidate) -> str:
    """Return what is flown in words."""
    twice = ", bare and with payload" if candidate.payload else ""
    return f"{candidate.schedule} {candidate.seconds:g} s{twice}"
