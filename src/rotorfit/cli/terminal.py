"""What is printed, and how a command ends: refused, interrupted, or with nobody reading."""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import NoReturn

import typer

from rotorfit.errors import OutputError

DEBUG = "ROTORFIT_DEBUG"
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
