"""rotorfit inspect: what this log can show, and which settings to change before the next flight."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Force,
    LogNumber,
    coloured,
    load_modules,
    print_refusal,
    print_result,
    print_status,
    refuse_output_file,
    steps,
    terminal_width,
)
from rotorfit.errors import ExperimentError, RotorfitError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.logs import ReadOptions
    from rotorfit.tools.inspection.inspect_log import LogReport


@frozen_dataclass
class SeveralLogs:
    """A file that holds several logs, of which one must be chosen."""

    file: str
    logs: tuple[str, ...]


@frozen_dataclass
class InspectedLog:
    """A log to inspect, and its entry where an experiment file names it."""

    path: Path
    read: ReadOptions
    entry: FlightEntry | None = None


def inspect(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG",
            help="Flight logs of any format, a folder of them, or experiment files (.toml) that "
            "map their columns; an airframe file among logs is taken as --airframe.",
        ),
    ],
    log: LogNumber = None,
    airframe: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File with [airframe] and [motors]: identify quickly, per kilogram.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page here (HTML).")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Check what a log can show, and which settings to change.

    Prints its channels, the part in the air, what an identification will find, and the autopilot
    settings to change before the next flight.
    """
    if report is not None:
        refuse_output_file(report, inputs=logs, force=force)
    paths, airframe = _logs_and_airframe(logs, airframe)
    inspected, refusals = _list_logs(paths)
    for refusal in refusals:
        print_refusal(refusal)
    failed = bool(refusals)
    printed: set[str] = set()
    reports: list[LogReport | SeveralLogs] = []
    for one in inspected:
        try:
            found = _inspect_one(one, log, airframe)
        except RotorfitError as error:
            failed = True
            if str(error) not in printed:  # a file of all logs that is missing
                print_refusal(error)
            printed.add(str(error))
            continue
        if not isinstance(found, SeveralLogs) and not found.usable:
            failed = True
            print_status(f"rotorfit: {one.path}: no usable sample in it: copy the log again")
        reports.append(found)
        if not as_json:
            print_result(coloured(_report_text_of(found)))
    if as_json and reports:
        print_result(json.dumps([_plain_report(one) for one in reports], indent=1, allow_nan=False))
    single = [one for one in reports if not isinstance(one, SeveralLogs)]
    if report is not None and single:
        from rotorfit.report.log_page import write_log_page

        write_log_page(report, single, force=force)
        print_status(f"rotorfit: wrote {report}")
    if failed:
        raise typer.Exit(1)


def _logs_and_airframe(paths: list[Path], airframe: Path | None) -> tuple[list[Path], Path | None]:
    """Take an airframe file among logs as that of --airframe."""
    from rotorfit.logs.read import AIRFRAME_FILE, own_kind

    if airframe is not None:
        return paths, airframe
    found = [p for p in paths if p.suffix.lower() == ".toml" and own_kind(p) == AIRFRAME_FILE]
    if len(found) != 1 or len(paths) == 1:
        return paths, None
    return [path for path in paths if path != found[0]], found[0]


def _list_logs(paths: list[Path]) -> tuple[list[InspectedLog], list[RotorfitError]]:
    """List the logs to inspect, those of experiment files among them, and the refusals."""
    from rotorfit.logs import ReadOptions

    inspected: list[InspectedLog] = []
    refusals: list[RotorfitError] = []
    for path in (log for given in paths for log in _logs_in(given)):
        if path.suffix.lower() != ".toml":
            inspected.append(InspectedLog(path=path, read=ReadOptions()))
            continue
        try:
            inspected += logs_of_experiment(path)
        except RotorfitError as error:
            refusals.append(error)
    return inspected, refusals


def _logs_in(path: Path) -> list[Path]:
    """List the logs of a folder that is no recording itself; a file stays what it is."""
    from rotorfit.logs.read import format_of

    if not path.is_dir() or format_of(path) is not None:
        return [path]
    found = [(p, format_of(p)) for p in sorted(path.iterdir()) if not p.name.startswith(".")]
    # Nearly any text may be a table: by its name alone it is a log.
    logs = [p for p, f in found if f and (f.certain or p.suffix.lower() in f.suffixes)]
    # A folder without a log stays, to be refused by its name.
    return logs or [path]


def logs_of_experiment(path: Path) -> list[InspectedLog]:
    """List the logs of an experiment file, with the columns that it maps."""
    from rotorfit.fit.experiment.declared_vehicle import read_options_of
    from rotorfit.fit.experiment.experiment import load_experiment
    from rotorfit.fit.experiment.toml_files import read_toml
    from rotorfit.logs.read import own_kind

    if path.is_file() and "configuration" not in read_toml(path):
        raise ExperimentError(
            f"{path}: this is {own_kind(path) or 'a TOML file'}, without [[configuration]] and "
            "flights: give a log, and an airframe file with --airframe"
        )
    experiment = load_experiment(path)
    return [
        InspectedLog(
            path=Path(entry.file), read=read_options_of(entry, experiment.motors), entry=entry
        )
        for configuration in experiment.configuration
        for entry in (*configuration.flights, *configuration.validation)
    ]


def _inspect_one(
    one: InspectedLog, log_number: int | None, airframe: Path | None
) -> LogReport | SeveralLogs:
    """Inspect a log, or list the logs in its file where one must be chosen."""
    from rotorfit.logs.files import read_head

    path, number = one.path, one.read.log_number or log_number
    if not path.is_dir():
        read_head(path, 1)  # a missing log is reported before heavy imports
    load_modules("rotorfit.tools.inspection.inspect_log")
    from rotorfit.logs import read_log
    from rotorfit.logs.read import logs_in_file
    from rotorfit.tools.inspection.inspect_log import inspect_log

    entries = logs_in_file(path) if number is None else ()
    if len(entries) > 1:
        return SeveralLogs(
            file=str(path), logs=tuple(f"{e.number}: {e.description}" for e in entries)
        )
    options = one.read
    if airframe is not None and one.entry is None:
        from rotorfit.fit.experiment.declared_vehicle import read_options_of
        from rotorfit.fit.experiment.experiment import single_flight_experiment

        declared = single_flight_experiment(path, mass="unknown", airframe=airframe)
        options = read_options_of(declared.configuration[0].flights[0], declared.motors)
    with steps() as report_progress:
        report_progress(f"reading {path.name}")
        log = read_log(path, options=replace(options, log_number=number))
        report_progress(f"looking at {path.name}")
        return inspect_log(log, airframe=airframe, entry=one.entry)


def _plain_report(report: LogReport | SeveralLogs) -> dict[str, Any]:
    from rotorfit.report.log_report import plain

    return asdict(report) if isinstance(report, SeveralLogs) else plain(report)


def _report_text_of(report: LogReport | SeveralLogs) -> str:
    from rotorfit.report.log_report import report_text

    if not isinstance(report, SeveralLogs):
        return report_text(report, width=terminal_width())
    first = report.logs[0].partition(":")[0]
    head = f"{report.file}: {len(report.logs)} logs, the longest first; to look at one, such as"
    command = f"  rotorfit inspect {shlex.quote(report.file)} --log {first}"
    return "\n".join([head, command, *(f"  {line}" for line in report.logs), ""])
