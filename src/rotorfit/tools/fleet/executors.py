"""Who does the work: processes of this machine, or a Dask cluster; each task has one outcome.

The outcomes come in any order. A process that ends, or is ended because a log takes too long, costs
only the log at fault: what was at work when it ended is done again, one log alone in a process.
While a log is worked on, a file of its own stands in the folder ``running``: a process that ends
leaves it behind, with the reason if that was the time limit.
"""

from __future__ import annotations

import faulthandler
import hashlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from rotorfit import version
from rotorfit.errors import OutputError, RotorfitError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import read_head
from rotorfit.logs.read import logs_in_file
from rotorfit.tools.fleet.listing import FlightTask
from rotorfit.tools.fleet.one_flight import entry_of, experiment_of, fingerprint_of, refusal_of
from rotorfit.tools.fleet.records import key_of, read_entry, refusal, write_entry

if TYPE_CHECKING:
    from rotorfit.findings import Finding

TRIES: Final = 2
"""Processes that a log may end before it is left out."""
_BEGAN: Final = "began\n"
_TIMEOUT: Final = "Timeout ("  # as faulthandler begins what it writes
_ONE_AT_A_TIME: Final = threading.Lock()
"""The clock and the threads of the linear algebra are the process's: its threads take turns."""
BATCH: Final = 30
"""Logs of a task on a cluster, which takes some 16 ms a task by itself."""
AHEAD: Final = 3
"""Tasks a worker that are handed over before they are needed: a million would fill the memory."""
CONNECT_SECONDS: Final = 15


@frozen_dataclass
class Workspace:
    """Where and how long to work on a log.

    - `cache`: folder of the entries.
    - `time_limit`: of a log [s], after which its process is ended; None: no limit.
    """

    cache: Path
    time_limit: float | None = None

    @property
    def running(self) -> Path:
        """Folder of the logs that are worked on."""
        return self.cache / "running"

    def mark_of(self, task: FlightTask) -> Path:
        """Return the file that stands while a log is worked on."""
        return self.running / hashlib.sha256(repr(task).encode()).hexdigest()[:32]


@frozen_dataclass
class TaskOutcome:
    """What came of a task: the key of its entry, or a refusal, or the logs that its file holds.

    `fresh`: it was worked on now; else it was cached.
    """

    task: FlightTask
    key: str | None = None
    refusal: Finding | None = None
    numbers: tuple[int, ...] = ()
    fresh: bool = False


Batch = tuple[FlightTask, ...]
Work = Callable[[Batch], tuple[TaskOutcome, ...]]
Item = TypeVar("Item")
Found = TypeVar("Found")


def process_log(task: FlightTask, space: Workspace) -> TaskOutcome:
    """Identify a log; its entry is in the cache then."""
    with _ONE_AT_A_TIME:
        earlier = _abandoned_outcome(task, space)
        if earlier is not None:
            return earlier
        try:
            with _time_limited(task, space):
                return _process_task(task, space.cache)
        except (RotorfitError, OSError) as error:
            return TaskOutcome(task=task, refusal=refusal_of(str(error)), fresh=True)


def process_batch(tasks: Batch, space: Workspace) -> tuple[TaskOutcome, ...]:
    """Identify several logs, one after the other."""
    return tuple(process_log(task, space) for task in tasks)


def _process_task(task: FlightTask, cache: Path) -> TaskOutcome:
    path = Path(task.file)
    logs = logs_in_file(path) if task.log_number is None else ()
    if len(logs) > 1:
        return TaskOutcome(task=task, numbers=tuple(sorted(log.number for log in logs)))
    if not path.is_dir():
        read_head(path, 1)
    experiment = experiment_of(task)
    key = key_of(fingerprint_of(path), experiment)
    if read_entry(cache, key) is not None:
        return TaskOutcome(task=task, key=key)
    write_entry(cache, key, entry_of(experiment))
    return TaskOutcome(task=task, key=key, fresh=True)


