"""Options and arguments that several commands have, or that are long: by command, at the end."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer.models import OptionInfo

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]
ResultFile = Annotated[
    Path, typer.Argument(metavar="RESULT", help="A result file, from  rotorfit identify -o.")
]
LogNumber = Annotated[
    int | None,
    typer.Option("--log", min=1, metavar="N", help="Which log of a file with several, from 1."),
]
Start = Annotated[
    float | None,
    typer.Option(
        min=0.0, metavar="SECONDS", help="With a log: use it from here [s since its first sample]."
    ),
]
End = Annotated[
    float | None,
    typer.Option(
        min=0.0, metavar="SECONDS", help="With a log: use it up to here [s since its first sample]."
    ),
]
Speed = Annotated[
    Literal["measured", "commanded"] | None,
    typer.Option(
        help="Rotor speed from telemetry or from motor commands; default: as [motors] says."
    ),
]
Method = Annotated[
    Literal["banded", "ols", "tls"] | None,
    typer.Option(
        help="banded (default): all equations and configurations at once; ols: equation by "
        "equation; tls: total least squares, as in the paper. Default: as the experiment file says."
    ),
]
Assume = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Supply a number that the flights do not give, SI (kd=3.7e-9); repeatable.",
    ),
]
Page = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write a page with tables and figures here (HTML)."),
]
Figures = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write each figure as a file into this folder (SVG, PNG)."),
]


def _json_of(what: str) -> OptionInfo:
    """Return the option -o of a command that writes one file, as JSON."""
    return typer.Option("-o", "--output", metavar="FILE", help=f"Write the {what} as JSON here.")


ResultOutput = Annotated[Path | None, _json_of("result")]
NumbersOutput = Annotated[Path | None, _json_of("numbers")]
PlanOutput = Annotated[Path | None, _json_of("plan")]

Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Another seed gives another flight.")]

# export
Samples = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Number of vehicles to draw from the uncertainty of the result. If a file of the "
        "target holds one vehicle, -o names a folder (targets that hold many: default 100).",
    ),
]
DrawSeed = Annotated[
    int, typer.Option(min=0, metavar="N", help="With --samples: another seed gives other vehicles.")
]

# fly
ReplayedFlights = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="LOG", help="Replay this log instead of the result's own flights; repeatable."
    ),
]
Against = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="RESULT", help="Another result of the vehicle to compare with; repeatable."
    ),
]
Bench = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="A number from your bench to compare with, SI; others as identified; repeatable.",
    ),
]

# fleet
FleetSource = Annotated[
    Path,
    typer.Argument(
        metavar="DIR|TABLE",
        help="A folder with logs (subfolders included); or a CSV with the columns file, vehicle, "
        "configuration, mass, airframe, log (only file is required).",
    ),
]
FleetOutput = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="DIR",
        help="Folder for tables, page and the cache of each log; a second run continues there.",
    ),
]
FleetMass = Annotated[
    str | None,
    typer.Option(
        "--mass",
        metavar="KG",
        help='Mass of every vehicle without one in the table: kg, or "unknown".',
    ),
]
FleetAirframe = Annotated[
    Path | None,
    typer.Option(
        "--airframe",
        metavar="FILE",
        help="File with [airframe] and [motors], for logs without one in the table.",
    ),
]
VehicleOf = Annotated[
    str | None,
    typer.Option(
        metavar="REGEX",
        help="Finds the vehicle in the path of a log: the first group, or groups named vehicle and "
        "configuration. Default: as the log says, else its folder.",
    ),
]
WorkerCount = Annotated[
    int | None,
    typer.Option("--workers", min=1, metavar="N", help="Processes; default: one per core."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="Work on a Dask cluster instead (tcp://HOST:PORT; extra dask)."
    ),
]
TimeLimit = Annotated[
    float,
    typer.Option(
        min=1.0,
        metavar="SECONDS",
        help="For one log; a log that takes longer is left out and listed.",
    ),
]

# plan
AirframeFile = Annotated[
    Path, typer.Argument(metavar="AIRFRAME", help="File with [airframe] and [motors].")
]
PlannedMass = Annotated[
    float | None,
    typer.Option(
        metavar="KG",
        help="Weighed as it flies, battery included [kg]; not needed with --after.",
    ),
]
Accuracy = Annotated[
    str,
    typer.Option(
        metavar="PERCENT|NAME=VALUE,...",
        help="Target half-width of the 95 % interval: one percentage (of kt, kd, Ixx, Iyy, Izz), "
        "or names such as kd=2,Izz=3,com_x=1 (com_x, com_y, com_z in mm).",
    ),
]
Lengths = Annotated[
    str,
    typer.Option(
        metavar="SECONDS,...",
        help="Lengths of each flight to consider, between take-off and landing [s].",
    ),
]
PlannedPayload = Annotated[
    float | None,
    typer.Option(metavar="KG", help="Mass of each of two payloads on one arm [kg]; 0: no payload."),
]
Guess = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Your value of Ixx, Iyy, Izz, hover_speed, kd_over_kt, Jr or motor_lag (SI), in "
        "place of the guess from the geometry; repeatable.",
    ),
]
LogRate = Annotated[float, typer.Option(metavar="HZ", help="Samples per second of your log.")]
After = Annotated[
    Path | None,
    typer.Option(metavar="RESULT", help="A result of this vehicle: plan for what it still lacks."),
]
Card = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write a page for the pilot here (.html to print, .txt)."),
]
