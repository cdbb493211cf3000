"""What a worker does with one log: nothing twice, nothing for ever, and never only in memory.

While a log is worked on a file of its own stands in the folder ``running``: a process that ends
leaves it behind, with the reason if that was the time limit.
"""

import faulthandler
import hashlib
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rotorfit.errors import RotorfitError
from rotorfit.fleet.entries import key_of, read_entry, write_entry
from rotorfit.fleet.listing import FlightTask
from rotorfit.fleet.one_flight import entry_of, experiment_of, failure_of, fingerprint_of
from rotorfit.fleet.records import FlightFailure
from rotorfit.logs.files import read_head
from rotorfit.logs.read import logs_in_file

TRIES: Final = 2
"""Processes that a log may end before it is left out."""
_BEGAN: Final = "began\n"
_TIMEOUT: Final = "Timeout ("  # as faulthandler begins what it writes
_ONE_AT_A_TIME: Final = threading.Lock()
"""The clock and the threads of the linear algebra are the process's: its threads take turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Desk:
    """Where and how long to work on a log.

    Attributes
    ----------
    cache
        Folder of the entries.
    time_limit
        Of a log [s], after which its process is ended; None: none, and no process is ended.
    """

    cache: Path
    time_limit: float | None = None

    @property
    def running(self) -> Path:
        """Folder of the logs that are worked on."""
        return self.cache / "running"


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskOutcome:
    """What came of a task: the key of its entry, or a failure, or the logs that its file holds.

    `fresh`: it was worked on now; else it was kept from before.
    """

    task: FlightTask
    key: str | None = None
    failure: FlightFailure | None = None
    numbers: tuple[int, ...] = ()
    fresh: bool = False


def worked(task: FlightTask, desk: Desk) -> TaskOutcome:
    """Return what came of a log; its entry is in the cache then."""
    with _ONE_AT_A_TIME:
        before = left_behind(task, desk)
        if before is not None:
            return before
        try:
            with _guarded(task, desk):
                return _worked(task, desk.cache)
        except (RotorfitError, OSError) as error:
            return TaskOutcome(task=task, failure=failure_of(str(error)), fresh=True)


def worked_batch(tasks: tuple[FlightTask, ...], desk: Desk) -> tuple[TaskOutcome, ...]:
    """Return what came of several logs, one after the other."""
    return tuple(worked(task, desk) for task in tasks)


def _worked(task: FlightTask, cache: Path) -> TaskOutcome:
    path = Path(task.file)
    logs = logs_in_file(path) if task.log_number is None else ()
    if len(logs) > 1:
        return TaskOutcome(task=task, numbers=tuple(log.number for log in logs))
    if not path.is_dir():
        read_head(path, 1)
    experiment = experiment_of(task)
    key = key_of(fingerprint_of(path), experiment)
    if read_entry(cache, key) is not None:
        return TaskOutcome(task=task, key=key)
    write_entry(cache, key, entry_of(experiment))
    return TaskOutcome(task=task, key=key, fresh=True)


def was_begun(task: FlightTask, desk: Desk) -> bool:
    """Return whether a process began with a log and did not come to its end."""
    return _mark(task, desk).exists()


def _mark(task: FlightTask, desk: Desk) -> Path:
    return desk.running / hashlib.sha256(repr(task).encode()).hexdigest()[:32]


def left_behind(task: FlightTask, desk: Desk) -> TaskOutcome | None:
    """Return the answer to a log over which earlier processes ended; None where it may be tried."""
    mark = _mark(task, desk)
    if not mark.exists():
        return None
    text = mark.read_text(encoding="utf-8", errors="replace")
    if _TIMEOUT in text:
        failure = FlightFailure(
            file="",
            reason=f"stopped after {desk.time_limit:g} s, the time limit of a log",
            what_to_do="give it longer (--time-limit); if it never ends, report it with the log",
        )
    elif text.count(_BEGAN) >= TRIES:
        failure = FlightFailure(
            file="",
            reason=f"the process that worked on it died, {TRIES} times",
            what_to_do="it may need more memory than there is: use fewer --workers, or identify it "
            "by itself; else report it with the log",
        )
    else:
        return None
    mark.unlink()
    return TaskOutcome(task=task, failure=failure, fresh=True)


@contextmanager
def _guarded(task: FlightTask, desk: Desk) -> Generator[None]:
    """End this process where a log takes too long, leaving behind which and why."""
    if desk.time_limit is None:
        yield
        return
    mark = _mark(task, desk)
    with mark.open("a", encoding="utf-8") as file:
        file.write(_BEGAN)
        file.flush()
        # From C, so that neither a loop in C nor one that holds the interpreter's lock escapes it.
        faulthandler.dump_traceback_later(desk.time_limit, exit=True, file=file)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
    mark.unlink(missing_ok=True)