def _abandoned_outcome(task: FlightTask, space: Workspace) -> TaskOutcome | None:
    """Return the outcome of a log over which processes ended; None if it may be tried again."""
    mark = space.mark_of(task)
    if not mark.exists():
        return None
    text = mark.read_text(encoding="utf-8", errors="replace")
    if _TIMEOUT in text:
        why = refusal(
            "time-limit",
            f"stopped after {space.time_limit:g} s, the time limit of a log",
            "give it longer (--time-limit); if it never ends, report it with the log",
        )
    elif text.count(_BEGAN) >= TRIES:
        why = refusal(
            "process-died",
            f"the process that worked on it died, {TRIES} times",
            "it may need more memory than there is: use fewer --workers, or identify it "
            "by itself; else report it with the log",
        )
    else:
        return None
    mark.unlink()
    return TaskOutcome(task=task, refusal=why, fresh=True)


@contextmanager
def _time_limited(task: FlightTask, space: Workspace) -> Generator[None]:
    """End this process where a log takes too long, leaving behind which and why."""
    if space.time_limit is None:
        yield
        return
    mark = space.mark_of(task)
    with mark.open("a", encoding="utf-8") as file:
        file.write(_BEGAN)
        file.flush()
        # From C, so that neither a loop in C nor one that holds the interpreter's lock escapes it.
        faulthandler.dump_traceback_later(space.time_limit, exit=True, file=file)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
    mark.unlink(missing_ok=True)


def by_processes(
    tasks: Sequence[FlightTask], space: Workspace, *, workers: int
) -> Generator[TaskOutcome]:
    """Yield the outcome of every task, from processes of this machine; with a time limit."""
    work = partial(process_batch, space=space)
    waiting: deque[Batch] = deque((task,) for task in tasks)
    fruitless = 0
    while waiting:
        interrupted: list[Batch] = []
        with _process_pool(min(workers, len(waiting))) as pool:
            yield from _yield_outcomes(
                pool, waiting, work, ahead=AHEAD * workers, interrupted=interrupted
            )
        begun = [batch for batch in interrupted if space.mark_of(batch[0]).exists()]
        fruitless = 0 if begun or not interrupted else fruitless + 1
        if fruitless > TRIES:
            _refuse_unfinished(interrupted)
        waiting.extendleft(batch for batch in interrupted if batch not in begun)
        yield from _work_alone([batch[0] for batch in begun], space, work)


def by_cluster(
    tasks: Sequence[FlightTask], space: Workspace, *, scheduler: str
) -> Generator[TaskOutcome]:
    """Yield the outcome of every task, from the workers of a Dask cluster; with a time limit.

    The workers find logs and cache under the same paths. Raises `OutputError` where ``distributed``
    is not installed, nothing responds at `scheduler`, or the workers have another rotorfit.
    """
    work = partial(process_batch, space=space)
    with _cluster_client(scheduler) as client:
        threads = max(sum(client.nthreads().values()), 1)
        waiting = deque(tuple(tasks[i : i + BATCH]) for i in range(0, len(tasks), BATCH))
        pool: Executor = client.get_executor(pure=False)
        interrupted: list[Batch] = []
        yield from _yield_outcomes(
            pool, waiting, work, ahead=AHEAD * threads, interrupted=interrupted
        )
        for _ in range(TRIES + 1):
            waiting = deque((task,) for batch in interrupted for task in batch)
            interrupted = []
            yield from _yield_outcomes(pool, waiting, work, ahead=1, interrupted=interrupted)
        _refuse_unfinished(interrupted)


