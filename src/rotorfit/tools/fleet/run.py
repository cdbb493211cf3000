"""A fleet, top to bottom: logs to entries, entries to rows, rows to files."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.errors import OutputError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.tools.fleet.executors import (
    TaskOutcome,
    Workspace,
    by_cluster,
    by_processes,
    process_log,
)
from rotorfit.tools.fleet.joined import CachedFlight
from rotorfit.tools.fleet.listing import FlightTask, ListedLog
from rotorfit.tools.fleet.one_flight import experiment_of
from rotorfit.tools.fleet.records import (
    Entry,
    FlightRecord,
    RefusedLog,
    make_folder,
    read_entry,
    refusal,
)
from rotorfit.tools.fleet.statistics import ALARM, FleetStatistics, fleet_statistics
from rotorfit.tools.fleet.tables import (
    csv_bytes,
    refusal_columns,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Sequence

OWNER: Final = "fleet.json"
"""Marks a folder as that of a fleet, and names the source of its logs."""
FAILURES: Final = "failures.csv"
TIME_LIMIT: Final = 600.0
"""Time limit of a log [s], where none is given."""


@frozen_dataclass
class Workers:
    """Who works, with a time limit for a log [s].

    `count` processes of this machine (0: this process alone, which no time limit can end), or the
    Dask cluster of a scheduler's address.
    """

    count: int = 1
    scheduler: str | None = None
    time_limit: float = TIME_LIMIT


@frozen_dataclass
class Progress:
    """How far the work is: `done` of `total` logs, `fresh` of them worked on now."""

    done: int
    total: int
    fresh: int


@frozen_dataclass
class Fleet:
    """What all logs came to, in the order of their names.

    - `records`, `cached`: flights with a row, and where the factors of each are.
    - `refused`: logs that were not identified; some have a row of what their motors show.
    """

    records: tuple[FlightRecord, ...]
    cached: tuple[CachedFlight, ...]
    refused: tuple[RefusedLog, ...]


@frozen_dataclass
class FleetType:
    """The flights of all vehicles of one type, which is one airframe file, and their statistics."""

    name: str
    fleet: Fleet
    statistics: FleetStatistics


def cores() -> int:
    """Count the processors that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


def claim(out: Path, source: Path, *, force: bool) -> None:
    """Make a folder that of a fleet, or find it so.

    Raises `OutputError` where it holds something else, or the fleet of another source.
    """
    owner, mine = out / OWNER, {"source": str(source.absolute())}
    there: list[str] = []
    try:
        there = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        found = json.loads(owner.read_text(encoding="utf-8")) if OWNER in there else None
    except (OSError, ValueError):
        found = None
    if found == mine:
        return
    if there and not force:
        held = "the fleet of another source" if found else ", ".join(there[:3])
        raise OutputError(f"{out} already holds {held}; name another folder, or pass --force")
    make_folder(out)
    write_whole(owner, json.dumps(mine) + "\n", force=True)


def read_fleet(
    logs: Sequence[ListedLog],
    cache: Path,
    workers: Workers,
    *,
    progress: Callable[[Progress], None] = lambda progress: None,
) -> Fleet:
    """Identify every log that is not in the cache, and collect what all came to.

    Raises `RotorfitError` where an airframe file cannot be used (before any log is read).
    """
    for task in {log.task.airframe: log.task for log in logs}.values():
        experiment_of(task)
    space = Workspace(cache=cache, time_limit=workers.time_limit if workers.count else None)
    make_folder(cache)
    shutil.rmtree(space.running, ignore_errors=True)
    make_folder(space.running)
    found: list[tuple[ListedLog, TaskOutcome]] = []
    new, total, fresh = list(logs), len(logs), 0
    while new:
        by_task, new = {log.task: log for log in new}, list[ListedLog]()
        with closing(_run_tasks(list(by_task), space, workers)) as outcomes:
            for outcome in outcomes:
                log = by_task[outcome.task]
                if outcome.numbers:
                    tasks = (replace(log.task, log_number=number) for number in outcome.numbers)
                    new += [replace(log, task=task) for task in tasks]
                    total += len(outcome.numbers) - 1
                else:
                    found.append((log, outcome))
                fresh += outcome.fresh
                progress(Progress(done=len(found), total=total, fresh=fresh))
    shutil.rmtree(space.running, ignore_errors=True)
    found.sort(key=lambda pair: (pair[0].name, pair[0].task.log_number or 0))
    return _collect_rows(found, cache)


