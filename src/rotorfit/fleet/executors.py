"""Who does the work: processes of this machine, or a Dask cluster; each answers every task.

The answers come in any order. A process that ends, or is ended because a log takes too long, costs
only the log at fault: what was at work when it ended is done again, one log alone in a process.
"""

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
from typing import Any, Final, TypeVar

from rotorfit import version
from rotorfit.errors import OutputError
from rotorfit.fleet.listing import FlightTask
from rotorfit.fleet.work import TRIES, Desk, TaskOutcome, left_behind, was_begun, worked_batch

BATCH: Final = 30
"""Logs of a task on a cluster, which takes some 16 ms a task by itself."""
AHEAD: Final = 3
"""Tasks a worker that are handed over before they are needed: a million would fill the memory."""
CONNECT_SECONDS: Final = 15
Batch = tuple[FlightTask, ...]
Item = TypeVar("Item")
Found = TypeVar("Found")
Work = Callable[[Batch], tuple[TaskOutcome, ...]]


def by_processes(
    tasks: Sequence[FlightTask], desk: Desk, *, workers: int
) -> Generator[TaskOutcome]:
    """Yield the answer to every task, from processes of this machine.

    Parameters
    ----------
    tasks
        The logs.
    desk
        Where they leave what they find; with a time limit.
    workers
        How many processes.
    """
    work = partial(worked_batch, desk=desk)
    left: deque[Batch] = deque((task,) for task in tasks)
    fruitless = 0
    while left:
        broken: list[Batch] = []
        with _processes(min(workers, len(left))) as pool:
            yield from _answers(pool, left, work, ahead=AHEAD * workers, broken=broken)
        begun = [batch for batch in broken if was_begun(batch[0], desk)]
        fruitless = 0 if begun or not broken else fruitless + 1
        if fruitless > TRIES:
            _refuse_unanswered(broken)
        left.extendleft(batch for batch in broken if batch not in begun)
        yield from _alone([batch[0] for batch in begun], desk, work)


def by_cluster(
    tasks: Sequence[FlightTask], desk: Desk, *, scheduler: str
) -> Generator[TaskOutcome]:
    """Yield the answer to every task, from the workers of a Dask cluster.

    Parameters
    ----------
    tasks
        The logs; the workers find them, and the desk, under the same paths.
    desk
        Where they leave what they find; with a time limit.
    scheduler
        Address of the cluster, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    OutputError
        If ``distributed`` is not installed, nobody answers there, or the workers have another
        rotorfit.
    """
    work = partial(worked_batch, desk=desk)
    with _cluster(scheduler) as client:
        threads = max(sum(client.nthreads().values()), 1)
        left = deque(tuple(tasks[i : i + BATCH]) for i in range(0, len(tasks), BATCH))
        pool: Executor = client.get_executor(pure=False)
        broken: list[Batch] = []
        yield from _answers(pool, left, work, ahead=AHEAD * threads, broken=broken)
        for _ in range(TRIES + 1):
            left = deque((task,) for batch in broken for task in batch)
            broken = []
            yield from _answers(pool, left, work, ahead=1, broken=broken)
        _refuse_unanswered(broken)


def mapped(
    function: Callable[[Item], Found],
    items: Sequence[Item],
    *,
    workers: int,
    scheduler: str | None = None,
) -> list[Found]:
    """Return what a function makes of every item, in their order: work that ends by itself.

    Parameters
    ----------
    function, items
        Both can be sent to another process.
    workers
        How many processes of this machine; 0: this one.
    scheduler
        Address of a Dask cluster in their place.
    """
    if not items or (workers == 0 and scheduler is None):
        return [function(item) for item in items]
    if scheduler is not None:
        with _cluster(scheduler) as client:
            return list(client.get_executor(pure=False).map(function, items))
    try:
        with _processes(min(workers, len(items))) as pool:
            return list(pool.map(function, items))
    except BrokenExecutor:
        raise OutputError(
            "a worker process died while the flights of a vehicle were fitted together: use fewer "
            "--workers, they may need more memory than there is; nothing done so far is lost"
        ) from None


def _answers(
    pool: Executor, left: deque[Batch], work: Work, *, ahead: int, broken: list[Batch]
) -> Iterator[TaskOutcome]:
    """Yield answers until nothing is left, or the pool is broken; what was at work is then there.

    `left` and `broken` say what remains to be done: not begun, and under way when a process ended.
    """
    at_work: dict[Future[tuple[TaskOutcome, ...]], Batch] = {}
    whole = True
    while at_work or (left and whole):
        while left and whole and len(at_work) < ahead:
            try:
                at_work[pool.submit(work, left[0])] = left[0]
            except BrokenExecutor:
                whole = False
            else:
                left.popleft()
        done, _ = wait(at_work, return_when=FIRST_COMPLETED)
        for future in done:
            batch = at_work.pop(future)
            try:
                yield from future.result()
            except BaseException as error:
                if not _a_process_ended(error):
                    raise
                whole = whole and not isinstance(error, BrokenExecutor)
                broken.append(batch)


def _a_process_ended(error: BaseException) -> bool:
    cluster = type(error).__module__.startswith("distributed")
    return cluster or isinstance(error, BrokenExecutor | CancelledError)


def _alone(tasks: Sequence[FlightTask], desk: Desk, work: Work) -> Iterator[TaskOutcome]:
    """Yield answers to what was at work when a process ended, each in a process of its own."""
    for task in tasks:
        answer = left_behind(task, desk)
        for _ in range(TRIES):
            if answer is not None:
                break
            with _processes(1) as pool:
                broken: list[Batch] = []
                found = list(_answers(pool, deque([(task,)]), work, ahead=1, broken=broken))
            answer = found[0] if found else left_behind(task, desk)
        if answer is None:
            _refuse_unanswered([(task,)])
        else:
            yield answer


def _refuse_unanswered(broken: Sequence[Batch]) -> None:
    """Raise where processes end before they can say which log they work on."""
    if broken:
        raise OutputError(
            "worker processes end as soon as they begin: see what they say above; a script that "
            'calls this needs  if __name__ == "__main__":  around it'
        )


@contextmanager
def _processes(workers: int) -> Generator[Executor]:
    """Give a pool of fresh processes; where the work is broken off they are ended."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_worker
    )
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        own = set(multiprocessing.active_children()) - others
        for process in own:
            process.terminate()
        for process in own:
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
def _cluster(scheduler: str) -> Generator[Any]:
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
        found = client.run(_version)
        if not found:
            raise OutputError(
                f"the cluster at {scheduler} has no workers: start some (dask worker)"
            )
        other = {address: v for address, v in found.items() if v != version.__version__}
        for address, met in other.items():
            raise OutputError(
                f"the worker at {address} has rotorfit {met}, here is {version.__version__}: "
                "install the same everywhere"
            )
        yield client


def _version() -> str:
    return version.__version__
