"""The uncertainty budget in words, as a table of the page, and as a stacked bar."""

from __future__ import annotations

import textwrap
from math import sqrt
from typing import TYPE_CHECKING, Final

from rotorfit.digits import short, with_half
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import INERTIA_COM, title_of
from rotorfit.report.pages import drawing, tag, text
from rotorfit.report.parameters import unit_words
from rotorfit.results.budget import Budget, BudgetLine, budget_of
from rotorfit.results.result import MAIN, IdentificationResult

if TYPE_CHECKING:
    from collections.abc import Sequence

LEAST_SHARE: Final = 0.01
"""Share of the squared half-width under which lines are printed as one: together they change the
interval by half as much."""
IN_SHORT: Final = 4
"""Contributions that a line in short names."""
BAR: Final = 20
"""Letters of a bar of the whole interval."""
WIDTH: Final = 260.0
HEIGHT: Final = 16.0
TERM_WIDTH: Final = 24
"""Letters of the longest name of a term, and one."""
NO_TERMS: Final = "the file is of an older version and does not say: identify again"
SHOWN: Final = (*MAIN, *INERTIA_COM[3:], "hover_throttle", "thrust_to_weight", "max_thrust")
"""Numbers of the table of the page."""


def size_words(half: float, budget: Budget) -> str:
    """Write a half-width in percent of the value, or in its unit where the value is near zero."""
    value = budget.value
    if value and (budget.half_width or 0.0) < abs(value):
        return f"{short(100.0 * half / abs(value))} %"
    return f"{half:.2g}{_unit_suffix(budget)}"


def _unit_suffix(budget: Budget) -> str:
    return "" if budget.unit == "1" else f" {budget.unit}"


def budget_text(budgets: Sequence[Budget], *, width: int = 100) -> str:
    """Write the budgets of some numbers, one paragraph each."""
    return "\n\n".join("\n".join(_budget_paragraph(one, width)) for one in budgets)


def budgets_in_short(result: IdentificationResult, *, width: int = 100) -> str:
    """Write one line for each main number: its interval and the largest contributions."""
    found = (budget_of(result, n) for n in (*result.parameters, *result.derived))
    lines = [in_short(one) for one in found if one.name in MAIN and one.half_width is not None]
    wrapped = [textwrap.fill(line, width, subsequent_indent="    ") for line in lines]
    return "\n".join([*wrapped, "", "one number in full: rotorfit why RESULT NUMBER"])


def in_short(budget: Budget) -> str:
    """Write a number with the largest contributions to its interval in one line."""
    parts = [
        f"{line.name} {size_words(line.half_width, budget)}"
        for line in budget.lines[:IN_SHORT]
        if line.share >= LEAST_SHARE
    ]
    return f"{_budget_number(budget)}: {', '.join(parts) or NO_TERMS}"


def _budget_number(budget: Budget) -> str:
    assert budget.value is not None
    unit, half = _unit_suffix(budget), budget.half_width
    if half is None:
        return f"{budget.full_name} {budget.value:.6g}{unit}"
    percent = size_words(half, budget)
    shown = f", +- {percent}" if percent.endswith("%") else ""
    return f"{budget.full_name} {with_half(budget.value, half)}{unit}{shown}"


def _budget_paragraph(budget: Budget, width: int) -> list[str]:
    """Write a number, a line for each contribution, what shrinks them, and what that gives."""
    if budget.value is None or budget.half_width is None:
        return _without_interval(budget, width)
    lines = [f"{_budget_number(budget)}" + (f" ({budget.verdict})" if budget.verdict else "")]
    if not budget.lines:
        return [*lines, f"  {NO_TERMS}"]
    shown = [line for line in budget.lines if line.share >= LEAST_SHARE]
    for line in shown:
        size = size_words(line.half_width, budget)
        lines.append(f"  {line.name:<{TERM_WIDTH}}{size:>9}  {_share_bar(line.share)}")
    rest = budget.lines[len(shown) :]
    if rest:
        half = sqrt(sum(max(line.share, 0.0) for line in rest)) * budget.half_width
        words = f"{len(rest)} smaller"
        lines.append(f"  {words:<{TERM_WIDTH}}{size_words(half, budget):>9}")
    return [*lines, *_list_remedies(shown, width), *textwrap.wrap(_gain_sentence(budget), width)]


def _list_remedies(lines: Sequence[BudgetLine], width: int) -> list[str]:
    """Write what shrinks the contributions, each action once, the largest contribution first."""
    actions: dict[str, list[str]] = {}
    for line in lines:
        actions.setdefault(line.action, []).append(line.name)
    out = ["To shrink it:"]
    for action, names in actions.items():
        words = f"{', '.join(names)}: {action}"
        out += textwrap.wrap(words, width, initial_indent="  ", subsequent_indent="    ")
    return out


def _share_bar(share: float) -> str:
    return "#" * max(1, round(BAR * share))


def _gain_sentence(budget: Budget) -> str:
    """State how wide the interval would be with half of its largest contribution."""
    assert budget.half_width is not None
    largest = budget.lines[0]
    left = budget.half_width * sqrt(max(1.0 - 0.75 * largest.share, 0.0))
    return f"Half of the part by {largest.name} would leave +- {size_words(left, budget)}."


def _without_interval(budget: Budget, width: int) -> list[str]:
    """Explain why a number has no interval, and what to do."""
    if budget.value is not None:
        given = f"{budget.value:.6g}{_unit_suffix(budget)}"
        return [f"{budget.full_name} {given}: given without a tolerance"]
    why = f": {budget.reason}" if budget.reason else ""
    lines = textwrap.wrap(f"{budget.full_name} is {budget.verdict}{why}", width)
    if budget.advice:
        lines += textwrap.wrap(
            f"to do: {budget.advice}", width, initial_indent="  ", subsequent_indent="  "
        )
    return lines


@frozen_dataclass
class BudgetRow:
    """One number of the page's table; `parts` are its contributions in words with their remedy."""

    name: str
    title: str
    half: str
    bar: str
    parts: tuple[tuple[str, str, str], ...]
    action: str


def budget_rows(result: IdentificationResult) -> tuple[BudgetRow, ...]:
    """Tabulate the budgets of the main numbers, for the page."""
    found = (budget_of(result, n) for n in (*result.parameters, *result.derived))
    return tuple(_budget_row(one) for one in found if one.name in SHOWN and one.lines)


def _budget_row(budget: Budget) -> BudgetRow:
    shown = [line for line in budget.lines if line.share >= LEAST_SHARE]
    return BudgetRow(
        name=budget.full_name,
        title=title_of(budget.name),
        half=unit_words(size_words(budget.half_width or 0.0, budget)),
        bar=budget_bar(budget.lines),
        parts=tuple(
            (one.name, unit_words(size_words(one.half_width, budget)), one.remedy) for one in shown
        ),
        action=budget.lines[0].action,
    )


def budget_bar(lines: Sequence[BudgetLine]) -> str:
    """Draw the shares of an interval side by side, coloured by what shrinks them."""
    parts: list[str] = []
    left = 0.0
    for line in lines:
        width = max(line.share, 0.0) * WIDTH
        title = tag("title", {}, text(f"{line.name}: {short(100.0 * line.share)} % of the square"))
        parts.append(
            tag(
                "rect",
                {
                    "class": f"term remedy-{line.remedy}",
                    "x": left,
                    "y": 1.0,
                    "width": width,
                    "height": HEIGHT - 2.0,
                },
                title,
            )
        )
        left += width
    return drawing(WIDTH, HEIGHT, {"class": "budget", "aria-hidden": "true"}, *parts)
