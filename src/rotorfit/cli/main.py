"""The command line: one command a question. Heavy imports happen inside the commands."""

import sys
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal, get_args

import typer

from rotorfit import version
from rotorfit.cli.options import (
    Accuracy,
    After,
    Against,
    AirframeFile,
    AsJson,
    Assume,
    Bench,
    Card,
    DrawSeed,
    End,
    Figures,
    FleetAirframe,
    FleetMass,
    FleetOutput,
    FleetSource,
    Force,
    Guess,
    Lengths,
    LogNumber,
    LogRate,
    Method,
    NumbersOutput,
    Page,
    PlannedMass,
    PlannedPayload,
    PlanOutput,
    ReplayedFlights,
    ResultFile,
    ResultOutput,
    Samples,
    Scheduler,
    Seed,
    Speed,
    Start,
    TimeLimit,
    VehicleOf,
    WorkerCount,
)
from rotorfit.cli.terminal import (
    Colour,
    colour_from,
    internal_error,
    interruptible,
    print_any_name,
    refuse,
    show,
)
from rotorfit.errors import RotorfitError
from rotorfit.export.target_names import AnyTargetName

app = typer.Typer(
    name="rotorfit",
    help="Physical parameters of a multirotor, with intervals, from the flight logs you have.",
    epilog="Start with  rotorfit inspect LOG,  or see  rotorfit demo.  COMMAND --help tells more.",
    no_args_is_help=True,
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; a refusal is one line on stderr and exit code 1, never a traceback."""
    print_any_name()
    try:
        sys.argv[1:] = colour_from(sys.argv[1:])
        app(prog_name="rotorfit")
    except RotorfitError as error:
        refuse(error)
    except Exception as error:  # a fault of ours: nobody else stands behind us to catch it
        internal_error(error)


def _version(wanted: bool) -> bool:
    if wanted:
        show(f"rotorfit {version.__version__}")
        raise typer.Exit
    return wanted


def target_named(name: str) -> str:
    """Return the name of a target; refused with the nearest one where there is none."""
    names = get_args(AnyTargetName)
    if name in names:
        return name
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    raise typer.BadParameter(f"no target {name!r}; {hint}targets: {', '.join(names)}")


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
    color: Annotated[
        Colour,
        typer.Option(
            help="Verdicts in colour; auto: on a terminal, unless NO_COLOR is set. May stand "
            "anywhere."
        ),
    ] = "auto",
) -> None:
    del version, color  # main has heeded it


@app.command(epilog="Example: rotorfit inspect flight.bfl")
@interruptible()
def inspect(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
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

    Its channels, the part in the air, what an identification will find in it, and the settings of
    the autopilot to change before the next flight.
    """
    from rotorfit.cli.inspect import InspectOptions, run

    options = InspectOptions(
        log_number=log, airframe=airframe, as_json=as_json, report=report, force=force
    )
    run(logs, options)


@app.command(name="app", epilog="Example: rotorfit app --port 8421")
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

    It looks at them, asks for the vehicle with a drawing, identifies, and gives report, result and
    exports. It runs on this computer alone, and nothing is sent anywhere. Ctrl-C ends it.
    """
    from rotorfit.cli.app import run

    run(port=port, browser=browser, limit=limit)


@app.command(epilog="Example: rotorfit airframe flight.bfl -o airframe.toml")
@interruptible()
def airframe(
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="[LOG]", help="A flight of the vehicle: it shows motor order and spins."
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Write the file here.")
    ] = Path("airframe.toml"),
    log_number: LogNumber = None,
    layout: Annotated[
        str | None, typer.Option(metavar="NAME", help="quad-x, quad-plus, hexa-x, ...; else asked.")
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Motor numbering: px4, ardupilot, betaflight, crazyflie; else asked.",
        ),
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Between the motor axes, front to back and left to right [mm]; else asked.",
        ),
    ] = None,
    speed: Speed = None,
    force: Force = False,
) -> None:
    """Write the airframe file that the other commands want.

    Asks what a ruler answers; a log fills in what the flight shows: how many motors, their order,
    how they spin, and whether their speed was measured.
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


@app.command(epilog="Example: rotorfit identify flight.bfl --mass 0.428 --airframe airframe.toml")
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

    From an experiment file, which names airframe, masses and flights, or straight from one log,
    with --mass and --airframe.
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


@app.command(epilog="Example: rotorfit validate result.json other_flight.bfl")
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

    What the motion needs against what the rotors produce, for thrust and the three moments.
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


@app.command(epilog="Example: rotorfit compare imu.json mocap.json")
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

    Values and intervals of each, the difference to the first in percent, and which intervals are
    apart from the first's.
    """
    from rotorfit.cli.compare import run

    run(results, as_json=as_json)


@app.command(epilog="Example: rotorfit export result.json --to urdf -o quad.urdf")
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

    What the flights do not determine is refused unless you supply it with --assume; what is weak
    is marked in the file.
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


@app.command(epilog="Example: rotorfit fly result.json --report fly.html")
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

    The rotor speeds of the flights move the model over half a second from many measured starts:
    predicted rates and accelerations against flown ones, beside a bench's or another result's. Then
    hover and steps in MuJoCo, where that is installed.
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


@app.command(epilog="Example: rotorfit plan airframe.toml --mass 1.285 --card card.html")
@interruptible()
def plan(
    airframe: AirframeFile,
    mass: PlannedMass = None,
    accuracy: Accuracy = "5",
    seconds: Lengths = "20,40,75",
    speed: Speed = None,
    payload: PlannedPayload = None,
    guess: Guess = None,
    log_rate: LogRate = 200.0,
    after: After = None,
    card: Card = None,
    output: PlanOutput = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Plan a flight for a target accuracy.

    Which manoeuvres, how long, and whether with a payload.
    """
    from rotorfit.cli.plan import PlanOptions, run

    run(
        PlanOptions(
            airframe=airframe,
            mass=mass,
            accuracy=accuracy,
            seconds=seconds,
            speed=speed,
            payload=payload,
            guess=tuple(guess or ()),
            log_rate=log_rate,
            after=after,
            output=output,
            card=card,
            force=force,
            as_json=as_json,
        )
    )


@app.command(epilog="Example: rotorfit fleet logs --airframe airframe.toml --mass 0.428 -o fleet")
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

    Each log once, by itself, as identify does; then what changed over time, which vehicle stands
    apart, and what the type is like. Tables of flights, vehicles and logs that cannot be used, and
    a page. Stopped, it goes on where it was when it is called again.
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


@app.command(epilog="Example: rotorfit simulate single -o flights --seconds 20")
@interruptible()
def simulate(
    scenario: Annotated[
        Literal["paper", "single", "hexa", "payload-pair"],
        typer.Argument(
            help="paper: vehicles A and B of Six et al. 2020; single: a quadrotor; hexa: six "
            "rotors; payload-pair: bare and with a known payload."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FOLDER", help="Folder for flights, experiment and truth."
        ),
    ],
    variant: Annotated[
        Literal["clean", "lag", "noisy", "real"],
        typer.Option(
            help="clean: perfect; lag: motors with a known lag; noisy: and sensor noise and bias; "
            "real: and gusts, drag, rotor inertia, unequal rotors, measured rotor speed."
        ),
    ] = "real",
    seed: Seed = 1,
    seconds: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Of each flight, between take-off and landing [s]."),
    ] = 75.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Fly a vehicle of known truth, to try things on.

    Leaves flight logs, an experiment file ready for identify, and the truth.
    """
    from rotorfit.cli.simulate import SimulateRequest, run

    run(
        SimulateRequest(
            scenario=scenario,
            output=output,
            variant=variant,
            seed=seed,
            seconds=seconds,
            force=force,
            as_json=as_json,
        )
    )


@app.command(epilog="Example: rotorfit demo -o demo")
@interruptible()
def demo(
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="Keep flights, experiment, truth, results and report here.",
        ),
    ] = None,
    seed: Seed = 1,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Fly the paper's experiment, identify it, compare.

    Six, Briot, Erskine and Chriette, ICRA 2020, in simulation: two quadrotors that differ by a
    known payload, identified by the default and by the paper's method, beside the truth.
    """
    from rotorfit.cli.demo import run

    run(output, seed=seed, force=force, as_json=as_json)
