"""What is being done, on stderr, where a person is watching."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager


@contextmanager
def steps() -> Generator[Callable[[str], None]]:
    """Give a function that shows the step at work; silent where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield lambda words: None
        return
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("starting") as status:
        yield lambda words: status.update(words)
