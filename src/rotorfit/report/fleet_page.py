"""A fleet as one HTML page that needs nothing else; of bounded size, however many flights."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import number_of, short
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name
from rotorfit.report.fleet_drawings import large_svg, mark_class, scale_of, small_svg, strip_svg
from rotorfit.report.pages import render_page
from rotorfit.report.parameters import unit_words
from rotorfit.tools.fleet.changes import NORMAL_95
from rotorfit.tools.fleet.compared import IN_METRES, THRUST, unit_of
from rotorfit.tools.fleet.findings import (
    VehicleFinding,
    day_text,
    findings,
    flights_of,
    lead_number,
    nothing_found,
    number_phrase,
)
from rotorfit.tools.fleet.random_effects import LEAST_GROUPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rotorfit.tools.fleet.records import FlightRecord, RefusedLog
    from rotorfit.tools.fleet.statistics import FleetStatistics, NumberStatistics

Rendered = dict[str, object]
"""Part of the page, by the names of its template."""
MOST_FINDINGS: Final = 60
MOST_SMALL: Final = 600
"""Small drawings on one page."""
MOST_NUMBERS: Final = 6
"""Numbers that are drawn for each vehicle."""
MOST_ROWS: Final = 1000
"""Vehicles in the table, and flights in the lists of all vehicles together."""
MOST_REASONS: Final = 30
TABLE_NUMBERS: Final = 5
SHOWN: Final = (*THRUST, "com_x", "com_y", "thrust_center_x", "thrust_center_y", "kd", "motor_lag")
"""Numbers that are drawn where there are no findings about others."""


@frozen_dataclass
class Links:
    """The address of a flight's own report from the fleet's page ("": none), and its command."""

    report: Callable[[FlightRecord], str]
    command: Callable[[FlightRecord], str]


def report_name(record: FlightRecord) -> str:
    """Return the file name of the report of a flight, distinct for each flight of a fleet."""
    stem = Path(file_name(record.file)).stem
    number = f"-{record.log_number}" if record.log_number > 1 else ""
    return f"{stem}{number}-{record.sha256[:8]}.html"


def report_command(
    record: FlightRecord, *, folder: str = ".", airframe: str = "airframe.toml"
) -> str:
    """Return the command that identifies one flight again, with a report of its own.

    `folder` is that of the reports, seen from the folder of the logs.
    """
    mass = "unknown" if record.mass is None else str(record.mass)
    number = ["--log", str(record.log_number)] if record.log_number > 1 else []
    report = (PurePosixPath(folder) / report_name(record)).as_posix()
    options = [*number, "--mass", mass, "--airframe", airframe, "--report", report]
    return shlex.join(["rotorfit", "identify", record.file, *options])


UNKNOWN: Final = "–"
SPREADS: Final = ("mean", "between", "within")
"""Columns of the type's table that a small fleet may leave empty."""
NO_LINKS: Final = Links(report=lambda record: "", command=report_command)


def fleet_html(
    statistics: FleetStatistics,
    records: Sequence[FlightRecord],
    refused: Sequence[RefusedLog] = (),
    *,
    name: str = "Fleet",
    links: Links = NO_LINKS,
) -> str:
    """Render a fleet as one self-contained page."""
    found = findings(statistics, records)
    type_rows = [_type_row(n, statistics.vehicles) for n in statistics.numbers]
    return render_page(
        "fleet",
        *("page", "figure", "fleet", "dark"),
        script="fleet.js",
        name=name,
        statistics=statistics,
        records=records,
        refused=refused,
        found=[_render_finding(f, statistics, records) for f in found[:MOST_FINDINGS]],
        more_found=max(len(found) - MOST_FINDINGS, 0),
        type_rows=type_rows,
        type_columns=[key for key in SPREADS if any(row[key] != UNKNOWN for row in type_rows)],
        weather=sorted({n.weather for n in statistics.numbers} - {"none"}),
        least_vehicles=LEAST_GROUPS,
        none_found=nothing_found(statistics),
        sections=_select_sections(statistics, found),
        table=_render_table(statistics, records, found),
        flights=_flight_lists(statistics, records, found, links),
        reasons=_group_reasons(refused),
        most_rows=MOST_ROWS,
    )


