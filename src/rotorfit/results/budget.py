"""The uncertainty budget of a number: what makes up its interval, and what would shrink each part.

References
----------
JCGM 100:2008 (GUM), 5.1 and Annex H: a budget lists every contribution to a combined uncertainty.
"""

from __future__ import annotations

from dataclasses import asdict
from difflib import get_close_matches
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from rotorfit.checks.verdicts.judge import ADVICE, Derived, Parameter, Verdict, motion_for
from rotorfit.digits import known
from rotorfit.errors import OutputError
from rotorfit.fit.intervals.interval_terms import (
    TERM_KINDS,
    NumberTerm,
    Remedy,
    TermKind,
    half_width_of_number,
)
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.result import IdentificationResult, verdict_of

if TYPE_CHECKING:
    from collections.abc import Sequence

UNKNOWN_KIND: Final = TermKind(remedy="none", action="unknown to this version of rotorfit")
"""Of a term that a later version wrote."""


@frozen_dataclass
class BudgetLine:
    """One contribution to an interval.

    - `name`, `half_width`, `source`: as of the interval term; the half-width in the unit of the
      number.
    - `share`: of the squared half-width of the number [-]; the shares of all lines add up to 1.
    - `remedy`: what shrinks it: ``fly``, ``measure``, ``declare``, ``log``, ``repair`` or ``none``.
    - `action`: what to do for that.
    """

    name: str
    half_width: float
    share: float
    source: str
    remedy: Remedy
    action: str


@frozen_dataclass
class Budget:
    """What makes up the interval of one number, the largest contribution first.

    - `name`, `configuration`, `unit`, `value`, `verdict`, `reason`, `advice`: of the number, as in
      the result.
    - `half_width`: half of the 95 % interval; None without an interval.
    - `lines`: the contributions; empty without an interval, and of results of older versions.
    """

    name: str
    configuration: str | None
    unit: str
    value: float | None
    half_width: float | None
    verdict: Verdict | str
    reason: str | None
    advice: str | None
    lines: tuple[BudgetLine, ...]

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``Ixx@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name

    def to_plain(self) -> dict[str, Any]:
        """Return the budget as tables of JSON."""
        plain = asdict(self)
        plain["terms"] = list(plain.pop("lines"))
        return plain


def budget_of(result: IdentificationResult, number: Parameter | Derived) -> Budget:
    """Return the uncertainty budget of a number of a result."""
    std = known(number.std)
    return Budget(
        name=number.name,
        configuration=number.configuration,
        unit=number.unit,
        value=known(number.value),
        half_width=None if std is None else 1.96 * std,
        verdict=verdict_of(result, number),
        reason=number.reason,
        advice=number.advice if isinstance(number, Parameter) else None,
        lines=budget_lines(number),
    )


def budget_lines(number: Parameter | Derived) -> tuple[BudgetLine, ...]:
    """Return the contributions to the interval of a number, the largest first."""
    terms = number.interval_terms
    shares = _shares_of_terms(terms)
    lines = [
        BudgetLine(
            name=term.name,
            half_width=term.half_width,
            share=share,
            source=term.source,
            remedy=TERM_KINDS.get(term.name, UNKNOWN_KIND).remedy,
            action=_action_for(term.name, number.name),
        )
        for term, share in zip(terms, shares, strict=True)
    ]
    return tuple(sorted(lines, key=lambda line: -line.share))


def _shares_of_terms(terms: Sequence[NumberTerm]) -> list[float]:
    """Return by which share of the final squared half-width each term raises it."""
    whole = half_width_of_number(terms) ** 2
    reached = [half_width_of_number(terms[:i]) ** 2 for i in range(len(terms) + 1)]
    return [(after - before) / whole if whole > 0.0 else 0.0 for before, after in pairwise(reached)]


def _action_for(term: str, number: str) -> str:
    """Return the action against a term of a number: its own manoeuvre where flying helps."""
    return TERM_KINDS.get(term, UNKNOWN_KIND).action or ADVICE[motion_for(number)]


def budgets_named(result: IdentificationResult, name: str) -> tuple[Budget, ...]:
    """Return the budgets of a number, ``Ixx`` of every configuration or ``Ixx@A`` of one.

    Raises
    ------
    OutputError
        If the result has no such number.
    """
    numbers = (*result.parameters, *result.derived)
    found = [n for n in numbers if name in (n.name, n.full_name)]
    if not found:
        names = list(dict.fromkeys(n.name for n in numbers))
        near = get_close_matches(name, names, n=1)
        hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(names)}"
        raise OutputError(f"the result has no number {name!r}; {hint}")
    return tuple(budget_of(result, number) for number in found)
