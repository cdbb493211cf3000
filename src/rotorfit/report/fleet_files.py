"""The files of a fleet: its tables, and a page for each type of vehicle."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from rotorfit.report.fleet_page import NO_LINKS, Links, fleet_html, report_command, report_name
from rotorfit.tools.fleet.executors import mapped
from rotorfit.tools.fleet.joined import join_tasks, joined_vehicle
from rotorfit.tools.fleet.run import FAILURES, Fleet, FleetType, Workers, refusals_file
from rotorfit.tools.fleet.tables import (
    ROWS,
    Columns,
    flight_columns,
    numbers_of,
    stacked,
    table_file,
    vehicle_columns,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rotorfit.tools.fleet.records import FlightRecord

PAGE: Final = "fleet.html"
REPORTS: Final = "reports"
"""Folder of the flights' own pages, made by the commands that `PAGE` shows."""


def fleet_files(
    fleet: Fleet,
    types: Sequence[FleetType],
    cache: Path,
    workers: Workers,
    *,
    name: str,
    links: Callable[[FleetType], Links] = lambda one: NO_LINKS,
) -> dict[str, bytes]:
    """Write tables and pages of a fleet to bytes, by the names of their files.

    `links` gives, for each type, how its page leads to the flights' own reports (`links_to`).
    """
    tables = [_tabulate_vehicles(one, cache, workers) for one in types]
    pages = [
        (PAGE, _fleet_page(one, name, links(one)))
        if len(types) == 1
        else (f"fleet-{one.name}.html", _fleet_page(one, one.name, links(one)))
        for one in types
    ]
    return dict(
        [
            table_file("flights", _flight_parts(fleet.records)),
            table_file("vehicles", [stacked(tables)]),
            (FAILURES, refusals_file(fleet)),
            *pages,
        ]
    )


def _tabulate_vehicles(one: FleetType, cache: Path, workers: Workers) -> Columns:
    """Fit each vehicle's flights together and tabulate the vehicles of a type."""
    records = one.fleet.records
    tasks = join_tasks(records, one.fleet.cached, cache)
    found = mapped(
        joined_vehicle, list(tasks.values()), workers=workers.count, scheduler=workers.scheduler
    )
    columns = vehicle_columns(records, one.statistics, dict(zip(tasks, found, strict=True)))
    return {"airframe": [one.name] * len(columns["vehicle"]), **columns}


def _flight_parts(records: Sequence[FlightRecord]) -> Iterator[Columns]:
    """Yield the table of flights, some rows at a time."""
    numbers = numbers_of(records)
    for first in range(0, len(records), ROWS):
        yield flight_columns(records[first : first + ROWS], numbers)


def _fleet_page(one: FleetType, name: str, links: Links) -> bytes:
    fleet = one.fleet
    html = fleet_html(one.statistics, fleet.records, fleet.refused, name=name, links=links)
    return html.encode()


def links_to(out: Path, source: Path) -> Callable[[FleetType], Links]:
    """Return how the pages of a fleet lead to its flights' own reports.

    To those in its folder `REPORTS`; of the others the command that makes one there, called where
    the logs are.
    """
    base = source if source.is_dir() else source.parent
    folder = Path(os.path.relpath(out / REPORTS, base)).as_posix()

    def report(record: FlightRecord) -> str:
        name = report_name(record)
        return quote(f"{REPORTS}/{name}") if (out / REPORTS / name).exists() else ""

    def links(one: FleetType) -> Links:
        pairs = zip(one.fleet.records, one.fleet.cached, strict=True)
        airframes = {(r.file, r.log_number): Path(c.task.airframe).name for r, c in pairs}
        return Links(
            report=report,
            command=lambda record: report_command(
                record, folder=folder, airframe=airframes[record.file, record.log_number]
            ),
        )

    return links
