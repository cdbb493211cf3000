"""Commands on flight logs: what they show, the airframe file, parameters, whole fleets."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from rotorfit.cli.help import Command
from rotorfit.cli.options import (
    AsJson,
    End,
    Figures,
    FleetAirframe,
    FleetMass,
    FleetOutput,
    FleetSource,
    Force,
    LogNumber,
    Method,
    Page,
    ResultOutput,
    Scheduler,
    Speed,
    Start,
    TimeLimit,
    VehicleOf,
    WorkerCount,
)
from rotorfit.cli.terminal import interruptible

commands = typer.Typer()


@commands.command(cls=Command, epilog="Example: rotorfit inspect flight.bfl")
@interruptible()
def inspect(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG",
            help="Flight logs of any format, or experiment files (.toml) that map their columns.",
        ),
    ],
    log: LogNumber = None,
    airframe: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File with [airframe] and [motors]: identify quickly, per kilogram.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page here (HTML).")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Check what a log can show, and which settings to change.

    Prints its channels, the part in the air, what an identification will find, and the autopilot
    settings to change before the next flight.
    """
    from rotorfit.cli.inspect import InspectOptions, run

    options = InspectOptions(
        log_number=log, airframe=airframe, as_json=as_json, report=report, force=force
    )
    run(logs, options)


@commands.command(cls=Command, name="app", epilog="Example: rotorfit app --port 8421")
@interruptible()
def page(
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Listen here; 0: any free port.")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    limit: Annotated[
        int, typer.Option(min=1, metavar="MB", help="Largest sum of the files on a page [MB].")
    ] = 2000,
) -> None:
    """Open a page on which you drop your logs.

    The page inspects them, asks for the vehicle on a drawing, identifies it, and gives report,
    result and exports. It runs on this computer alone and sends nothing. Ctrl-C ends it.
    """
    from rotorfit.cli.app import run

    run(port=port, browser=browser, limit=limit)


@commands.command(cls=Command, epilog="Example: rotorfit airframe flight.bfl -o airframe.toml")
@interruptible()
def airframe(
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG", help="A flight of the vehicle: it shows motor order and spins."
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Write the file here.")
    ] = Path("airframe.toml"),
    log_number: LogNumber = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="quad-x, quad-plus, hexa-x, ...; asked for if not given."
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Motor numbering: px4, ardupilot, betaflight, crazyflie; asked for if not given.",
        ),
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Between the motor axes, front to back and left to right [mm]; asked for if not "
            "given.",
        ),
    ] = None,
    speed: Speed = None,
    force: Force = False,
) -> None:
    """Write the airframe file that other commands need.

    Asks for what a ruler measures; a log fills in what the flight shows: the number of motors,
    their order and spins, and whether their speed was measured.
    """
    from rotorfit.cli.airframe import AirframeRequest, run

    run(
        AirframeRequest(
            output=output,
            log=log,
            log_number=log_number,
            layout=layout,
            order=order,
            spacing=spacing,
            speed=speed,
            force=force,
        )
    )


@commands.command(
    cls=Command,
    epilog="Example: rotorfit identify flight.bfl --mass 0.428 --airframe airframe.toml",
)
@interruptible()
def identify(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="EXPERIMENT|LOG", help="An experiment file (.toml), or one flight log."
        ),
    ],
    output: ResultOutput = None,
    report: Page = None,
    figures: Figures = None,
    mass: Annotated[
        str | None, typer.Option(metavar="KG", help='With a log: weighed mass in kg, or "unknown".')
    ] = None,
    airframe: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With a log: file with [airframe] and [motors]."),
    ] = None,
    log: LogNumber = None,
    start: Start = None,
    end: End = None,
    speed: Speed = None,
    motion: Annotated[
        Literal["imu", "mocap"] | None,
        typer.Option("--source", help="Motion from the IMU (default) or from motion capture."),
    ] = None,
    method: Method = None,
    preset: Annotated[
        Literal["paper"] | None,
        typer.Option(help="paper: exactly as Six et al. 2020, their standard deviations included."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify a vehicle's parameters from its flights.

    From an experiment file, which names airframe, masses and flights, or from one log with --mass
    and --airframe.
    """
    from rotorfit.cli.identify import IdentifyRequest, run

    run(
        IdentifyRequest(
            source=source,
            output=output,
            report=report,
            figures=figures,
            mass=mass,
            airframe=airframe,
            log=log,
            window=(start, end),
            speed=speed,
            motion=motion,
            method=method,
            preset=preset,
            force=force,
            as_json=as_json,
        )
    )


@commands.command(
    cls=Command,
    epilog="Example: rotorfit fleet logs --airframe airframe.toml --mass 0.428 -o fleet",
)
@interruptible()
def fleet(
    source: FleetSource,
    output: FleetOutput,
    airframe: FleetAirframe = None,
    mass: FleetMass = None,
    vehicle_of: VehicleOf = None,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    time_limit: TimeLimit = 600.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify many logs of many vehicles, and compare them.

    Identifies each log by itself, then finds changes over time, outlier vehicles, and the mean and
    spread of the type. Writes tables of flights, vehicles and unusable logs, and a page. After an
    interruption, call it again: it continues.
    """
    from rotorfit.cli.fleet import FleetRequest, run

    run(
        FleetRequest(
            source=source,
            output=output,
            airframe=airframe,
            mass=mass,
            vehicle_of=vehicle_of,
            workers=workers,
            scheduler=scheduler,
            time_limit=time_limit,
            force=force,
            as_json=as_json,
        )
    )
