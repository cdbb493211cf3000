"""The command line: one command a question. Heavy imports happen inside the commands."""

from __future__ import annotations

import os
import re
import sys
from difflib import get_close_matches
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

from rotorfit import version
from rotorfit.cli.postponed_imports import postpone_imports
from rotorfit.cli.terminal import (
    Colour,
    colour_from,
    escape_unprintable,
    exit_internal_error,
    exit_refused,
    interruptible,
    print_result,
)
from rotorfit.errors import RotorfitError

COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "inspect": ("inspect:inspect", "flight.bfl"),
    "settings": ("settings:settings", "flight.bin -o ardupilot.parm"),
    "app": ("app:page", "--port 8421"),
    "airframe": ("airframe:airframe", "flight.bfl -o airframe.toml"),
    "identify": ("identify:identify", "flight.bfl --mass 0.428 --airframe airframe.toml"),
    "why": ("why:why", "result.json Ixx"),
    "fleet": ("fleet:fleet", "logs --airframe airframe.toml --mass 0.428 -o fleet"),
    "validate": ("validate:validate", "result.json other_flight.bfl"),
    "compare": ("compare:compare", "imu.json mocap.json"),
    "export": ("export:export", "result.json --to urdf -o quad.urdf"),
    "fly": ("fly:fly", "result.json --report fly.html"),
    "loop": ("loop:loop", "result.json flight.ulg"),
    "plan": ("plan:plan", "airframe.toml --mass 1.285 --card card.html"),
    "simulate": ("simulate:simulate", "single -o flights --seconds 20"),
    "demo": ("demo:demo", "-o demo"),
}
"""Commands in the order of ``--help``: module and function, and an example."""
OTHER_WORDS: Final = {"--weight": "--mass", "--frame": "--airframe", "--out": "--output"}
"""Options under names that people try, which are none of ours."""
EXTRA: Final = re.compile(r"unexpected extra argument.*\((\S+)\)$")
NO_NUMBER: Final = re.compile(r"Input should be a valid (?:number|integer), unable to parse.*")
"""What the parser says of more words than a command takes, and of text in place of a number."""
ALIKE: Final = 0.7
"""Share of letters in common from which an option may be meant [-]: half a word, such as ``--out``,
has 0.77, and other words of the same first letters, as ``--weight`` and ``--why``, up to 0.62."""


class Command(TyperCommand):
    """A command that shows each parameter once, and names the nearest to a misspelt choice."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return `[OPTIONS] LOG...`: an argument's name alone, where typer adds braces."""
        arguments = [p for p in self.get_params(ctx) if p.param_type_name == "argument"]
        return [self.options_metavar or "", *map(_argument_usage, arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        _write_parameters(self, ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message = _with_nearest(error.message)
            raise
        except Exception as error:
            # An unknown option; its class belongs to click, or to typer's copy of it.
            unknown: str | None = getattr(error, "option_name", None)
            if unknown is not None and hasattr(error, "possibilities"):
                vars(error)["possibilities"] = self._list_near_options(ctx, unknown)
            extra = EXTRA.search(str(vars(error).get("message", "")))
            options = [name for p in self.get_params(ctx) for name in p.opts]
            if extra is not None and "--airframe" in options:
                vars(error)["message"] = f"{extra.string}: {_place_words(extra[1])}"
            raise

    def _list_near_options(self, ctx: Any, given: str) -> list[str]:
        """List the options that an unknown one may mean: by another word, else by its letters."""
        options = [name for p in self.get_params(ctx) for name in p.opts if name[:2] == "--"]
        meant = OTHER_WORDS.get(given)
        if meant in options:
            return [meant]
        return get_close_matches(given, options, cutoff=ALIKE)


class Program(TyperGroup):
    """The program with its commands."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write options, then commands."""
        _write_parameters(self, ctx, formatter)
        self.format_commands(ctx, formatter)


def _place_words(extra: str) -> str:
    """Explain where a file that stands alone on the command line belongs."""
    if extra.endswith(".toml"):
        return f"did you mean --airframe {extra}?"
    return "one log at a time; several flights go into an experiment file (.toml)"


def _argument_usage(argument: Any) -> str:
    name = argument.metavar + ("" if argument.nargs == 1 else "...")
    return name if argument.required else f"[{name}]"


def _write_parameters(command: TyperCommand | TyperGroup, ctx: Any, formatter: Any) -> None:
    """Write each parameter once, without the type that typer puts behind its name (`<path>`)."""
    rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    parameters: list[Any] = command.get_params(ctx)
    for parameter in parameters:
        record = parameter.get_help_record(ctx)
        if record is None:
            continue
        if parameter.param_type_name == "argument":
            rows["Arguments"].append((parameter.metavar, record[1]))
        else:
            rows["Options"].append((record[0].replace("<", "").replace(">", ""), record[1]))
    for title, entries in rows.items():
        if entries:
            with formatter.section(title):
                formatter.write_dl(entries)


def _with_nearest(message: str) -> str:
    """Append the nearest valid choice to the refusal of a choice."""
    message = message.removeprefix("Value error, ")
    message = NO_NUMBER.sub("expected a number alone, without a unit", message)
    found = re.match(r"'(.*)' is not one of (.*?)\.?$", message)
    choices = re.findall(r"'([^']*)'", found[2]) if found else []
    near = get_close_matches(found[1], choices, n=1, cutoff=0.5) if found else []
    return f"{message} Did you mean '{near[0]}'?" if near else message


def program_of(*names: str) -> typer.Typer:
    """Return the program with these commands; the modules of others are not imported."""
    program = typer.Typer(
        name="rotorfit",
        cls=Program,
        help="Physical parameters of a multirotor, with intervals, from the flight logs you have.",
        epilog="Start with  rotorfit inspect LOG,  or see  rotorfit demo.  COMMAND --help says "
        "more.",
        no_args_is_help=True,
        add_completion=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    program.callback()(_take_options)
    for name in names:
        place, example = COMMANDS[name]
        module, _, function = place.partition(":")
        command = getattr(import_module(f"rotorfit.cli.{module}"), function)
        epilog = f"Example: rotorfit {name} {example}"
        program.command(name, cls=Command, epilog=epilog)(interruptible()(command))
    return program


def program_for(arguments: list[str]) -> typer.Typer:
    """Return the program with the command that is called, or with all of them."""
    called = next((argument for argument in arguments if not argument.startswith("-")), "")
    completing = any(name.endswith("ROTORFIT_COMPLETE") for name in os.environ)
    return program_of(*([called] if called in COMMANDS and not completing else COMMANDS))


def __getattr__(name: str) -> object:
    """Return `app`, the program with all commands (PEP 562)."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return program_of(*COMMANDS)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; a refusal is one line on stderr and exit code 1, never a traceback.

    Parameters
    ----------
    arguments
        Without the program's name; those of the process if None.
    """
    escape_unprintable()
    postpone_imports()
    try:
        if arguments is None:
            sys.argv[1:] = colour_from(sys.argv[1:])
        else:
            arguments = colour_from(arguments)
        given = sys.argv[1:] if arguments is None else arguments
        program_for(given)(arguments, prog_name="rotorfit")
    except RotorfitError as error:
        exit_refused(error)
    except Exception as error:  # a fault of ours: nobody else stands behind us to catch it
        exit_internal_error(error)


def _print_version(wanted: bool) -> bool:
    if wanted:
        print_result(f"rotorfit {version.__version__}")
        raise typer.Exit
    return wanted


def _take_options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
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
