"""rotorfit inspect: what this log can show, and which settings to change before the next flight."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rotorfit.cli.outputs import refuse_output_file
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import one_line, painted, say, show, terminal_width
from rotorfit.errors import (
    ExperimentError,
    OutputError,
    RotorfitError,
)
from rotorfit.inspection.inspect_log import LogReport, inspect_log
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.read import logs_in_file, own_kind
from rotorfit.report.log_page import write_log_page
from rotorfit.report.log_report import plain, report_text

if TYPE_CHECKING:
    from rotorfit.experiment.experiment import FlightEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class SeveralLogs:
    """A file that holds several logs, of which one must be chosen."""

    file: str
    logs: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectOptions:
    """What the user asks of inspect besides the logs."""

    log_number: int | None = None
    airframe: Path | None = None
    as_json: bool = False
    report: Path | None = None
    force: bool = False


def run(paths: list[Path], options: InspectOptions) -> None:
    """Report every log; exit with 1 if one cannot be read or has no usable sample."""
    if options.report is not None:
        try:
            refuse_output_file(options.report, inputs=paths, force=options.force)
        except OutputError as error:
            say(f"rotorfit: {one_line(str(error))}")
            raise typer.Exit(1) from error
    failed = False
    reports: list[LogReport | SeveralLogs] = []
    looks, refused = _looks(paths)
    for refusal in refused:
        failed = True
        say(f"rotorfit: {one_line(refusal)}")
    for look in looks:
        path = look.path
        try:
            report = _report(look, options)
        except RotorfitError as error:
            failed = True
            say(f"rotorfit: {one_line(str(error))}")
            continue
        if isinstance(report, LogReport) and not report.usable:
            failed = True
            say(f"rotorfit: {path}: no usable sample in it: copy the log again")
        reports.append(report)
        if not options.as_json:
            show(painted(_text(report, width=terminal_width())))
    if options.as_json and reports:
        show(json.dumps([_plain(one) for one in reports], indent=1, allow_nan=False))
    _write(options, reports)
    if failed:
        raise typer.Exit(1)


def _write(options: InspectOptions, reports: Sequence[LogReport | SeveralLogs]) -> None:
    """Write the page, where one is wanted and something is to be said."""
    single = [one for one in reports if isinstance(one, LogReport)]
    if options.report is not None and single:
        write_log_page(options.report, single, force=options.force)
        say(f"rotorfit: wrote {options.report}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """A log to look at; what an experiment file says of it, where one names it."""

    path: Path
    read: ReadOptions = field(default_factory=ReadOptions)
    entry: "FlightEntry | None" = None


def _looks(paths: list[Path]) -> tuple[list[Look], list[str]]:
    """Return the logs to look at, those of experiment files among them, and what is refused."""
    looks: list[Look] = []
    refused: list[str] = []
    for path in paths:
        if path.suffix.lower() != ".toml":
            looks.append(Look(path=path))
            continue
        try:
            looks += _of_experiment(path)
        except RotorfitError as error:
            refused.append(str(error))
    return looks, refused


def _of_experiment(path: Path) -> list[Look]:
    from rotorfit.experiment.experiment import load_experiment
    from rotorfit.experiment.read_options import read_options_of
    from rotorfit.experiment.toml_files import read_toml

    if path.is_file() and "configuration" not in read_toml(path):
        raise ExperimentError(
            f"{path}: this is {own_kind(path) or 'a TOML file'}, without [[configuration]] and "
            "flights: give a log, and an airframe file with --airframe"
        )
    experiment = load_experiment(path)
    return [
        Look(
            path=Path(entry.file),
            read=read_options_of(entry, experiment.motors),
            entry=entry,
        )
        for configuration in experiment.configuration
        for entry in (*configuration.flights, *configuration.validation)
    ]


def _report(look: Look, options: InspectOptions) -> LogReport | SeveralLogs:
    path, number = look.path, look.read.log_number or options.log_number
    entries = logs_in_file(path) if number is None else ()
    if len(entries) > 1:
        return SeveralLogs(
            file=str(path), logs=tuple(f"{e.number}: {e.description}" for e in entries)
        )
    with steps() as tell:
        tell(f"reading {path.name}")
        log = read_log(path, options=replace(look.read, log_number=number))
    return inspect_log(log, airframe=options.airframe, entry=look.entry)


def _plain(report: LogReport | SeveralLogs) -> dict[str, Any]:
    return plain(report) if isinstance(report, LogReport) else asdict(report)


def _text(report: LogReport | SeveralLogs, *, width: int) -> str:
    if isinstance(report, LogReport):
        return report_text(report, width=width)
    head = f"{report.file}: {len(report.logs)} logs; look at one with --log N"
    return "\n".join([head, *(f"  {line}" for line in report.logs), ""])
