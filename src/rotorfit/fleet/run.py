"""A fleet, top to bottom: logs to entries, entries to rows, rows to files."""

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote

from rotorfit.errors import OutputError
from rotorfit.fleet.entries import Entry, make_folder, read_entry
from rotorfit.fleet.executors import by_cluster, by_processes, mapped
from rotorfit.fleet.listing import FlightTask, ListedLog
from rotorfit.fleet.one_flight import experiment_of
from rotorfit.fleet.page import NO_LINKS, Links, fleet_html, report_command, report_name
from rotorfit.fleet.records import (
    Columns,
    FlightFailure,
    FlightRecord,
    failure_columns,
    flight_columns,
    numbers_of,
)
from rotorfit.fleet.statistics import ALARM, FleetStatistics, fleet_statistics
from rotorfit.fleet.tables import ROWS, csv_bytes, stacked, table_file
from rotorfit.fleet.vehicle_table import Kept, join_tasks, joined_vehicle, vehicle_columns
from rotorfit.fleet.work import Desk, TaskOutcome, worked
from rotorfit.logs.files import write_whole

OWNER: Final = "fleet.json"
"""By which a folder is known as one of a fleet: whose logs it is of."""
FAILURES: Final = "failures.csv"
PAGE: Final = "fleet.html"
REPORTS: Final = "reports"
"""Folder of the flights' own pages, made by the commands that `PAGE` shows."""
TIME_LIMIT: Final = 600.0
"""Of a log [s], where none is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Workers:
    """Who works.

    Attributes
    ----------
    count
        Processes of this machine; 0: this process alone, which no time limit can end.
    scheduler
        Address of a Dask cluster in their place.
    time_limit
        Of a log [s].
    """

    count: int = 1
    scheduler: str | None = None
    time_limit: float = TIME_LIMIT


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """How far the work is: `done` of `total` logs, `fresh` of them worked on now."""

    done: int
    total: int
    fresh: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """What all logs came to, in the order of their names.

    Attributes
    ----------
    records
        Flights with a row.
    failures
        Logs that were not identified; some have a row of what their motors tell.
    kept
        Of each record: where its factors are.
    airframes
        Of each failure: the airframe file of its log.
    """

    records: tuple[FlightRecord, ...]
    failures: tuple[FlightFailure, ...]
    kept: tuple[Kept, ...]
    airframes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetType:
    """The flights of all vehicles of one type, which is one airframe file, and what they say.

    Vehicles of different types have nothing to be compared by.
    """

    name: str
    fleet: Fleet
    statistics: FleetStatistics


def cores() -> int:
    """Return how many processors this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


def claim(out: Path, source: Path, *, force: bool) -> None:
    """Make a folder that of a fleet, or find it so.

    Raises
    ------
    OutputError
        If it holds something else, or the fleet of another source, and `force` is false.
    """
    owner, mine = out / OWNER, {"source": str(source.absolute())}
    there: list[str] = []
    try:
        there = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        told = json.loads(owner.read_text(encoding="utf-8")) if OWNER in there else None
    except (OSError, ValueError):
        told = None
    if told == mine:
        return
    if there and not force:
        what = "the fleet of another source" if told else ", ".join(there[:3])
        raise OutputError(f"{out} already holds {what}; name another folder, or pass --force")
    make_folder(out)
    write_whole(owner, json.dumps(mine) + "\n", force=True)


def read_fleet(
    logs: Sequence[ListedLog],
    cache: Path,
    workers: Workers,
    *,
    tell: Callable[[Told], None] = lambda told: None,
) -> Fleet:
    """Return what every log came to; those that are in the cache are not worked on again.

    Parameters
    ----------
    logs
        By `listed_logs`.
    cache
        Folder of the entries, made where there is none.
    workers
        Who works.
    tell
        Told how far the work is.

    Raises
    ------
    RotorfitError
        If an airframe file cannot be used, or nobody can work.
    """
    _refuse_airframes(logs)
    desk = Desk(cache=cache, time_limit=workers.time_limit if workers.count else None)
    make_folder(cache)
    shutil.rmtree(desk.running, ignore_errors=True)
    make_folder(desk.running)
    found: list[tuple[ListedLog, TaskOutcome]] = []
    new, total, fresh = list(logs), len(logs), 0
    while new:
        by_task, new = {log.task: log for log in new}, list[ListedLog]()
        with closing(_answers(list(by_task), desk, workers)) as answers:
            for answer in answers:
                log = by_task[answer.task]
                if answer.numbers:
                    new += [_numbered(log, number) for number in answer.numbers]
                    total += len(answer.numbers) - 1
                else:
                    found.append((log, answer))
                fresh += answer.fresh
                tell(Told(done=len(found), total=total, fresh=fresh))
    shutil.rmtree(desk.running, ignore_errors=True)
    found.sort(key=lambda pair: (pair[0].name, pair[0].task.log_number or 0))
    return _rows(found, cache)


