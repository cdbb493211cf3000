"""How far a log is read, for whoever asked; silent where nobody did."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

Progress = Callable[[float], None]
"""Told how much of a file was gone through: from 0 to 1, never less than before."""
Watcher = Callable[[Path, float], None]
"""Told the same of every file."""
SMALLEST_STEP = 0.01

_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)
_progress: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def watched(watcher: Watcher) -> Generator[None]:
    """Report to a function how far each log is that is read meanwhile.

    For long work that reads logs on its way, such as `identify`. `read_log` itself takes a
    function for its one file.
    """
    before = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(before)


@contextmanager
def read_for(path: Path, progress: Progress | None) -> Generator[None]:
    """Pass on the progress of a file's reader, in steps of a hundredth, ending with 1."""
    watcher = _watcher.get()
    reported = -1.0

    def pass_on(done: float) -> None:
        nonlocal reported
        done = min(done, 1.0)
        # A file that is gone through again begins anew: the first time is what counts.
        if done < reported + SMALLEST_STEP and not (done == 1.0 > reported):
            return
        reported = done
        if progress is not None:
            progress(done)
        if watcher is not None:
            watcher(path, done)

    is_watched = progress is not None or watcher is not None
    before = _progress.set(pass_on if is_watched else None)
    try:
        yield
        pass_on(1.0)
    finally:
        _progress.reset(before)


def report_progress(done: int, size: int) -> None:
    """Tell, as a reader, that so many of a file's bytes were gone through."""
    progress = _progress.get()
    if progress is not None and size > 0:
        progress(done / size)
