"""What commands share: options, printing, progress, files that may be written, refusals.

Progress is one line on stderr where a person is watching, else a plain line every few seconds.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NoReturn, cast, get_args

import typer

from rotorfit.errors import OutputError, RotorfitWarning

if TYPE_CHECKING:
    from rich.console import RenderableType


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


DEBUG = "ROTORFIT_DEBUG"
WIDEST = 100
NARROWEST = 60
"""Widths of a line of prose [characters]: within these it follows the terminal."""
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


def read_reply(question: str) -> str | None:
    """Ask on stderr and read a line from stdin; None if nobody answers."""
    with suppress(OSError):
        sys.stderr.write(question)
        sys.stderr.flush()
    try:
        line = sys.stdin.readline()
    except OSError:  # a closed input
        line = ""
    return line.strip() if line else None


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
"""Colours of verdicts: SGR codes of the terminal, green, yellow, red and faint."""
Colour = Literal["auto", "always", "never"]
COLOUR: ContextVar[Colour] = ContextVar("colour", default="auto")
_VERDICT: Final = re.compile(
    r"^(?P<row>(?: {2}| {8})[A-Za-z]\S* .* )"
    r"(?P<verdict>not-identified|identified|weak|doubtful|ratio-only|given|removed)(?= with \S+$|$)"
    r"|\b(?P<stand>better|WORSE)\b(?= \(error)|(?<=\()(?P<aside>weak|doubtful)(?=\)(?:,|$))",
    re.MULTILINE,
)
"""The end of a table's row, a number's bracket, how errors compare; prose that ends so is none."""


def coloured(text: str) -> str:
    """Colour the verdicts in a text for stdout, where that is wanted."""
    return _VERDICT.sub(_coloured_verdict, text) if _in_colour() else text


def _coloured_verdict(found: re.Match[str]) -> str:
    word = found["verdict"] or found["stand"] or found["aside"]
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


def refuse_output_files(
    files: Mapping[str, Path | None], *, inputs: Iterable[Path], force: bool
) -> None:
    """Raise if files, by the options that name them, cannot be written or are the same one."""
    paths = [path for path in files.values() if path is not None]
    page = files.get("--report")
    if page is not None and page.suffix.lower() not in ("", ".html", ".htm"):
        raise typer.BadParameter(
            f"a report is a web page: name it {page.with_suffix('.html').name}, and print that to "
            f"{page.suffix[1:]} where it is needed",
            param_hint="--report",
        )
    sources = list(inputs)
    for path in paths:
        refuse_output_file(path, inputs=sources, force=force)
    if len(set(paths)) < len(paths):
        raise typer.BadParameter(f"{' and '.join(files)} name the same file")


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


def write_pictures(
    report: Path | None,
    figures: Path | None,
    *,
    page: Callable[[], str],
    drawings: Callable[[], Mapping[str, str]],
    force: bool,
) -> None:
    """Write the page and the figures that are asked for, and print their names."""
    # jinja2 is not worth its time to those who want numbers only.
    from rotorfit.logs.files import write_whole
    from rotorfit.report.pages import HINT, can_write_png, write_drawings

    if report is not None:
        write_whole(report, page(), force=force)
        print_status(f"wrote {report}")
    if figures is not None:
        paths = write_drawings(figures, drawings(), force=force)
        print_status(f"wrote {len(paths)} files to {figures}")
        if not can_write_png():
            print_status(HINT)


def exit_refused(error: Exception) -> NoReturn:
    """End with exit code 1 and one line that says why."""
    print_refusal(error)
    sys.exit(1)


def exit_internal_error(error: Exception) -> NoReturn:
    """Exit with code 1 and one line; print a traceback only if the user asked for it."""
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


BAR_WIDTH = 20
EVERY = 5.0
"""Time between the plain lines [s]."""
WINDOW = 60.0
"""Over which a pace is taken [s]."""
Clock = Callable[[], float]


class _Status:
    """The step at work, its share done (0 to 1; None: unknown), and the pace at the moment."""

    def __init__(
        self, step: str, pace: Callable[[], str] = lambda: "", clock: Clock = time.monotonic
    ) -> None:
        self.step = step
        self.share: float | None = None
        self._pace, self._clock = pace, clock
        self._began = clock()

    def text(self) -> str:
        """Format the step in one line, with the time that has passed."""
        share = "" if self.share is None else f", {100 * self.share:.0f} %"
        return f"{self.step}{self._pace()}{share} ({self._clock() - self._began:.0f} s so far)"

    def __rich__(self) -> RenderableType:
        """Draw the step with a bar."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        if self.share is None:
            return Text(self.text())
        line = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=1.0, completed=self.share, width=BAR_WIDTH)
        line.add_row(bar, Text(self.text()))
        return line


