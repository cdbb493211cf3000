"""Commands on a result: does it hold, how far does it differ, files for other tools."""

from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, get_args

import typer

from rotorfit.cli.help import Command
from rotorfit.cli.options import (
    Against,
    AsJson,
    Assume,
    Bench,
    DrawSeed,
    End,
    Figures,
    Force,
    LogNumber,
    NumbersOutput,
    Page,
    ReplayedFlights,
    ResultFile,
    Samples,
    Start,
)
from rotorfit.cli.terminal import interruptible
from rotorfit.export.targets import AnyTargetName

commands = typer.Typer()


def target_named(name: str) -> str:
    """Return the name of a target; refused with the nearest one where there is none."""
    names = get_args(AnyTargetName)
    if name in names:
        return name
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    raise typer.BadParameter(f"no target {name!r}; {hint}targets: {', '.join(names)}")


@commands.command(cls=Command, epilog="Example: rotorfit validate result.json other_flight.bfl")
@interruptible()
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
    from rotorfit.cli.validate import run

    run(
        result,
        flights,
        configuration=configuration,
        log_number=log,
        window=(start, end),
        as_json=as_json,
    )


@commands.command(cls=Command, epilog="Example: rotorfit compare imu.json mocap.json")
@interruptible()
def compare(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="Results that identify -o wrote, two or more; or the truth.json of a simulation.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Show results side by side, and how far they differ.

    Prints values and intervals, the difference to the first result in percent, and which intervals
    do not overlap with the first.
    """
    from rotorfit.cli.compare import run

    run(results, as_json=as_json)


@commands.command(cls=Command, epilog="Example: rotorfit export result.json --to urdf -o quad.urdf")
@interruptible()
def export(
    result: ResultFile,
    target: Annotated[
        AnyTargetName,
        typer.Option(
            "--to",
            metavar="TARGET",
            parser=target_named,
            autocompletion=lambda: list(get_args(AnyTargetName)),
            help=f"Which tool's file: {', '.join(get_args(AnyTargetName))} (wrenches of the "
            "flights over time).",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Write the file here.")
    ],
    configuration: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Which to export; not needed if the result has only one."
        ),
    ] = None,
    assume: Assume = None,
    project: Annotated[
        bool,
        typer.Option(
            "--project", help="Replace an impossible inertia by the nearest possible one."
        ),
    ] = False,
    samples: Samples = None,
    seed: DrawSeed = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a result as a file of a simulator or autopilot.

    Refuses a target that needs numbers the flights do not determine, unless you supply them with
    --assume; marks weak numbers in the file.
    """
    from rotorfit.cli.export import ExportRequest, run

    run(
        ExportRequest(
            result=result,
            target=target,
            output=output,
            configuration=configuration,
            assume=tuple(assume or ()),
            project=project,
            samples=samples,
            seed=seed,
            force=force,
            as_json=as_json,
        )
    )


@commands.command(cls=Command, epilog="Example: rotorfit fly result.json --report fly.html")
@interruptible()
def fly(
    result: ResultFile,
    configuration: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which to fly; not needed if the result has only one."),
    ] = None,
    assume: Assume = None,
    flight: ReplayedFlights = None,
    log: LogNumber = None,
    against: Against = None,
    bench: Bench = None,
    output: NumbersOutput = None,
    report: Page = None,
    figures: Figures = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Check whether the identified vehicle flies as flown.

    The measured rotor speeds drive the model for half a second from many measured starts; predicted
    rates and accelerations are compared with the flown ones, and with those of a bench or another
    result. Then hover and steps in MuJoCo, if installed.
    """
    from rotorfit.cli.fly import FlyRequest, run

    run(
        FlyRequest(
            result=result,
            configuration=configuration,
            assume=tuple(assume or ()),
            bench=tuple(bench or ()),
            against=tuple(against or ()),
            flights=tuple(flight or ()),
            log_number=log,
            output=output,
            report=report,
            figures=figures,
            force=force,
            as_json=as_json,
        )
    )
