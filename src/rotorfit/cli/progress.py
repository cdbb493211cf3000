"""What is being done and for how long already, on stderr: one line where a person is watching.

Where stderr is a file or a pipe, a plain line every few seconds of longer work.
"""

import sys
import time
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from rotorfit.cli.terminal import print_status

if TYPE_CHECKING:
    from rich.console import RenderableType

BAR_WIDTH = 20
EVERY = 5.0
"""Between the plain lines [s]."""
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

    def __rich__(self) -> "RenderableType":
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
def steps(*, every: float = EVERY) -> Generator[Callable[[str], None]]:
    """Yield a function that shows the step at work, with a bar for every log that is read."""
    from rotorfit.logs.progress import watched

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

    with _shown(status, every), watched(report_reading):
        yield report


@contextmanager
def counted(step: str) -> Generator[Callable[[int, int], None]]:
    """Yield a function that shows how many of how many are done."""
    status = _Status(step)

    def report(done: int, total: int) -> None:
        status.step, status.share = f"{step}, {done} of {total}", done / total

    with _shown(status):
        yield report


@contextmanager
def paced(
    step: str, *, every: float = EVERY, clock: Clock = time.monotonic
) -> Generator[Callable[[int, int], None]]:
    """Yield a function that shows how many of how many are done, how fast, and how long it takes.

    The pace is until now, not until the last that was done: one may take long.
    """
    recent, left = deque([(clock(), 0)]), 0

    def pace() -> str:
        (first, before), (_, done) = recent[0], recent[-1]
        rate = (done - before) / max(clock() - first, 1e-3)
        if rate <= 0.0:
            return ""
        speed = f"{rate:.1f} a second" if rate >= 0.5 else f"{60 * rate:.1f} a minute"
        return f", {speed}, {_remaining(left / rate)}"

    status = _Status(step, pace, clock)

    def report(done: int, total: int) -> None:
        nonlocal left
        recent.append((clock(), done))
        while len(recent) > 2 and recent[-1][0] - recent[0][0] > WINDOW:
            recent.popleft()
        left = total - done
        status.step, status.share = f"{step}, {done} of {total}", done / total

    with _shown(status, every):
        yield report


def _remaining(seconds: float) -> str:
    """Format roughly how long it still takes."""
    if seconds < 90.0:
        return f"about {seconds:.0f} s left"
    if seconds < 5400.0:
        return f"about {seconds / 60:.0f} min left"
    return f"about {seconds / 3600:.1f} h left"


@contextmanager
def _shown(status: _Status, every: float = EVERY) -> Generator[None]:
    """Show the status meanwhile: on a terminal with rich, elsewhere as plain lines."""
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
