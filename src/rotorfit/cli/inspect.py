"""rotorfit inspect: what is in a log, and what it lacks."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from rotorfit.cli.terminal import one_line, say, show
from rotorfit.errors import FlightError, LogError, RotorfitError
from rotorfit.flight.log import CHANNELS, Channel, FlightLog
from rotorfit.flight.prepare import MotorModel, PreparedFlight, prepare
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.blackbox import is_blackbox, list_blackbox_logs
from rotorfit.logs.files import read_head

GAP_STEPS = 2.5
GUESSED_ARM = 0.15
"""Only a scale for telling flight from ground, where no airframe is given [m]."""
NEEDED = ("gyro", "accel")
HEAD_BYTES = 65_536
MOST_SPANS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReport:
    """One channel of a log, measured."""

    name: str
    columns: int
    unit: str
    samples: int
    missing: int
    rate: float
    gaps: int
    longest_gap: float
    resolution: float | None
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LogReport:
    """What inspect says of one log."""

    file: str
    format: str
    log: str
    seconds: float
    channels: tuple[ChannelReport, ...]
    airborne: tuple[tuple[float, float], ...]
    trouble: tuple[str, ...]
    notes: tuple[str, ...]
    metadata: dict[str, str]

    @property
    def usable(self) -> bool:
        """Whether any channel has samples left."""
        return any(channel.samples > 1 for channel in self.channels)


def run(paths: list[Path], *, log_number: int | None, as_json: bool) -> None:
    """Report every log; exit with 1 if one cannot be read or has no usable sample."""
    failed = False
    reports: list[dict[str, Any]] = []
    for path in paths:
        try:
            report = _report(path, log_number)
        except RotorfitError as error:
            failed = True
            say(f"rotorfit: {one_line(str(error))}")
            continue
        if isinstance(report, LogReport) and not report.usable:
            failed = True
            say(f"rotorfit: {path}: no usable sample in it: copy the log again")
        reports.append(_plain(report))
        if not as_json:
            show(_text(report))
    if as_json and reports:
        show(json.dumps(reports, indent=1, allow_nan=False))
    if failed:
        raise typer.Exit(1)


def _report(path: Path, log_number: int | None) -> "LogReport | SeveralLogs":
    if log_number is None and path.is_file() and is_blackbox(read_head(path, HEAD_BYTES)):
        entries = list_blackbox_logs(path)
        if len(entries) > 1:
            return SeveralLogs(
                file=str(path), logs=tuple(f"{e.number}: {e.description}" for e in entries)
            )
    return inspect_log(read_log(path, options=ReadOptions(log_number=log_number)))


@dataclass(frozen=True, slots=True, kw_only=True)
class SeveralLogs:
    """A file that holds several logs, of which one must be chosen."""

    file: str
    logs: tuple[str, ...]


def inspect_log(log: FlightLog) -> LogReport:
    """Return what a log holds and lacks, and which part of it is flight."""
    airborne: tuple[tuple[float, float], ...] = ()
    trouble = [*log.warnings, *_missing(log)]
    if not trouble or all(name in log.channels for name in NEEDED):
        try:
            prepared = _prepared(log)
            airborne = _airborne(prepared)
            trouble += prepared.warnings
        except (LogError, FlightError) as error:
            trouble += [str(error)] if str(error) not in trouble else []
    return LogReport(
        file=str(log.path),
        format=log.format,
        log=f"{log.log_number} of {log.logs_in_file}",
        seconds=log.seconds,
        channels=tuple(
            _channel_report(name, log.channels[name]) for name in CHANNELS if name in log.channels
        ),
        airborne=airborne,
        trouble=tuple(dict.fromkeys(trouble)),
        notes=log.notes,
        metadata=dict(log.metadata),
    )


def _missing(log: FlightLog) -> list[str]:
    """Return what the log lacks for an identification."""
    words: list[str] = []
    for name, what in (("gyro", "rotation rates"), ("accel", "specific force")):
        if name not in log.channels:
            words.append(f"no {name} channel ({what}): nothing can be identified from this log")
    if "rotor_speed" not in log.channels:
        if "command" in log.channels:
            words.append(
                'no measured rotor speed, only commands: identify with speed = "commanded"; '
                "better, log ESC telemetry (bidirectional DShot)"
            )
        else:
            words.append("no motor data: log ESC telemetry or motor outputs")
    return words


def _prepared(log: FlightLog) -> PreparedFlight:
    """Return the log prepared with whatever motors it has."""
    measured = "rotor_speed" in log.channels
    motors = log.channels.get("rotor_speed" if measured else "command")
    return prepare(
        log,
        rotor_count=4 if motors is None else motors.values.shape[1],
        arm=GUESSED_ARM,
        motors=MotorModel(speed="measured" if measured else "commanded"),
    )


def _airborne(prepared: PreparedFlight) -> tuple[tuple[float, float], ...]:
    t = prepared.data.time
    return tuple(
        (float(t[s.start] - t[0]), float(t[s.stop - 1] - t[0])) for s in prepared.data.segments
    )


def _channel_report(name: str, channel: Channel) -> ChannelReport:
    finite = np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time)
    t = channel.time[finite]
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else 0.0
    gaps = steps[steps > GAP_STEPS * step] if step > 0 else steps[:0]
    return ChannelReport(
        name=name,
        columns=channel.values.shape[1],
        unit=CHANNELS[name][1],
        samples=int(finite.sum()),
        missing=int((~finite).sum()),
        rate=1.0 / step if step > 0 else 0.0,
        gaps=len(gaps),
        longest_gap=float(gaps.max()) if len(gaps) else 0.0,
        resolution=channel.resolution,
        source=channel.source,
    )


def _plain(report: "LogReport | SeveralLogs") -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(report)


def _text(report: "LogReport | SeveralLogs") -> str:
    if isinstance(report, SeveralLogs):
        head = f"{report.file}: {len(report.logs)} logs; look at one with --log N"
        return "\n".join([head, *(f"  {line}" for line in report.logs), ""])
    lines = [f"{report.file}: {report.format}, log {report.log}, {report.seconds:.1f} s", ""]
    lines.append(
        f"  {'channel':<12}{'columns':>8}{'samples':>9}{'rate':>10}{'gaps':>6}  {'unit':<6} source"
    )
    lines += [_channel_line(channel) for channel in report.channels]
    lines += ["", f"  airborne: {_spans(report.airborne)}"]
    facts = [name for name in ("Craft name", "Firmware revision") if name in report.metadata]
    lines += [f"  {name}: {report.metadata[name]}" for name in facts]
    lines += [f"  {note}" for note in report.notes]
    if report.trouble:
        lines += ["", "  To know", *(line for text in report.trouble for line in _wrapped(text))]
    return "\n".join([*lines, ""])


def _wrapped(text: str) -> list[str]:
    import textwrap

    return textwrap.wrap(text, 100, initial_indent="  - ", subsequent_indent="    ")


def _channel_line(c: ChannelReport) -> str:
    gaps = f"{c.gaps}" if c.gaps else "-"
    return (
        f"  {c.name:<12}{c.columns:>8}{c.samples:>9}{c.rate:>7.0f} Hz{gaps:>6}  {c.unit:<6} "
        f"{c.source}"
    )


def _spans(spans: tuple[tuple[float, float], ...]) -> str:
    if not spans:
        return "nothing found"
    total = sum(end - start for start, end in spans)
    if len(spans) > MOST_SPANS:
        first, last = spans[0][0], spans[-1][1]
        return f"{len(spans)} stretches between {first:.2f} and {last:.2f} s ({total:.1f} s)"
    parts = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in spans)
    return f"{parts} ({total:.1f} s)"