@contextmanager
def steps(*, every: float | None = None) -> Generator[Callable[[str], None]]:
    """Yield a function that shows the step at work, with a bar for every log that is read."""
    from rotorfit.logs.files import watched

    status = _Status("starting")
    step = status.step

    def report(new_step: str) -> None:
        nonlocal step
        step, status.step, status.share = new_step, new_step, None

    def report_reading(path: Path, done: float) -> None:
        if done >= 1.0:
            status.step, status.share = step, None
        else:
            status.step, status.share = f"reading {path.name}", done

    with _show_status(status, every), watched(report_reading):
        yield report


def load_modules(*names: str) -> None:
    """Import modules that take a second or two; on a terminal, show that the command has begun."""
    with steps() if sys.stderr.isatty() else nullcontext():
        for name in names:
            import_module(name)


@contextmanager
def quiet_steps() -> Generator[Callable[[str], None]]:
    """Show the step at work, without warnings: the result has them already."""
    with warnings.catch_warnings(), steps() as report:
        warnings.simplefilter("ignore", RotorfitWarning)
        yield report


@contextmanager
def counted(step: str) -> Generator[Callable[[int, int], None]]:
    """Yield a function that shows how many of how many are done."""
    status = _Status(step)

    def report(done: int, total: int) -> None:
        status.step, status.share = f"{step}, {done} of {total}", done / total

    with _show_status(status):
        yield report


@contextmanager
def paced(
    step: str, *, every: float | None = None, clock: Clock = time.monotonic
) -> Generator[Callable[[int, int], None]]:
    """Yield a function that shows how many of how many are done, how fast, and how long yet."""
    recent, left = deque([(clock(), 0)]), 0

    def pace() -> str:
        (first, before), (_, done) = recent[0], recent[-1]
        # Until now, not until the last that was done: one may take long.
        rate = (done - before) / max(clock() - first, 1e-3)
        if rate <= 0.0:
            return ""
        speed = f"{rate:.1f} a second" if rate >= 0.5 else f"{60 * rate:.1f} a minute"
        return f", {speed}, {_remaining_text(left / rate)}"

    status = _Status(step, pace, clock)

    def report(done: int, total: int) -> None:
        nonlocal left
        recent.append((clock(), done))
        while len(recent) > 2 and recent[-1][0] - recent[0][0] > WINDOW:
            recent.popleft()
        left = total - done
        status.step, status.share = f"{step}, {done} of {total}", done / total

    with _show_status(status, every):
        yield report


def _remaining_text(seconds: float) -> str:
    """Format roughly how long it still takes."""
    if seconds < 90.0:
        return f"about {seconds:.0f} s left"
    if seconds < 5400.0:
        return f"about {seconds / 60:.0f} min left"
    return f"about {seconds / 3600:.1f} h left"


@contextmanager
def _show_status(status: _Status, every: float | None = None) -> Generator[None]:
    """Show the status meanwhile: on a terminal with rich, elsewhere as plain lines."""
    every = EVERY if every is None else every
    if sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True).status(status):
            yield
        return
    ended = Event()
    lines = Thread(target=_plain_lines, args=(status, ended, every), daemon=True)
    lines.start()
    try:
        yield
    finally:
        ended.set()
        lines.join()


def _plain_lines(status: _Status, ended: Event, every: float) -> None:
    while not ended.wait(every):
        print_status(f"rotorfit: {status.text()}")