def mapped(
    function: Callable[[Item], Found],
    items: Sequence[Item],
    *,
    workers: int,
    scheduler: str | None = None,
) -> list[Found]:
    """Apply a function to every item, in their order: on a cluster, in processes or (0) here.

    Function and items can be sent to another process; the work ends by itself.
    """
    if not items or (workers == 0 and scheduler is None):
        return [function(item) for item in items]
    if scheduler is not None:
        with _cluster_client(scheduler) as client:
            return list(client.get_executor(pure=False).map(function, items))
    try:
        with _process_pool(min(workers, len(items))) as pool:
            return list(pool.map(function, items))
    except BrokenExecutor:
        raise OutputError(
            "a worker process died while the flights of a vehicle were fitted together: use fewer "
            "--workers, they may need more memory than there is; nothing done so far is lost"
        ) from None


def _yield_outcomes(
    pool: Executor, waiting: deque[Batch], work: Work, *, ahead: int, interrupted: list[Batch]
) -> Iterator[TaskOutcome]:
    """Yield outcomes until nothing waits, or the pool is broken.

    `waiting` and `interrupted` hold the rest: not begun, and at work when a process ended.
    """
    at_work: dict[Future[tuple[TaskOutcome, ...]], Batch] = {}
    whole = True
    while at_work or (waiting and whole):
        while waiting and whole and len(at_work) < ahead:
            try:
                at_work[pool.submit(work, waiting[0])] = waiting[0]
            except BrokenExecutor:
                whole = False
            else:
                waiting.popleft()
        done, _ = wait(at_work, return_when=FIRST_COMPLETED)
        for future in done:
            batch = at_work.pop(future)
            try:
                yield from future.result()
            except BaseException as error:
                lost_worker = type(error).__module__.startswith("distributed")
                if not (lost_worker or isinstance(error, BrokenExecutor | CancelledError)):
                    raise
                whole = whole and not isinstance(error, BrokenExecutor)
                interrupted.append(batch)


def _work_alone(tasks: Sequence[FlightTask], space: Workspace, work: Work) -> Iterator[TaskOutcome]:
    """Yield outcomes of what was at work when a process ended, each from a process of its own."""
    for task in tasks:
        outcome = _abandoned_outcome(task, space)
        for _ in range(TRIES):
            if outcome is not None:
                break
            with _process_pool(1) as pool:
                found = list(_yield_outcomes(pool, deque([(task,)]), work, ahead=1, interrupted=[]))
            outcome = found[0] if found else _abandoned_outcome(task, space)
        if outcome is None:
            _refuse_unfinished([(task,)])
        else:
            yield outcome


def _refuse_unfinished(interrupted: Sequence[Batch]) -> None:
    """Raise an error if processes end before they can say which log they work on."""
    if interrupted:
        raise OutputError(
            "worker processes end as soon as they begin: see what they say above; a script that "
            'calls this needs  if __name__ == "__main__":  around it'
        )


@contextmanager
def _process_pool(workers: int) -> Generator[Executor]:
    """Give a pool of fresh processes; where the work is broken off they are ended."""
    earlier = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_worker
    )
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        started = set(multiprocessing.active_children()) - earlier
        for process in started:
            process.terminate()
        for process in started:
            process.join()
        raise
    pool.shutdown()


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


@contextmanager
def _cluster_client(scheduler: str) -> Generator[Any]:
    """Give a client of a Dask cluster whose workers have this rotorfit."""
    try:
        distributed = import_module("distributed")
    except ImportError:
        raise OutputError(
            "--scheduler needs Dask's distributed: pip install 'rotorfit[dask]'"
        ) from None
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise OutputError(
            f"no Dask scheduler answers at {scheduler} ({error}): check the address, and that "
            "it runs (dask scheduler)"
        ) from error
    with client:
        found = client.run(_worker_version)
        if not found:
            raise OutputError(
                f"the cluster at {scheduler} has no workers: start some (dask worker)"
            )
        for address, met in found.items():
            if met != version.__version__:
                raise OutputError(
                    f"the worker at {address} has rotorfit {met}, here is {version.__version__}: "
                    "install the same everywhere"
                )
        yield client


def _worker_version() -> str:
    return version.__version__
