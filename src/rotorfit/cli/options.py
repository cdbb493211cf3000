"""Options and arguments that several commands share."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

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
Assume = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Supply a number that the flights do not give, SI (kd=3.7e-9); repeatable.",
    ),
]
OutputFile = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="Write the file here.")
]
Page = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write a page with tables and figures here (HTML)."),
]
Figures = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write each figure as a file into this folder (SVG, PNG)."),
]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Another seed gives another flight.")]


def json_file(what: str) -> Any:
    """Declare the option for the file that a command writes besides what it prints."""
    return typer.Option("-o", "--output", metavar="FILE", help=f"Write {what} as JSON here.")
