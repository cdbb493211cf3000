"""rotorfit loop: how far the flown rate controller is from oscillating."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Force,
    Page,
    ResultFile,
    coloured,
    print_result,
    print_status,
    refuse_output_files,
    steps,
    terminal_width,
    write_pictures,
)


def loop(
    result: ResultFile,
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="A log of PX4 (ULog) or ArduCopter (.bin).")
    ],
    configuration: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which flew; not needed if the result has only one."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write the numbers as JSON here."),
    ] = None,
    report: Page = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Show how far the tune is from oscillating, with intervals.

    Gains and filters are read from the log, the vehicle with its delays from the result; the
    margins of the rate loop are proved on the flight itself, or withheld with the reason.
    """
    from rotorfit.logs.files import write_whole
    from rotorfit.report.loop import loop_html, loop_text
    from rotorfit.results.sound_result import load_sound
    from rotorfit.tools.control_loop.loop import loop_margins, loop_to_json

    refuse_output_files({"-o": output, "--report": report}, inputs=[result, log], force=force)
    with steps() as report_progress:
        report_progress(f"proving the loop on {log.name}")
        outcome = loop_margins(load_sound(result), log, configuration)
    if output is not None:
        write_whole(output, loop_to_json(outcome), force=force)
        print_status(f"wrote {output}")
    write_pictures(report, None, page=lambda: loop_html(outcome), drawings=dict, force=force)
    text = coloured(loop_text(outcome, width=terminal_width()))
    print_result((loop_to_json(outcome) if as_json else text).rstrip())
