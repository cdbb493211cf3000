"""The command line: one command a question. Heavy imports happen inside the commands."""

import sys
from typing import Annotated

import typer

from rotorfit import version
from rotorfit.cli import log_commands, result_commands, simulation_commands
from rotorfit.cli.help import Program
from rotorfit.cli.terminal import (
    Colour,
    colour_from,
    internal_error,
    print_any_name,
    refuse,
    show,
)
from rotorfit.errors import RotorfitError

app = typer.Typer(
    name="rotorfit",
    cls=Program,
    help="Physical parameters of a multirotor, with intervals, from the flight logs you have.",
    epilog="Start with  rotorfit inspect LOG,  or see  rotorfit demo.  COMMAND --help tells more.",
    no_args_is_help=True,
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for part in (log_commands, result_commands, simulation_commands):
    app.add_typer(part.commands)


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
