"""Output and end of a command: printing, files that may be written, refusals, interruptions."""

import os
import re
import shutil
import sys
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from io import TextIOWrapper
from pathlib import Path
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


def print_result(text: str) -> None:
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


def print_status(line: str) -> None:
    """Print a line on stderr; nobody reading it is no reason to stop."""
    with suppress(OSError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def print_refusal(error: Exception) -> None:
    """Print on stderr, in one line, why something is refused."""
    print_status(f"rotorfit: {one_line(str(error))}")


def one_line(text: str) -> str:
    """Remove line breaks and runs of blanks."""
    return " ".join(text.split())


def terminal_width() -> int:
    """Return the width of a line of prose: the terminal's, within limits that read well."""
    columns = shutil.get_terminal_size((FALLBACK, 0)).columns
    return min(max(columns, NARROWEST), WIDEST)


COLOURS: Final = {
    "identified": "32",
    "weak": "33",
    "doubtful": "31",
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
    r"(?P<verdict>not-identified|identified|weak|doubtful|ratio-only|given|removed)(?= with \S+$|$)"
    r"|\b(?P<stand>better|WORSE)\b(?= \(error)",
    re.MULTILINE,
)
"""The end of a table's row, and how errors compare to others; prose that ends so is none."""


def coloured(text: str) -> str:
    """Colour the verdicts in a text for stdout, where that is wanted."""
    return _VERDICT.sub(_coloured_verdict, text) if _in_colour() else text


def _coloured_verdict(found: re.Match[str]) -> str:
    word = found["verdict"] or found["stand"]
    return f"{found['row'] or ''}\x1b[{COLOURS[word]}m{word}\x1b[0m"


def _in_colour() -> bool:
    """Decide on colour: by --color, else on a terminal unless NO_COLOR is set."""
    if COLOUR.get() != "auto":
        return COLOUR.get() == "always"
    dumb = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return sys.stdout.isatty() and not dumb


def colour_from(arguments: list[str]) -> list[str]:
    """Take --color from the command line, wherever it stands; raise OutputError if it is unknown.

    It sets `COLOUR`; the other arguments are returned.
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


def refuse_output_file(path: Path, *, inputs: Iterable[Path], force: bool) -> None:
    """Raise if a file exists, is one of the inputs, or has no folder to be in."""
    from rotorfit.logs.files import refuse_special_file

    try:
        if path.is_dir():
            raise OutputError(f"{path} is a folder; name a file in it")
        refuse_special_file(path)
        if not path.parent.is_dir():
            raise OutputError(f"{path}: there is no folder {path.parent}; make it first")
        if any(path.exists() and source.exists() and path.samefile(source) for source in inputs):
            raise OutputError(f"{path} is an input of this command; name another file")
        exists = path.exists()
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); name another") from error
    if exists and not force:
        raise OutputError(f"{path} exists; choose another name, or pass --force to overwrite it")


def refuse_output_folder(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Make a folder where it is missing; raise if it cannot be, or holds files of these names."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        existing = [name for name in names if (folder / name).exists()]
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
    if existing and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(existing)}; name another folder, or pass --force"
        )


def exit_refused(error: Exception) -> NoReturn:
    """End with exit code 1 and one line that says why."""
    print_refusal(error)
    sys.exit(1)


def exit_internal_error(error: Exception) -> NoReturn:
    """End with exit code 1 and one line instead of a traceback, unless one is asked for."""
    if os.environ.get(DEBUG):
        raise error
    parts = (type(error).__name__, one_line(str(error)))
    print_status(
        f"rotorfit: internal error ({': '.join(filter(None, parts))}); please report it with the "
        f"log, run with {DEBUG}=1 for details"
    )
    sys.exit(1)


def escape_unprintable() -> None:
    """Let stdout and stderr print every file name, in ASCII too: unknown characters are escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def interruptible() -> Generator[None]:
    """End quietly where the user stops the command, or its reader (such as head) has gone."""
    try:
        yield
    except KeyboardInterrupt:
        print_status("rotorfit: stopped")
        raise typer.Exit(STOPPED) from None
    except BrokenPipeError:
        _drop_stdout()
        raise typer.Exit(0) from None


def _drop_stdout() -> None:
    """Send the rest nowhere: Python would complain once more when it flushes at the end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
