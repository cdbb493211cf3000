"""rotorfit validate: whether a result predicts flights that its fit has not seen."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.terminal import (
    AsJson,
    End,
    LogNumber,
    ResultFile,
    Start,
    load_modules,
    print_result,
    quiet_steps,
    terminal_width,
)

if TYPE_CHECKING:
    from rotorfit.results.validation.judgement import Judgement
    from rotorfit.results.validation.wrench_comparison import WrenchComparison


def validate(
    result: ResultFile,
    flights: Annotated[
        list[Path], typer.Argument(metavar="FLIGHT", help="Flights that the fit has not seen.")
    ],
    configuration: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Configuration that was flown; not needed if the result has only one.",
        ),
    ] = None,
    log: LogNumber = None,
    start: Start = None,
    end: End = None,
    as_json: AsJson = False,
) -> None:
    """Check a result on flights that its fit has not seen.

    Compares what the motion needs with what the rotors produce, for thrust and the three moments.
    """
    load_modules("rotorfit.results.validation.validate")
    from rotorfit.results.sound_result import load_sound
    from rotorfit.results.validation.judgement import doubtful_numbers, judgement, moment_splits
    from rotorfit.results.validation.replayed_flights import validated_flight
    from rotorfit.results.validation.validate import unseen_flight, validation_rows

    loaded = load_sound(result)
    comparisons: list[WrenchComparison] = []
    judgements: list[Judgement] = []
    with quiet_steps() as report_progress:
        for flight in flights:
            report_progress(f"reading {flight.name}")
            used = unseen_flight(loaded, flight, log_number=log, start=start, end=end)
            compared, replays = validated_flight(loaded, used, configuration=configuration)
            comparisons.append(compared)
            judgements.append(
                judgement(
                    replays,
                    comparisons=() if replays else (compared,),
                    doubtful=doubtful_numbers(loaded, compared.configuration),
                )
            )
    if as_json:
        rows = [
            {
                **row,
                "judgement": one.to_plain(),
                "moments": [split.to_plain() for split in moment_splits([compared])],
            }
            for row, one, compared in zip(
                validation_rows(comparisons), judgements, comparisons, strict=True
            )
        ]
        print_result(json.dumps(rows, indent=1, allow_nan=False))
    else:
        print_result(validation_text(comparisons, judgements))


def validation_text(
    comparisons: Sequence[WrenchComparison], judgements: Sequence[Judgement]
) -> str:
    """Format the relative errors as a table, in percent, and what each flight says."""
    from rotorfit.digits import short
    from rotorfit.report.parameters import NOTHING_PREDICTED, PREDICTED_WELL
    from rotorfit.results.validation.judgement import moment_sentences
    from rotorfit.results.validation.wrench_comparison import SHOWN

    width = max(len(c.flight) for c in comparisons)
    lines = [
        "Prediction error of thrust and moments below 3 Hz: root mean square of what the",
        "rotors produce less what the motion needs, in % of what the rotors produce",
        f"  {'':<{width}}  configuration" + "".join(f"{name:>8}" for name in SHOWN),
    ]
    for c in comparisons:
        errors = [c.relative_error.get(name) for name in SHOWN]
        cells = [f"{'-':>8}" if error is None else f"{short(100 * error):>8}" for error in errors]
        lines.append(f"  {c.flight:<{width}}  {c.configuration:<13}{''.join(cells)}")
    if any(len(c.relative_error) < len(SHOWN) for c in comparisons):
        lines.append("  -: the result does not know the parameters of that component")
    lines += textwrap.wrap(PREDICTED_WELL, terminal_width())
    for c, one in zip(comparisons, judgements, strict=True):
        name = f"{c.flight}: " if len(comparisons) > 1 else ""
        lines += textwrap.wrap(f"{name}{one.sentence}", terminal_width())
        for words in moment_sentences([c]):
            lines += textwrap.wrap(words, terminal_width(), subsequent_indent="  ")
    if any(error >= 1.0 for c in comparisons for error in c.relative_error.values()):
        lines += textwrap.wrap(NOTHING_PREDICTED, terminal_width())
    return "\n".join(lines)
