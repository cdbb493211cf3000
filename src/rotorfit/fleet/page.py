"""A fleet as one HTML page that needs nothing else; of bounded size, however many flights."""

import shlex
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from rotorfit.fleet.compared import IN_METRES, THRUST, unit_of
from rotorfit.fleet.drawings import large_svg, scale_of, small_svg, strip_svg
from rotorfit.fleet.findings import (
    Finding,
    day_words,
    findings,
    number_words,
    own_records,
)
from rotorfit.fleet.population.changes import NORMAL_95
from rotorfit.fleet.population.random_effects import LEAST_GROUPS
from rotorfit.fleet.records import FlightFailure, FlightRecord
from rotorfit.fleet.statistics import FleetStatistics, NumberStatistics
from rotorfit.formatting.digits import number_of
from rotorfit.logs.files import file_name
from rotorfit.report.number_words import unit_words
from rotorfit.report.pages import render_page

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
"""Numbers that are drawn where nothing is to be said of others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Links:
    """How the reader gets to a flight's own report.

    Attributes
    ----------
    report
        Returns the address of the report of a record, from the fleet's page; "" where none is.
    command
        Returns the command that makes it.
    """

    report: Callable[[FlightRecord], str]
    command: Callable[[FlightRecord], str]


def report_name(record: FlightRecord) -> str:
    """Return the name of the page of a flight: one for each flight of a fleet."""
    stem = Path(file_name(record.file)).stem
    number = f"-{record.log_number}" if record.log_number > 1 else ""
    return f"{stem}{number}-{record.sha256[:8]}.html"


def report_command(
    record: FlightRecord, *, folder: str = ".", airframe: str = "airframe.toml"
) -> str:
    """Return the command that identifies one flight again, with a page of its own.

    Parameters
    ----------
    record
        Of the flight.
    folder
        Of the page, seen from that of the logs.
    airframe
        File of its airframe.
    """
    mass = "unknown" if record.mass is None else str(record.mass)
    number = ["--log", str(record.log_number)] if record.log_number > 1 else []
    words = ["rotorfit", "identify", record.file, *number, "--mass", mass, "--airframe", airframe]
    return shlex.join(
        [*words, "--report", (PurePosixPath(folder) / report_name(record)).as_posix()]
    )


NO_LINKS: Final = Links(report=lambda record: "", command=report_command)


def fleet_html(
    statistics: FleetStatistics,
    records: Sequence[FlightRecord],
    failures: Sequence[FlightFailure] = (),
    *,
    name: str = "Fleet",
    links: Links = NO_LINKS,
) -> str:
    """Return a fleet as one self-contained page.

    Parameters
    ----------
    statistics
        By `fleet_statistics`.
    records, failures
        Flights, and logs without a row.
    name
        Of the fleet.
    links
        To the flights' own reports.
    """
    found = findings(statistics, records)
    return render_page(
        "fleet",
        *("page", "figure", "fleet", "dark"),
        script="fleet.js",
        name=name,
        statistics=statistics,
        records=records,
        failures=failures,
        found=[_finding(f, statistics, records) for f in found[:MOST_FINDINGS]],
        more_found=max(len(found) - MOST_FINDINGS, 0),
        type_rows=[_type_row(n, statistics.vehicles) for n in statistics.numbers],
        weather=sorted({n.weather for n in statistics.numbers} - {"none"}),
        draws_to_type=len(statistics.vehicles) >= LEAST_GROUPS,
        sections=_sections(statistics, found),
        table=_table(statistics, records, found),
        flights=_flight_lists(statistics, records, found, links),
        reasons=_reasons(failures),
        most_rows=MOST_ROWS,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """A finding as the page has it."""

    vehicle: str
    sort: str
    sentence: str
    advice: str
    drawing: str
    caption: str


def _finding(
    finding: Finding, statistics: FleetStatistics, records: Sequence[FlightRecord]
) -> _Shown:
    lead = finding.numbers[0]
    name = statistics.vehicles[finding.vehicle]
    rows: list[int] = lead.number.rows_of(lead.place).tolist()
    days = (records[rows[0]].started, records[rows[-1]].started)
    return _Shown(
        vehicle=name,
        sort=finding.sort,
        sentence=finding.sentence,
        advice=finding.advice,
        drawing=large_svg(
            lead.number,
            lead.place,
            name,
            tuple("" if day is None else day_words(day) for day in days),
        ),
        caption=_title(lead.number),
    )


def _title(number: NumberStatistics) -> str:
    words = number_words(number.name)
    of = f", {number.configuration}" if number.configuration else ""
    return f"{words[0].upper()}{words[1:]}{of}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _TypeRow:
    """One number of the type."""

    title: str
    name: str
    mean: str
    unit: str
    between: str
    within: str
    vehicles: int
    strip: str


def _type_row(number: NumberStatistics, names: Sequence[str]) -> _TypeRow:
    half = NORMAL_95 * number.mean_std
    mean = number_of(number.mean, (number.mean - half, number.mean + half))
    told = np.isfinite(number.between)
    return _TypeRow(
        title=_title(number),
        name=number.name,
        mean=str(mean) if told and mean is not None else "–",
        unit=unit_words(unit_of(number.name)),
        between=_spread(number.between, number),
        within=_spread(number.within, number),
        vehicles=len(number.vehicles),
        strip=strip_svg(number, names),
    )


def _spread(std: float, number: NumberStatistics) -> str:
    """Return a standard deviation in percent of the mean, or in millimetres."""
    if not np.isfinite(std):
        return "–"
    if number.name in IN_METRES:
        return f"{1e3 * std:.2g} mm"
    return f"{100.0 * std / abs(number.mean):.2g} %"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Section:
    """Small drawings of one number, one a vehicle."""

    title: str
    name: str
    unit: str
    low: str
    high: str
    drawings: tuple[tuple[str, str, str], ...]
    left_out: int


def _sections(statistics: FleetStatistics, found: Sequence[Finding]) -> list[_Section]:
    """Return the numbers that are drawn vehicle by vehicle: those with findings first."""
    said = Counter((s.number.name, s.number.configuration) for f in found for s in f.numbers[:1])
    by_name = {(n.name, n.configuration): n for n in statistics.numbers}
    keys = [key for key, _ in said.most_common()]
    keys += [key for name in SHOWN for key in by_name if key[0] == name and key not in keys]
    chosen = [by_name[key] for key in keys[:MOST_NUMBERS]]
    first = list(dict.fromkeys(f.vehicle for f in found))
    return [_section(n, statistics.vehicles, first, MOST_SMALL // len(chosen)) for n in chosen]


def _section(
    number: NumberStatistics, names: Sequence[str], first: Sequence[int], most: int
) -> _Section:
    scale = scale_of(number)
    order = sorted(number.vehicles, key=lambda v: (v not in first, v))[:most]
    order.sort()
    places = [number.vehicles.index(v) for v in order]
    return _Section(
        title=_title(number),
        name=number.name,
        unit=scale.unit,
        low=f"{scale.low:+.3g}".replace("-", "−"),
        high=f"{scale.high:+.3g}",
        drawings=tuple(
            (
                names[number.vehicles[place]],
                small_svg(number, place, scale, names[number.vehicles[place]]),
                "apart" if number.apart[place] else "changed" if number.changes[place] else "like",
            )
            for place in places
        ),
        left_out=len(number.vehicles) - len(places),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cell:
    """A cell: what is read, what it is sorted by, and what a pointer over it says."""

    text: str
    key: float | int | str
    hint: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """The table of vehicles."""

    heads: tuple[tuple[str, str], ...]
    rows: tuple[tuple[_Cell, ...], ...]
    left_out: int


def _table(
    statistics: FleetStatistics, records: Sequence[FlightRecord], found: Sequence[Finding]
) -> _Table:
    """Return each vehicle's flights, main numbers as they are now, and findings."""
    counts = Counter(record.vehicle for record in records)
    said = Counter(finding.vehicle for finding in found)
    numbers = [n for n in statistics.numbers if n.name in SHOWN][:TABLE_NUMBERS]
    order = sorted(range(len(statistics.vehicles)), key=lambda v: (-said[v], v))[:MOST_ROWS]
    rows = [
        (
            _Cell(text=statistics.vehicles[v], key=statistics.vehicles[v]),
            _Cell(text=str(counts[statistics.vehicles[v]]), key=counts[statistics.vehicles[v]]),
            _Cell(text=str(said[v]) if said[v] else "", key=said[v]),
            *(_number_cell(number, v) for number in numbers),
        )
        for v in order
    ]
    heads = [(_title(n), f"{n.name} [{unit_words(unit_of(n.name))}]") for n in numbers]
    return _Table(
        heads=(("Vehicle", ""), ("Flights", ""), ("To look at", ""), *heads),
        rows=tuple(rows),
        left_out=len(statistics.vehicles) - len(rows),
    )


