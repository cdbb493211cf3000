"""rotorfit fleet: parse, call, print."""

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from rotorfit.cli.progress import paced, steps
from rotorfit.cli.terminal import say, show
from rotorfit.errors import LogError
from rotorfit.fleet.entries import make_folder
from rotorfit.fleet.findings import Finding, findings
from rotorfit.fleet.listing import Defaults, ListedLog, listed_logs, mass_of
from rotorfit.fleet.run import (
    FAILURES,
    REPORTS,
    Fleet,
    FleetType,
    Told,
    Workers,
    claim,
    cores,
    failures_file,
    fleet_files,
    links_to,
    read_fleet,
    types_of,
)
from rotorfit.fleet.statistics import ALARM
from rotorfit.fleet.tables import has_parquet
from rotorfit.logs.files import write_all_whole

CACHE = "cache"


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetRequest:
    """What the user asked for, as the command line gave it."""

    source: Path
    output: Path
    airframe: Path | None = None
    mass: str | None = None
    vehicle_of: str | None = None
    workers: int | None = None
    scheduler: str | None = None
    time_limit: float
    force: bool = False
    as_json: bool = False


def run(request: FleetRequest) -> None:
    """Identify every log, say what the fleet says, and write it."""
    logs = listed_logs(request.source, _defaults(request), apart=request.output)
    claim(request.output, request.source, force=request.force)
    workers = Workers(
        count=min(request.workers or cores(), len(logs)),
        scheduler=request.scheduler,
        time_limit=request.time_limit,
    )
    cache = request.output / CACHE
    fleet = _identified(logs, cache, workers)
    if not fleet.records:
        _write(request.output, {FAILURES: failures_file(fleet)})
        raise LogError(
            f"none of {len(logs)} logs could be used: {request.output / FAILURES} says why of each "
            f"and what to do; the first: {fleet.failures[0].file}: {fleet.failures[0].reason}"
        )
    with steps() as tell:
        tell("comparing the flights")
        types = types_of(fleet)
        tell("fitting the flights of each vehicle together")
        name = request.source.absolute().stem
        links = links_to(request.output, request.source)
        files = fleet_files(fleet, types, cache, workers, name=name, links=links)
    make_folder(request.output / REPORTS)
    _write(request.output, files)
    if not has_parquet():
        say("tables are CSV: pip install 'rotorfit[parquet]' writes them as Parquet")
    show(
        json.dumps(_plain(fleet, types, files), indent=1)
        if request.as_json
        else _text(fleet, types, request.output)
    )


def _defaults(request: FleetRequest) -> Defaults:
    pattern = None
    if request.vehicle_of is not None:
        try:
            pattern = re.compile(request.vehicle_of)
        except re.error as error:
            raise typer.BadParameter(
                f"{request.vehicle_of!r} is no regular expression ({error})",
                param_hint="--vehicle-of",
            ) from None
    return Defaults(
        mass=None if request.mass is None else mass_of(request.mass, "--mass"),
        airframe=request.airframe,
        vehicle_of=pattern,
    )


def _identified(logs: Sequence[ListedLog], cache: Path, workers: Workers) -> Fleet:
    """Identify every log that is not kept; stopped, say how to go on."""
    last = Told(done=0, total=len(logs), fresh=0)
    try:
        with paced("identifying") as show_pace:

            def tell(told: Told) -> None:
                nonlocal last
                last = told
                show_pace(told.done, told.total)

            return read_fleet(logs, cache, workers, tell=tell)
    except KeyboardInterrupt:
        say(
            f"rotorfit: {last.done} of {last.total} logs are done and kept in {cache}; the same "
            "command goes on from there"
        )
        raise


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    write_all_whole({folder / name: content for name, content in files.items()}, force=True)
    for name in files:
        say(f"wrote {folder / name}")


def _text(fleet: Fleet, types: Sequence[FleetType], folder: Path) -> str:
    """Return what a fleet came to, in some lines."""
    identified = sum(not record.refused for record in fleet.records)
    vehicles = sum(len(one.statistics.vehicles) for one in types)
    lines = [f"{identified} flights identified, of {vehicles} vehicles", *_left_out(fleet, folder)]
    for one in types:
        found = _findings(one)
        lines += ["", *([f"Type {one.name}:"] if len(types) > 1 else [])]
        lines += [_sentence(one, finding) for finding in found]
        if not found:
            lines.append("Nothing changed, and no vehicle stands apart.")
    tests = sum(one.statistics.tests for one in types)
    chance = f"{100 * ALARM:.0f} % of fleets in which nothing changed show a change by chance"
    return "\n".join([*lines, "", f"({chance}; {tests} series of flights were looked at.)"])


def _sentence(one: FleetType, finding: Finding) -> str:
    vehicle = one.statistics.vehicles[finding.vehicle]
    return f"{vehicle}: {finding.sentence} What to do: {finding.advice}."


def _left_out(fleet: Fleet, folder: Path) -> list[str]:
    count = len(fleet.failures)
    if not count:
        return []
    trim = sum(bool(record.refused) for record in fleet.records)
    motors = f"; of {trim} the motors alone are compared" if trim else ""
    return [
        f"{count} log{'s' if count > 1 else ''} not identified{motors}: why, and what to do, is in "
        f"{folder / FAILURES}"
    ]


def _plain(
    fleet: Fleet, types: Sequence[FleetType], files: Mapping[str, bytes]
) -> dict[str, object]:
    return {
        "types": {one.name: list(one.statistics.vehicles) for one in types},
        "flights": len(fleet.records),
        "identified": sum(not record.refused for record in fleet.records),
        "failures": [dataclasses.asdict(failure) for failure in fleet.failures],
        "findings": [_plain_finding(one, finding) for one in types for finding in _findings(one)],
        "files": list(files),
    }


def _findings(one: FleetType) -> list[Finding]:
    return findings(one.statistics, one.fleet.records)


def _plain_finding(one: FleetType, finding: Finding) -> dict[str, object]:
    records = one.fleet.records
    return {
        "type": one.name,
        "vehicle": one.statistics.vehicles[finding.vehicle],
        "sort": finding.sort,
        "sentence": finding.sentence,
        "advice": finding.advice,
        "flight": None if finding.record is None else records[finding.record].file,
    }
