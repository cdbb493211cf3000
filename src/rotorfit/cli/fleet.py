"""rotorfit fleet: identify many logs of many vehicles, and compare them."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.mass import parse_mass
from rotorfit.cli.terminal import (
    AsJson,
    Force,
    paced,
    print_result,
    print_status,
    steps,
    terminal_width,
)
from rotorfit.errors import LogError

if TYPE_CHECKING:
    from rotorfit.tools.fleet.findings import VehicleFinding
    from rotorfit.tools.fleet.listing import ListedLog
    from rotorfit.tools.fleet.records import RefusedLog
    from rotorfit.tools.fleet.run import Fleet, FleetType, Progress, Workers

Source = Annotated[
    Path,
    typer.Argument(
        metavar="DIR|TABLE",
        help="A folder with logs (subfolders included); or a CSV with the columns file, vehicle, "
        "configuration, mass, airframe, log (only file is required).",
    ),
]
Output = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="DIR",
        help="Folder for tables, page and the cache of each log; a second run continues there.",
    ),
]
Airframe = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="File with [airframe] and [motors], for logs without one in the table.",
    ),
]
Mass = Annotated[
    str | None,
    typer.Option(
        metavar="KG", help="Mass of every vehicle without one in the table: kg, 428g, or 'unknown'."
    ),
]
VehicleOf = Annotated[
    str | None,
    typer.Option(
        metavar="REGEX",
        help="Finds the vehicle in the path of a log: the first group, or groups named vehicle and "
        "configuration. Default: as the log says, else its folder.",
    ),
]
WorkerCount = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Processes; default: one per core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="Work on a Dask cluster instead (tcp://HOST:PORT; extra dask)."
    ),
]
TimeLimit = Annotated[
    float,
    typer.Option(
        min=1.0,
        metavar="SECONDS",
        help="For one log; a log that takes longer is left out and listed.",
    ),
]


def fleet(
    source: Source,
    output: Output,
    airframe: Airframe = None,
    mass: Mass = None,
    vehicle_of: VehicleOf = None,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    time_limit: TimeLimit = 600.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify many logs of many vehicles, and compare them.

    Identifies each log by itself, then finds changes over time, outlier vehicles, and the mean and
    spread of the type. Writes tables of flights, vehicles and unusable logs, and a page. After an
    interruption, call it again: it continues.
    """
    from rotorfit.tools.fleet.listing import Defaults, listed_logs
    from rotorfit.tools.fleet.run import FAILURES, Workers, claim, cores, refusals_file

    defaults = Defaults(
        vehicle_of=_compile_pattern(vehicle_of),
        mass=None if mass is None else parse_mass(mass),
        airframe=airframe,
    )
    logs = listed_logs(source, defaults, excluded=output)
    claim(output, source, force=force)
    count = min(workers or cores(), len(logs))
    executor = Workers(count=count, scheduler=scheduler, time_limit=time_limit)
    cache = output / "cache"
    identified = _identify_logs(logs, cache, executor)
    if not identified.records:
        _write_files(output, {FAILURES: refusals_file(identified)})
        raise LogError(
            f"none of {len(logs)} logs could be used: {output / FAILURES} says why of each "
            "and what to do; the first: "
            f"{identified.refused[0].file}: {identified.refused[0].refusal.sentence}"
        )
    _compare_and_write(identified, source, output, cache, executor, as_json=as_json)


def _compile_pattern(pattern: str | None) -> re.Pattern[str] | None:
    try:
        return None if pattern is None else re.compile(pattern)
    except re.error as error:
        raise typer.BadParameter(
            f"{pattern!r} is no regular expression ({error})",
            param_hint="--vehicle-of",
        ) from None


def _identify_logs(logs: Sequence[ListedLog], cache: Path, workers: Workers) -> Fleet:
    """Identify every log that is not in the cache; stopped, print how to go on."""
    from rotorfit.tools.fleet.run import Progress, read_fleet

    last = Progress(done=0, total=len(logs), fresh=0)
    try:
        with paced("identifying") as report_progress:

            def report(state: Progress) -> None:
                nonlocal last
                last = state
                report_progress(state.done, state.total)

            return read_fleet(logs, cache, workers, progress=report)
    except KeyboardInterrupt:
        print_status(
            f"rotorfit: {last.done} of {last.total} logs are done and kept in {cache}; the same "
            "command goes on from there"
        )
        raise


