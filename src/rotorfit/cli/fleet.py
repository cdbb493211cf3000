"""rotorfit fleet: parse, call, print."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from rotorfit.cli.progress import paced, steps
from rotorfit.cli.terminal import say, show
from rotorfit.errors import LogError
from rotorfit.fleet.findings import VehicleFinding, findings
from rotorfit.fleet.listing import Defaults, ListedLog, listed_logs, mass_of
from rotorfit.fleet.records import RefusedLog, make_folder
from rotorfit.fleet.run import (
    FAILURES,
    REPORTS,
    Fleet,
    FleetType,
    Progress,
    Workers,
    claim,
    cores,
    fleet_files,
    links_to,
    read_fleet,
    refusals_file,
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
    logs = listed_logs(request.source, _defaults(request), excluded=request.output)
    claim(request.output, request.source, force=request.force)
    workers = Workers(
        count=min(cores() if request.workers is None else request.workers, len(logs)),
        scheduler=request.scheduler,
        time_limit=request.time_limit,
    )
    cache = request.output / CACHE
    fleet = _identified(logs, cache, workers)
    if not fleet.records:
        _write(request.output, {FAILURES: refusals_file(fleet)})
        first = fleet.refused[0]
        raise LogError(
            f"none of {len(logs)} logs could be used: {request.output / FAILURES} says why of each "
            f"and what to do; the first: {first.file}: {first.refusal.sentence}"
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
    last = Progress(done=0, total=len(logs), fresh=0)
    try:
        with paced("identifying") as show_pace:

            def show_progress(progress: Progress) -> None:
                nonlocal last
                last = progress
                show_pace(progress.done, progress.total)

            return read_fleet(logs, cache, workers, progress=show_progress)
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


def _sentence(one: FleetType, finding: VehicleFinding) -> str:
    vehicle = one.statistics.vehicles[finding.vehicle]
    return f"{vehicle}: {finding.sentence} What to do: {finding.next_step}."


def _left_out(fleet: Fleet, folder: Path) -> list[str]:
    count = len(fleet.refused)
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
        "failures": [_plain_refusal(log) for log in fleet.refused],
        "findings": [_plain_finding(one, finding) for one in types for finding in _findings(one)],
        "files": list(files),
    }


def _findings(one: FleetType) -> list[VehicleFinding]:
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