def _number_cell(number: NumberStatistics, vehicle: int) -> _Cell:
    """Return a vehicle's number by its own flights, and drawn towards the type beside it."""
    if vehicle not in number.vehicles:
        return _Cell(text="–", key=float("-inf"))
    place = number.vehicles.index(vehicle)
    own = _interval_words(float(number.now[place]), float(number.now_std[place]))
    drawn = _interval_words(float(number.shrunk[place]), float(number.shrunk_std[place]))
    hint = f"with what the type tells: {drawn}" if drawn != "–" else ""
    if number.changes[place]:
        hint = "after its change, by its own flights"
    key = float(number.now[place])
    return _Cell(text=own, key=key if np.isfinite(key) else float("-inf"), hint=hint)


def _interval_words(value: float, std: float) -> str:
    shown = number_of(value, (value - NORMAL_95 * std, value + NORMAL_95 * std))
    return "–" if shown is None else str(shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class _FlightRow:
    """A flight in the list of its vehicle."""

    number: int
    file: str
    day: str
    seconds: str
    doubts: int
    link: str
    command: str
    marked: bool


def _flight_lists(
    statistics: FleetStatistics,
    records: Sequence[FlightRecord],
    found: Sequence[Finding],
    links: Links,
) -> tuple[list[tuple[str, list[_FlightRow]]], int]:
    """Return the flights of each vehicle, those with findings first, and how many are left out."""
    concerned = {finding.record for finding in found}
    order = list(dict.fromkeys([f.vehicle for f in found] + list(range(len(statistics.vehicles)))))
    out: list[tuple[str, list[_FlightRow]]] = []
    total = 0
    for v in order:
        own = own_records(statistics, v)
        if total + len(own) > MOST_ROWS:
            break
        total += len(own)
        rows = [
            _flight_row(records[i], k, i in concerned, links) for k, i in enumerate(own, start=1)
        ]
        out.append((statistics.vehicles[v], rows))
    return out, len(records) - total


def _flight_row(record: FlightRecord, number: int, marked: bool, links: Links) -> _FlightRow:
    return _FlightRow(
        number=number,
        file=file_name(record.file),
        day="" if record.started is None else day_words(record.started),
        seconds=f"{record.seconds_used:.0f}",
        doubts=len(record.warnings),
        link=links.report(record),
        command=links.command(record),
        marked=marked,
    )


def _reasons(failures: Sequence[FlightFailure]) -> list[tuple[str, str, int, str]]:
    """Return why logs have no row: reason, what to do, how many, one of them."""
    groups: dict[tuple[str, str], list[FlightFailure]] = {}
    for failure in failures:
        groups.setdefault((failure.reason, failure.what_to_do), []).append(failure)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))[:MOST_REASONS]
    return [
        (reason, advice, len(these), file_name(these[0].file)) for (reason, advice), these in ranked
    ]
