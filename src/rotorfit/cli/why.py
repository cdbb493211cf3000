"""rotorfit why: what makes up the interval of a number, and what would shrink it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.terminal import AsJson, ResultFile, print_result, terminal_width

if TYPE_CHECKING:
    from rotorfit.results.result import IdentificationResult


def why(
    result: ResultFile,
    number: Annotated[
        str | None,
        typer.Argument(
            metavar="NUMBER",
            help="A number of the result, such as Ixx; default: the main ones.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """State what makes up an interval, and what would shrink it.

    Prints the uncertainty budget: every contribution to the 95 % interval, the largest first.
    """
    from rotorfit.results.sound_result import load_sound

    if number is not None and not result.exists() and Path(number).is_file():
        words = shlex.join(["rotorfit", "why", number, str(result)])
        raise typer.BadParameter(f"the result comes before the number: {words}")
    print_result(budget_output(load_sound(result), number, as_json=as_json))


def budget_output(result: IdentificationResult, number: str | None, *, as_json: bool) -> str:
    """Return the budget of a number, or of the main ones, as text or JSON."""
    from rotorfit.report.budget import budget_text, budgets_in_short
    from rotorfit.results.budget import budget_of, budgets_named

    width = terminal_width()
    if as_json:
        every = (budget_of(result, n) for n in (*result.parameters, *result.derived))
        found = every if number is None else budgets_named(result, number)
        return json.dumps([one.to_plain() for one in found], indent=1, allow_nan=False)
    if number is None:
        return budgets_in_short(result, width=width)
    return budget_text(budgets_named(result, number), width=width)