def _render_finding(
    finding: VehicleFinding, statistics: FleetStatistics, records: Sequence[FlightRecord]
) -> Rendered:
    """Return a finding with its drawing, as the page has it."""
    number = lead_number(statistics, finding)
    place = number.vehicles.index(finding.vehicle)
    name = statistics.vehicles[finding.vehicle]
    rows: list[int] = number.rows_of(place).tolist()
    days = [records[i].started for i in (rows[0], rows[-1])]
    dates = ["" if day is None else day_text(day) for day in days]
    return {
        "vehicle": name,
        "finding": finding,
        "drawing": large_svg(number, place, name, dates),
        "caption": _number_title(number),
    }


def _number_title(number: NumberStatistics) -> str:
    phrase = number_phrase(number.name)
    of = f", {number.configuration}" if number.configuration else ""
    return f"{phrase[0].upper()}{phrase[1:]}{of}"


def _type_row(number: NumberStatistics, names: Sequence[str]) -> Rendered:
    """Return one number of the type, as the page has it."""
    half = NORMAL_95 * number.mean_std
    mean = number_of(number.mean, (number.mean - half, number.mean + half))
    estimated = np.isfinite(number.between)
    return {
        "title": _number_title(number),
        "name": number.name,
        "mean": str(mean) if estimated and mean is not None else UNKNOWN,
        "unit": unit_words(unit_of(number.name)),
        "between": _format_spread(number.between, number),
        "within": _format_spread(number.within, number),
        "vehicles": len(number.vehicles),
        "strip": strip_svg(number, names),
    }


def _format_spread(std: float, number: NumberStatistics) -> str:
    """Format a standard deviation in percent of the mean, or in millimetres."""
    if not np.isfinite(std):
        return UNKNOWN
    if number.name in IN_METRES:
        return f"{short(1e3 * std)} mm"
    return f"{short(100.0 * std / abs(number.mean))} %"


