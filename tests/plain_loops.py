"""Time of a piece of work in plain loops of the same process: a busy machine slows both."""

import time
from collections.abc import Callable
from typing import TypeVar

ROUNDS = 100_000
"""Some 3 ms of an idle processor."""

Found = TypeVar("Found")


def plain_loops(work: Callable[[], Found]) -> tuple[float, Found]:
    """Return how many plain loops take as long as the work, and what the work returns."""
    before, _ = _seconds(_loop)
    took, found = _seconds(work)
    after, _ = _seconds(_loop)
    return took / max(before, after), found


def _loop() -> None:
    count = 0
    for number in range(ROUNDS):
        count += number & 1


def _seconds(work: Callable[[], Found]) -> tuple[float, Found]:
    start = time.process_time()
    found = work()
    return time.process_time() - start, found
