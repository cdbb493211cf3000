"""What is being done, on stderr, where a person is watching."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

BAR_WIDTH = 30


@contextmanager
def steps() -> Generator[Callable[[str], None]]:
    """Give a function that shows the step at work, and a bar for every log that is read meanwhile.

    Silent where stderr is no terminal.
    """
    if not sys.stderr.isatty():
        yield lambda words: None
        return
    from rich.console import Console

    from rotorfit.logs.progress import watched

    console = Console(stderr=True)
    with console.status("starting") as status:
        now = "starting"

        def show(words: str) -> None:
            nonlocal now
            now = words
            status.update(words)

        def show_reading(path: Path, done: float) -> None:
            status.update(now if done >= 1.0 else _bar(f"reading {path.name}", done))

        with watched(show_reading):
            yield show


def _bar(words: str, done: float) -> "RenderableType":
    """Return words, a bar and a percentage."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    line = Table.grid(padding=(0, 1))
    line.add_row(
        Text(words), ProgressBar(total=1.0, completed=done, width=BAR_WIDTH), f"{100 * done:.0f} %"
    )
    return line