def _select_sections(
    statistics: FleetStatistics, found: Sequence[VehicleFinding]
) -> list[Rendered]:
    """Select the numbers that are drawn vehicle by vehicle, those with findings first."""
    leads = [lead_number(statistics, finding) for finding in found]
    counts = Counter((number.name, number.configuration) for number in leads)
    by_name = {(n.name, n.configuration): n for n in statistics.numbers}
    keys = [key for key, _ in counts.most_common()]
    keys += [key for name in SHOWN for key in by_name if key[0] == name and key not in keys]
    chosen = [by_name[key] for key in keys[:MOST_NUMBERS]]
    first = list(dict.fromkeys(f.vehicle for f in found))
    return [
        _render_section(n, statistics.vehicles, first, MOST_SMALL // len(chosen)) for n in chosen
    ]


def _render_section(
    number: NumberStatistics, names: Sequence[str], first: Sequence[int], most: int
) -> Rendered:
    """Draw small charts of one number, one a vehicle."""
    scale = scale_of(number)
    order = sorted(number.vehicles, key=lambda v: (v not in first, v))[:most]
    order.sort()
    places = [number.vehicles.index(v) for v in order]
    return {
        "title": _number_title(number),
        "name": number.name,
        "unit": scale.unit,
        "low": f"{scale.low:+.3g}".replace("-", "−"),
        "high": f"{scale.high:+.3g}",
        "drawings": [
            (name, small_svg(number, place, scale, name), mark_class(number, place))
            for place in places
            for name in [names[number.vehicles[place]]]
        ],
        "left_out": len(number.vehicles) - len(places),
    }


@frozen_dataclass
class _Cell:
    """A cell: its text, its sort key, and its tooltip."""

    text: str
    key: float | int | str
    hint: str = ""


def _render_table(
    statistics: FleetStatistics, records: Sequence[FlightRecord], found: Sequence[VehicleFinding]
) -> Rendered:
    """Return each vehicle's flights, main numbers as they are now, and findings."""
    counts = Counter(record.vehicle for record in records)
    seen = Counter(finding.vehicle for finding in found)
    named = [n for n in statistics.numbers if n.name in SHOWN and np.isfinite(n.now).any()]
    numbers = named[:TABLE_NUMBERS]
    order = sorted(range(len(statistics.vehicles)), key=lambda v: (-seen[v], v))[:MOST_ROWS]
    rows = [
        (
            _Cell(text=statistics.vehicles[v], key=statistics.vehicles[v]),
            _Cell(text=str(counts[statistics.vehicles[v]]), key=counts[statistics.vehicles[v]]),
            _Cell(text=str(seen[v]) if seen[v] else "", key=seen[v]),
            *(_number_cell(number, v) for number in numbers),
        )
        for v in order
    ]
    heads = [(_number_title(n), f"{n.name} [{unit_words(unit_of(n.name))}]") for n in numbers]
    return {
        "heads": [("Vehicle", ""), ("Flights", ""), ("To look at", ""), *heads],
        "rows": rows,
        "left_out": len(statistics.vehicles) - len(rows),
    }


def _number_cell(number: NumberStatistics, vehicle: int) -> _Cell:
    """Return a vehicle's number by its own flights, with the one drawn towards the type as hint."""
    if vehicle not in number.vehicles:
        return _Cell(text=UNKNOWN, key=float("-inf"))
    place = number.vehicles.index(vehicle)
    now = _interval_text(float(number.now[place]), float(number.now_std[place]))
    drawn = _interval_text(float(number.shrunk[place]), float(number.shrunk_std[place]))
    hint = f"with the other vehicles' numbers as well: {drawn}" if drawn != "–" else ""
    if number.changes[place]:
        hint = "after its change, by its own flights"
    key = float(number.now[place])
    return _Cell(text=now, key=key if np.isfinite(key) else float("-inf"), hint=hint)


def _interval_text(value: float, std: float) -> str:
    shown = number_of(value, (value - NORMAL_95 * std, value + NORMAL_95 * std))
    return "–" if shown is None else str(shown)


def _flight_lists(
    statistics: FleetStatistics,
    records: Sequence[FlightRecord],
    found: Sequence[VehicleFinding],
    links: Links,
) -> tuple[list[tuple[str, list[Rendered]]], int]:
    """List the flights of each vehicle, those with findings first; count those left out."""
    concerned = {finding.record for finding in found}
    order = list(dict.fromkeys([f.vehicle for f in found] + list(range(len(statistics.vehicles)))))
    out: list[tuple[str, list[Rendered]]] = []
    total = 0
    for v in order:
        flights = flights_of(statistics, v)
        if total + len(flights) > MOST_ROWS:
            break
        total += len(flights)
        rows = [
            _flight_row(records[i], k, i in concerned, links)
            for k, i in enumerate(flights, start=1)
        ]
        out.append((statistics.vehicles[v], rows))
    return out, len(records) - total


def _flight_row(record: FlightRecord, number: int, marked: bool, links: Links) -> Rendered:
    return {
        "number": number,
        "file": file_name(record.file),
        "day": "" if record.started is None else day_text(record.started),
        "seconds": f"{record.seconds_used:.0f}",
        "doubts": len(record.warnings),
        "link": links.report(record),
        "command": links.command(record),
        "marked": marked,
    }


def _group_reasons(refused: Sequence[RefusedLog]) -> list[tuple[str, str, int, str]]:
    """Group refusals: sentence, next step, how many logs, one of them."""
    groups: dict[tuple[str, str], list[str]] = {}
    for log in refused:
        key = (log.refusal.sentence, log.refusal.next_step or "")
        groups.setdefault(key, []).append(log.file)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))[:MOST_REASONS]
    return [(*key, len(files), file_name(files[0])) for key, files in ranked]