def types_of(fleet: Fleet) -> tuple[FleetType, ...]:
    """Split a fleet by airframe, and compare the flights of each type."""
    airframes = sorted({flight.task.airframe for flight in fleet.cached})
    parts = [_of_airframe(fleet, airframe) for airframe in airframes]
    return tuple(
        FleetType(
            name=name,
            fleet=part,
            # The chance of a false change is that of the whole fleet.
            statistics=fleet_statistics(part.records, alarm=ALARM / len(airframes)),
        )
        for name, part in zip(_type_names(airframes), parts, strict=True)
    )


def _type_names(airframes: Sequence[str]) -> list[str]:
    """Return the stem of each airframe file, with its folder where two have the same."""
    stems = [Path(airframe).stem for airframe in airframes]
    return [
        stem if stems.count(stem) == 1 else f"{Path(airframe).parent.name}-{stem}"
        for airframe, stem in zip(airframes, stems, strict=True)
    ]


def _of_airframe(fleet: Fleet, airframe: str) -> Fleet:
    pairs = [
        pair
        for pair in zip(fleet.records, fleet.cached, strict=True)
        if pair[1].task.airframe == airframe
    ]
    return Fleet(
        records=tuple(record for record, _ in pairs),
        cached=tuple(flight for _, flight in pairs),
        refused=tuple(log for log in fleet.refused if log.airframe == airframe),
    )


def refusals_file(fleet: Fleet) -> bytes:
    """Write the table of the logs that were not identified."""
    return csv_bytes([refusal_columns(fleet.refused)])


def _run_tasks(
    tasks: Sequence[FlightTask], space: Workspace, workers: Workers
) -> Generator[TaskOutcome]:
    if workers.scheduler is not None:
        return by_cluster(tasks, space, scheduler=workers.scheduler)
    if workers.count == 0:
        return (process_log(task, space) for task in tasks)
    return by_processes(tasks, space, workers=workers.count)


def _collect_rows(found: Iterable[tuple[ListedLog, TaskOutcome]], cache: Path) -> Fleet:
    """Collect the rows of the logs; a log with the content of an earlier one has none."""
    records: list[FlightRecord] = []
    cached: list[CachedFlight] = []
    refused: list[RefusedLog] = []
    first_names: dict[tuple[str, int], str] = {}
    for log, outcome in found:
        entry = _entry_of_outcome(outcome, cache)
        record, why = entry.record, entry.refusal
        if record is not None:
            first = first_names.setdefault((record.sha256, record.log_number), log.name)
            if first != log.name:
                reason = f"has the same content as {first}: it would count twice"
                record, why = None, refusal("copy", reason, "nothing, or remove one of them")
        if why is not None:
            refused.append(
                RefusedLog(
                    file=log.name,
                    log_number=log.task.log_number or 1,
                    airframe=log.task.airframe,
                    refusal=replace(why, flights=(log.name,)),
                )
            )
        if record is not None:
            records.append(
                replace(
                    record,
                    file=log.name,
                    # As listed, by the log, or by its folder.
                    vehicle=log.vehicle or entry.hardware or Path(log.task.file).parent.name,
                    configuration=log.configuration,
                    checks={},  # they stay in the cache: of many flights they would fill the memory
                )
            )
            cached.append(CachedFlight(key=outcome.key or "", task=log.task))
    return Fleet(records=tuple(records), cached=tuple(cached), refused=tuple(refused))


def _entry_of_outcome(outcome: TaskOutcome, cache: Path) -> Entry:
    if outcome.key is None:
        return Entry(record=None, refusal=outcome.refusal)
    damaged = refusal("cache", "what was kept of it was spoilt meanwhile", "run again")
    return read_entry(cache, outcome.key) or Entry(record=None, refusal=damaged)
