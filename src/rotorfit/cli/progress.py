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

from rotorfit.cli.terminal import say

if TYPE_CHECKING:
    from rich.console import RenderableType

BAR_WIDTH = 20
EVERY = 5.0
"""Between the plain lines [s]."""
LATELY = 60.0
"""Over which a pace is taken [s]."""


class _Now:
    """What is being done now, and since when: rich and the plain lines look at it again and again.

    Attributes
    ----------
    words
        The step.
    share
        How far it is, from 0 to 1; None where that is not known.
    pace
        Says how fast it goes at the moment of the call; "" where that is not known.
    """

    def __init__(self, pace: Callable[[], str] = lambda: "") -> None:
        self.words = "starting"
        self.share: float | None = None
        self.pace = pace
        self._began = time.monotonic()

    def text(self) -> str:
        """Return the step in one line. What has passed is said as such."""
        share = "" if self.share is None else f", {100 * self.share:.0f} %"
        return f"{self.words}{self.pace()}{share} ({time.monotonic() - self._began:.0f} s so far)"

    def __rich__(self) -> "RenderableType":
        """Return the same with a bar."""
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
def steps() -> Generator[Callable[[str], None]]:
    """Give a function that shows the step at work, with a bar for every log that is read."""
    from rotorfit.logs.progress import watched

    now = _Now()
    step = now.words

    def show(words: str) -> None:
        nonlocal step
        step, now.words, now.share = words, words, None

    def show_reading(path: Path, done: float) -> None:
        if done >= 1.0:
            now.words, now.share = step, None
        else:
            now.words, now.share = f"reading {path.name}", done

    with _shown(now), watched(show_reading):
        yield show


@contextmanager
def counted(what: str) -> Generator[Callable[[int, int], None]]:
    """Give a function that shows how many of how many are done."""
    now = _Now()
    now.words = what

    def show(done: int, total: int) -> None:
        now.words, now.share = f"{what}, {done} of {total}", done / total

    with _shown(now):
        yield show


@contextmanager
def paced(what: str) -> Generator[Callable[[int, int], None]]:
    """Give a function that shows how many of how many are done, how fast, and how long it takes."""
    lately, left = deque([(time.monotonic(), 0)]), 0

    def pace() -> str:
        """Return the pace until now, not until the last that was done: one may take long."""
        (first, before), (_, done) = lately[0], lately[-1]
        each = (done - before) / max(time.monotonic() - first, 1e-3)
        return f", {_pace(each)}, {_minutes(left / each)}" if each > 0.0 else ""

    now = _Now(pace)
    now.words = what

    def show(done: int, total: int) -> None:
        nonlocal left
        lately.append((time.monotonic(), done))
        while len(lately) > 2 and lately[-1][0] - lately[0][0] > LATELY:
            lately.popleft()
        left = total - done
        now.words, now.share = f"{what}, {done} of {total}", done / total

    with _shown(now):
        yield show


def _pace(pace: float) -> str:
    return f"{pace:.1f} a second" if pace >= 0.5 else f"{60 * pace:.1f} a minute"


def _minutes(seconds: float) -> str:
    """Return roughly how long it still takes."""
    if seconds < 90.0:
        return f"about {seconds:.0f} s left"
    return (
        f"about {seconds / 60:.0f} min left"
        if seconds < 5400.0
        else (f"about {seconds / 3600:.1f} h left")
    )


@contextmanager
def _shown(now: _Now) -> Generator[None]:
    """Show what is being done, meanwhile."""
    if sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True).status(now):
            yield
        return
    ended = Event()
    lines = Thread(target=_plain_lines, args=(now, ended), daemon=True)
    lines.start()
    try:
        yield
    finally:
        ended.set()
        lines.join()


def _plain_lines(now: _Now, ended: Event) -> None:
    while not ended.wait(EVERY):
        say(f"rotorfit: {now.text()}")