def types_of(fleet: Fleet) -> tuple[FleetType, ...]:
    """Return the types of a fleet, and what the flights of each say together.

    The chance of a false change is that of the whole fleet.
    """
    airframes = sorted({kept.task.airframe for kept in fleet.kept})
    return tuple(
        FleetType(
            name=name,
            fleet=own,
            statistics=fleet_statistics(own.records, alarm=ALARM / len(airframes)),
        )
        for name, own in zip(
            _type_names(airframes), (_of_airframe(fleet, a) for a in airframes), strict=True
        )
    )


def _type_names(airframes: Sequence[str]) -> list[str]:
    """Return a name for each airframe file: its own, with its folder where two have the same."""
    stems = [Path(airframe).stem for airframe in airframes]
    return [
        stem if stems.count(stem) == 1 else f"{Path(airframe).parent.name}-{stem}"
        for airframe, stem in zip(airframes, stems, strict=True)
    ]


def _of_airframe(fleet: Fleet, airframe: str) -> Fleet:
    pairs = [
        pair
        for pair in zip(fleet.records, fleet.kept, strict=True)
        if pair[1].task.airframe == airframe
    ]
    failures = zip(fleet.failures, fleet.airframes, strict=True)
    own = tuple(failure for failure, of in failures if of == airframe)
    return Fleet(
        records=tuple(record for record, _ in pairs),
        kept=tuple(kept for _, kept in pairs),
        failures=own,
        airframes=(airframe,) * len(own),
    )


def fleet_files(
    fleet: Fleet,
    types: Sequence[FleetType],
    cache: Path,
    workers: Workers,
    *,
    name: str,
    links: Callable[[FleetType], Links] = lambda one: NO_LINKS,
) -> dict[str, bytes]:
    """Return tables and pages of a fleet, by the names of their files.

    Parameters
    ----------
    fleet, cache
        By `read_fleet`.
    types
        Of its vehicles; a page each.
    workers
        Who fits the flights of each vehicle together.
    name
        Of the fleet, for people.
    links
        Of each type: how its page leads to the flights' own reports (`links_to`).
    """
    tables = [_vehicles(one, cache, workers) for one in types]
    pages = [
        (PAGE, _page(one, name, links(one)))
        if len(types) == 1
        else (f"fleet-{one.name}.html", _page(one, one.name, links(one)))
        for one in types
    ]
    return dict(
        [
            table_file("flights", _flight_parts(fleet.records)),
            table_file("vehicles", [stacked(tables)]),
            (FAILURES, failures_file(fleet)),
            *pages,
        ]
    )


def _vehicles(one: FleetType, cache: Path, workers: Workers) -> Columns:
    """Return the table of the vehicles of a type."""
    records = one.fleet.records
    tasks = join_tasks(records, one.fleet.kept, cache)
    found = mapped(
        joined_vehicle, list(tasks.values()), workers=workers.count, scheduler=workers.scheduler
    )
    together = dict(zip(tasks, found, strict=True))
    columns = vehicle_columns(records, one.statistics, together)
    return {"airframe": [one.name] * len(columns["vehicle"]), **columns}


def _flight_parts(records: Sequence[FlightRecord]) -> Iterator[Columns]:
    """Yield the table of flights, some rows at a time."""
    numbers = numbers_of(records)
    for first in range(0, len(records), ROWS):
        yield flight_columns(records[first : first + ROWS], numbers)


