"""rotorfit loop: how far the flown rate controller is from oscillating."""

from pathlib import Path
from typing import Annotated

import typer

from rotorfit.cli.options import AsJson, Force, ResultFile
from rotorfit.cli.terminal import coloured, print_result, print_status, refuse_output_file


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
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Show how far the tune is from oscillating, with intervals.

    Gains and filters are read from the log, the vehicle with its delays from the result; the
    margins of the rate loop are proved on the flight itself, or withheld with the reason.
    """
    from threadpoolctl import threadpool_limits

    from rotorfit.control_loop.loop import judge_loop
    from rotorfit.control_loop.plain import loop_to_json
    from rotorfit.export.vehicle_model import owner_of
    from rotorfit.logs.files import write_whole
    from rotorfit.report.loop_text import loop_text
    from rotorfit.results.sound_result import load_sound

    if output is not None:
        refuse_output_file(output, inputs=[result, log], force=force)
    loaded = load_sound(result)
    with threadpool_limits(limits=1, user_api="blas"):
        outcome = judge_loop(loaded, owner_of(loaded, configuration), log)
    if output is not None:
        write_whole(output, loop_to_json(outcome), force=force)
        print_status(f"wrote {output}")
    # Its tables need a fixed width.
    print_result((loop_to_json(outcome) if as_json else coloured(loop_text(outcome))).rstrip())
