"""Options and arguments that several commands have, or that are long."""

from pathlib import Path
from typing import Annotated, Literal

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]
ResultFile = Annotated[
    Path, typer.Argument(metavar="RESULT", help="What  rotorfit identify -o  wrote.")
]
LogNumber = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="In a file of several logs: which, from 1.")
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
    typer.Option(help="Rotor speed from telemetry or from motor commands; else [motors] says."),
]
Method = Annotated[
    Literal["banded", "ols", "tls"] | None,
    typer.Option(
        help="banded (default): all equations and configurations at once; ols: equation by "
        "equation; tls: total least squares, as the paper. Else the experiment file says."
    ),
]
Assume = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Stand for a number that the flights do not give, SI (kd=3.7e-9); repeatable.",
    ),
]
Page = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write a page with tables and figures here (HTML)."),
]
Figures = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="Write each figure as a file into this folder (SVG, PNG)."),
]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Another seed is another flight.")]