def _page(one: FleetType, name: str, links: Links) -> bytes:
    fleet = one.fleet
    html = fleet_html(one.statistics, fleet.records, fleet.failures, name=name, links=links)
    return html.encode()


def links_to(out: Path, source: Path) -> Callable[[FleetType], Links]:
    """Return how the pages of a fleet lead to its flights' own reports.

    To those that there are in its folder `REPORTS`; of the others the command that makes one
    there, called where the logs are.

    Parameters
    ----------
    out
        Folder of the fleet.
    source
        Folder of the logs, or their table.
    """
    base = source if source.is_dir() else source.parent
    folder = Path(os.path.relpath(out / REPORTS, base)).as_posix()

    def report(record: FlightRecord) -> str:
        name = report_name(record)
        return quote(f"{REPORTS}/{name}") if (out / REPORTS / name).exists() else ""

    def links(one: FleetType) -> Links:
        pairs = zip(one.fleet.records, one.fleet.kept, strict=True)
        airframes = {(r.file, r.log_number): Path(kept.task.airframe).name for r, kept in pairs}
        return Links(
            report=report,
            command=lambda record: report_command(
                record, folder=folder, airframe=airframes[record.file, record.log_number]
            ),
        )

    return links


def failures_file(fleet: Fleet) -> bytes:
    """Return the table of the logs that were not identified."""
    return csv_bytes([failure_columns(fleet.failures)])


def _refuse_airframes(logs: Sequence[ListedLog]) -> None:
    """Raise where an airframe file cannot be used, before any log is read."""
    for task in {log.task.airframe: log.task for log in logs}.values():
        experiment_of(task)


def _answers(tasks: Sequence[FlightTask], desk: Desk, workers: Workers) -> Generator[TaskOutcome]:
    if workers.scheduler is not None:
        return by_cluster(tasks, desk, scheduler=workers.scheduler)
    if workers.count == 0:
        return (worked(task, desk) for task in tasks)
    return by_processes(tasks, desk, workers=workers.count)


def _numbered(log: ListedLog, number: int) -> ListedLog:
    """Return one log of a file of several."""
    return dataclasses.replace(log, task=dataclasses.replace(log.task, log_number=number))


def _rows(found: Iterable[tuple[ListedLog, TaskOutcome]], cache: Path) -> Fleet:
    """Return the rows of the logs; one whose content was there before has none."""
    records: list[FlightRecord] = []
    failures: list[FlightFailure] = []
    kept: list[Kept] = []
    airframes: list[str] = []
    before: dict[tuple[str, int], str] = {}
    for log, answer in found:
        entry = _entry(answer, cache)
        record, failure = entry.record, entry.failure
        if record is not None:
            first = before.setdefault((record.sha256, record.log_number), log.name)
            if first != log.name:
                record, failure = None, _copy_of(first)
        if failure is not None:
            number = log.task.log_number or 1
            failures.append(dataclasses.replace(failure, file=log.name, log_number=number))
            airframes.append(log.task.airframe)
        if record is not None:
            records.append(
                dataclasses.replace(
                    record,
                    file=log.name,
                    vehicle=_vehicle(log, entry),
                    configuration=log.configuration,
                    checks={},  # they stay in the cache: of many flights they would fill the memory
                )
            )
            kept.append(Kept(key=answer.key or "", task=log.task))
    return Fleet(
        records=tuple(records),
        failures=tuple(failures),
        kept=tuple(kept),
        airframes=tuple(airframes),
    )


def _entry(answer: TaskOutcome, cache: Path) -> Entry:
    if answer.key is None:
        return Entry(record=None, failure=answer.failure)
    entry = read_entry(cache, answer.key)
    if entry is None:
        spoilt = FlightFailure(
            file="", reason="what was kept of it was spoilt meanwhile", what_to_do="run again"
        )
        return Entry(record=None, failure=spoilt)
    return entry


def _copy_of(first: str) -> FlightFailure:
    return FlightFailure(
        file="",
        reason=f"has the same content as {first}: it would count twice",
        what_to_do="nothing, or remove one of them",
    )


def _vehicle(log: ListedLog, entry: Entry) -> str:
    """Return whose flight it is: as said, by the log, or by its folder."""
    return log.vehicle or entry.hardware or Path(log.task.file).parent.name
