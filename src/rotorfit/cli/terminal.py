"""What is printed, and how a command ends: refused, interrupted, or with nobody reading."""

import os
import re
import shutil
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from io import TextIOWrapper
from typing import Final, Literal, NoReturn, cast, get_args

import typer

from rotorfit.errors import OutputError

DEBUG = "ROTORFIT_DEBUG"
WIDEST = 100
NARROWEST = 60
"""Of a line of prose [characters]: within these it follows the terminal."""
FALLBACK = 80
"""Where there is no terminal: a pipe, a file."""
STOPPED = 130
"""The exit code of a program that Ctrl-C ended, by custom of the shells."""


def show(text: str) -> None:
    """Print a result on stdout."""
    # Not typer.echo: it takes an ASCII terminal for a mistake, and writes UTF-8 to it.
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        _drop_stdout()
        raise OutputError(
            f"the result cannot be printed ({error.strerror}): make room, or print to another place"
        ) from None


def terminal_width() -> int:
    """Return how wide a line of prose may be: as the terminal, within limits that read well."""
    columns = shutil.get_terminal_size((FALLBACK, 0)).columns
    return min(max(columns, NARROWEST), WIDEST)


COLOURS: Final = {
    "identified": "32",
    "weak": "33",
    "ratio-only": "33",
    "not-identified": "31",
    "given": "2",
    "removed": "2",
    "better": "32",
    "WORSE": "31",
}
"""Of verdicts: SGR codes of the terminal, green, yellow, red and faint."""
Colour = Literal["auto", "always", "never"]
COLOUR: ContextVar[Colour] = ContextVar("colour", default="auto")
_VERDICT: Final = re.compile(
    r"^(?P<row>  [A-Za-z]\S* .* )"
    r"(?P<verdict>not-identified|identified|weak|ratio-only|given|removed)(?= with \S+$|$)"
    r"|\b(?P<stand>better|WORSE)\b(?= \(error)",
    re.MULTILINE,
)
"""The end of a table's row, and how errors stand to others; prose that ends so is none."""


def painted(text: str) -> str:
    """Return text for stdout, its verdicts in colour where that is wanted."""
    if not _in_colour():
        return text
    return _VERDICT.sub(_in_its_colour, text)


def _in_its_colour(found: re.Match[str]) -> str:
    word = found["verdict"] or found["stand"]
    return f"{found['row'] or ''}\x1b[{COLOURS[word]}m{word}\x1b[0m"


def _in_colour() -> bool:
    """Return whether to print in colour: as told, else on a terminal unless NO_COLOR is set."""
    if COLOUR.get() != "auto":
        return COLOUR.get() == "always"
    dumb = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return sys.stdout.isatty() and not dumb


def colour_from(arguments: list[str]) -> list[str]:
    """Return the command line without --color, wherever it stands, and heed it.

    Raises
    ------
    OutputError
        If it is none of the three.
    """
    rest: list[str] = []
    left = iter(arguments)
    for word in left:
        if word == "--":
            return [*rest, word, *left]
        name, sign, when = word.partition("=")
        if name != "--color":
            rest.append(word)
            continue
        when = when if sign else next(left, "")
        if when not in get_args(Colour):
            raise OutputError(f"--color {when!r}; expected auto, always or never")
        COLOUR.set(cast("Colour", when))
    return rest


def say(words: str) -> None:
    """Print a line on stderr; nobody reading it is no reason to stop."""
    with suppress(OSError):
        sys.stderr.write(f"{words}\n")
        sys.stderr.flush()


def refuse(error: Exception) -> NoReturn:
    """End with exit code 1 and one line that says why."""
    say(f"rotorfit: {one_line(str(error))}")
    sys.exit(1)


def internal_error(error: Exception) -> NoReturn:
    """End with exit code 1 and one line instead of a traceback, unless one is asked for."""
    if os.environ.get(DEBUG):
        raise error
    words = ": ".join(word for word in (type(error).__name__, one_line(str(error))) if word)
    say(
        f"rotorfit: internal error ({words}); please report it with the log, "
        f"run with {DEBUG}=1 for details"
    )
    sys.exit(1)


def one_line(words: str) -> str:
    """Return text without line breaks or runs of blanks."""
    return " ".join(words.split())


def print_any_name() -> None:
    """Let stdout and stderr print every file name, in ASCII too: what they lack is escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def interruptible() -> Generator[None]:
    """End quietly where the user stops the command, or its reader (such as head) has gone."""
    try:
        yield
    except KeyboardInterrupt:
        say("rotorfit: stopped")
        raise typer.Exit(STOPPED) from None
    except BrokenPipeError:
        _drop_stdout()
        raise typer.Exit(0) from None


def _drop_stdout() -> None:
    """Let the rest go nowhere: Python would complain once more when it flushes at the end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