def _compare_and_write(
    fleet: Fleet, source: Path, output: Path, cache: Path, workers: Workers, *, as_json: bool
) -> None:
    from rotorfit.report.fleet_files import REPORTS, fleet_files, links_to
    from rotorfit.tools.fleet.records import make_folder
    from rotorfit.tools.fleet.run import types_of
    from rotorfit.tools.fleet.tables import has_parquet

    with steps() as report_progress:
        report_progress("comparing the flights")
        types = types_of(fleet)
        report_progress("fitting the flights of each vehicle together")
        name, links = source.absolute().stem, links_to(output, source)
        files = fleet_files(fleet, types, cache, workers, name=name, links=links)
    make_folder(output / REPORTS)
    _write_files(output, files)
    if not has_parquet():
        print_status("tables are CSV: pip install 'rotorfit[parquet]' writes them as Parquet")
    print_result(
        json.dumps(_plain_fleet(fleet, types, files), indent=1)
        if as_json
        else _fleet_text(fleet, types, output)
    )


def _write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    from rotorfit.logs.files import write_all_whole

    write_all_whole({folder / name: content for name, content in files.items()}, force=True)
    for name in files:
        print_status(f"wrote {folder / name}")


def _fleet_text(fleet: Fleet, types: Sequence[FleetType], folder: Path) -> str:
    from rotorfit.tools.fleet.findings import nothing_found
    from rotorfit.tools.fleet.statistics import ALARM

    vehicles = sum(len(one.statistics.vehicles) for one in types)
    flights = _count_words(_identified_count(fleet), "flight")
    lines = [f"{flights} identified, of {_count_words(vehicles, 'vehicle')}"]
    lines += _failures_line(fleet, folder)
    for one in types:
        found = [
            f"{one.statistics.vehicles[f.vehicle]}: {f.sentence} What to do: {f.next_step}."
            for f in _fleet_findings(one)
        ]
        lines += ["", *([f"Type {one.name}:"] if len(types) > 1 else [])]
        for words in found or [nothing_found(one.statistics)]:
            lines += textwrap.wrap(words, terminal_width(), break_on_hyphens=False)
    tests = sum(one.statistics.tests for one in types)
    if tests:
        chance = (
            f"(False alarms: {100 * ALARM:.0f} of 100 fleets without any change show one; {tests} "
            "series of flights were searched.)"
        )
        lines += ["", *textwrap.wrap(chance, terminal_width())]
    return "\n".join(lines)


def _count_words(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _identified_count(fleet: Fleet) -> int:
    return sum(not record.refused for record in fleet.records)


def _failures_line(fleet: Fleet, folder: Path) -> list[str]:
    from rotorfit.tools.fleet.run import FAILURES

    count = len(fleet.refused)
    if not count:
        return []
    trim = sum(bool(record.refused) for record in fleet.records)
    motors = f"; of {trim} the motors alone are compared" if trim else ""
    return [
        f"{count} log{'s' if count > 1 else ''} not identified{motors}: why, and what to do, is in "
        f"{folder / FAILURES}"
    ]


def _plain_fleet(
    fleet: Fleet, types: Sequence[FleetType], files: Mapping[str, bytes]
) -> dict[str, object]:
    return {
        "types": {one.name: list(one.statistics.vehicles) for one in types},
        "flights": len(fleet.records),
        "identified": _identified_count(fleet),
        "failures": [_plain_refusal(log) for log in fleet.refused],
        "findings": [
            _plain_finding(one, finding) for one in types for finding in _fleet_findings(one)
        ],
        "files": list(files),
    }


def _fleet_findings(one: FleetType) -> list[VehicleFinding]:
    from rotorfit.tools.fleet.findings import findings

    return findings(one.statistics, one.fleet.records)


def _plain_refusal(log: RefusedLog) -> dict[str, object]:
    return {
        "file": log.file,
        "log_number": log.log_number,
        "vehicle": "",
        "reason": log.refusal.sentence,
        "what_to_do": log.refusal.next_step,
    }


def _plain_finding(one: FleetType, finding: VehicleFinding) -> dict[str, object]:
    records = one.fleet.records
    return {
        "type": one.name,
        "vehicle": one.statistics.vehicles[finding.vehicle],
        "sort": finding.kind,
        "sentence": finding.sentence,
        "advice": finding.next_step,
        "flight": None if finding.record is None else records[finding.record].file,
    }
