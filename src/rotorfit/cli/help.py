"""How `--help` shows arguments and options, and what an error says of a word that is misspelt."""

import re
from difflib import get_close_matches
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup


class Command(TyperCommand):
    """A command of the program."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return `[OPTIONS] LOG...`: an argument's name alone, where typer adds braces."""
        arguments = [p for p in self.get_params(ctx) if p.param_type_name == "argument"]
        return [self.options_metavar or "", *map(_usage, arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        _write_parameters(self, ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message = _with_nearest(error.message)
            raise


class Program(TyperGroup):
    """The program itself, with its commands."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write options, then commands."""
        _write_parameters(self, ctx, formatter)
        self.format_commands(ctx, formatter)


def _usage(argument: Any) -> str:
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
    for title, own in rows.items():
        if own:
            with formatter.section(title):
                formatter.write_dl(own)


def _with_nearest(message: str) -> str:
    """Return the refusal of a choice with the nearest one that there is."""
    message = message.removeprefix("Value error, ")
    found = re.match(r"'(.*)' is not one of (.*?)\.?$", message)
    choices = re.findall(r"'([^']*)'", found[2]) if found else []
    near = get_close_matches(found[1], choices, n=1, cutoff=0.5) if found else []
    return f"{message} Did you mean '{near[0]}'?" if near else message
