"""rotorfit inspect: what is in a log, what it could tell, and what to set before the next one."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rotorfit.checks.gravity import gravity_doubts, gravity_seen
from rotorfit.checks.plausible_units import gyro_in_degrees
from rotorfit.cli.outputs import refuse_output_file
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import one_line, say, show
from rotorfit.errors import (
    EstimationError,
    ExperimentError,
    FlightError,
    LogError,
    OutputError,
    RotorfitError,
)
from rotorfit.fit.motor_timing import LAG_PRIOR
from rotorfit.flight.camera import camera_clock
from rotorfit.flight.doctor import LATEST, channel_report, lacks, motor_lateness, vibration
from rotorfit.flight.log import CHANNELS, FlightLog
from rotorfit.flight.motors import MotorResponse
from rotorfit.flight.prepare import MotorModel, PreparedFlight, prepare
from rotorfit.flight.telemetry import telemetry
from rotorfit.inspection.prospects import Prospects, prospects
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.blackbox import is_blackbox, list_blackbox_logs
from rotorfit.logs.files import read_head
from rotorfit.report.doctor import SEARCHED, WIDTH, LogReport, plain, report_text, write_page
from rotorfit.report.settings import settings_for

if TYPE_CHECKING:
    from rotorfit.experiment.experiment import FlightEntry

GUESSED_ARM = 0.15
"""Only a scale for telling flight from ground, where no airframe is given [m]."""
NEEDED = ("gyro", "accel")
HEAD_BYTES = 65_536
NARROWEST = 60
"""Of a line on a narrow terminal [characters]."""
WITH_AIRFRAME = (
    "only with --airframe FILE is it judged whether motor order, spins and arm are right, and each "
    "number gets its verdict"
)
CUTOFFS = {
    "acc_lpf_hz": ("the accelerometer's low-pass", 100.0),
    "gyro_lpf1_static_hz": ("the gyro's low-pass", 1.0),
    "gyro_lowpass_hz": ("the gyro's low-pass", 1.0),
}
"""Filters in the header of a Blackbox log, and what their number is divided by for Hz."""


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
            show(_text(report, width=_width()))
    if options.as_json and reports:
        show(json.dumps([_plain(one) for one in reports], indent=1, allow_nan=False))
    _write(options, reports)
    if failed:
        raise typer.Exit(1)


def _write(options: InspectOptions, reports: Sequence[LogReport | SeveralLogs]) -> None:
    """Write the page, where one is wanted and something is to be said."""
    single = [one for one in reports if isinstance(one, LogReport)]
    if options.report is not None and single:
        write_page(options.report, single, force=options.force)
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
            f"{path}: no [[configuration]] with flights in it: name an experiment file or a log, "
            "and an airframe file with --airframe"
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
    if number is None and path.is_file() and is_blackbox(read_head(path, HEAD_BYTES)):
        entries = list_blackbox_logs(path)
        if len(entries) > 1:
            return SeveralLogs(
                file=str(path), logs=tuple(f"{e.number}: {e.description}" for e in entries)
            )
    with steps() as tell:
        tell(f"reading {path.name}")
        log = read_log(path, options=replace(look.read, log_number=number))
    return inspect_log(log, airframe=options.airframe, entry=look.entry)


def inspect_log(
    log: FlightLog, *, airframe: Path | None = None, entry: "FlightEntry | None" = None
) -> LogReport:
    """Return what a log holds and lacks, which part of it is flight, and what that could tell."""
    channels = {
        name: channel_report(name, log.channels[name]) for name in CHANNELS if name in log.channels
    }
    trouble: list[str] = []
    prepared: PreparedFlight | None = None
    if all(name in log.channels for name in NEEDED) and not {"rotor_speed", "command"}.isdisjoint(
        log.channels
    ):
        try:
            prepared = _prepared(log)
            trouble += [*prepared.warnings, *filter(None, [gyro_in_degrees(prepared.data)])]
        except (LogError, FlightError) as error:
            trouble.append(str(error))
    trouble = [*log.warnings, *_missing(log, usable=prepared is not None), *trouble]
    late = None if prepared is None else motor_lateness(prepared.data)
    foreseen: Prospects | None = None
    if prepared is not None:
        try:
            foreseen = prospects(
                prepared,
                _response(log, late),
                commanded="rotor_speed" not in log.channels,
            )
        except (FlightError, EstimationError) as error:
            trouble.append(str(error))
    speeds = telemetry(log)
    trouble += [] if speeds is None else speeds.doubts
    verdicts, refused = _with_airframe(log, airframe, entry)
    gravity = None if prepared is None else gravity_seen(prepared.data)
    if gravity is not None:
        # With an airframe the identification has looked at the flight itself.
        trouble += gravity_doubts(replace(gravity, in_flight=None) if verdicts else gravity)
    cutoffs = _cutoffs(log)
    lacking = lacks(channels, accel_cutoff=cutoffs.get("acc_lpf_hz"))
    return LogReport(
        file=str(log.path),
        format=log.format,
        log=f"{log.log_number} of {log.logs_in_file}",
        seconds=log.seconds,
        channels=tuple(channels.values()),
        airborne=_airborne(prepared),
        vibration=() if prepared is None else vibration(prepared.data),
        motor_lateness=late,
        telemetry=speeds,
        gravity=gravity,
        prospects=foreseen,
        verdicts=verdicts,
        not_judged=(WITH_AIRFRAME,) if prepared is not None and airframe is None else (),
        filters=tuple(f"{CUTOFFS[k][0]} is at {hz:g} Hz ({k})" for k, hz in cutoffs.items()),
        trouble=tuple(dict.fromkeys([*trouble, *refused])),
        settings=settings_for(log.format, lacking, log.metadata),
        notes=log.notes,
        metadata=dict(log.metadata),
    )


def _with_airframe(
    log: FlightLog, airframe: Path | None, entry: "FlightEntry | None"
) -> tuple[tuple[str, ...], list[str]]:
    """Return the verdicts of an identification with an airframe, and why there are none."""
    if airframe is None:
        return (), []
    import warnings

    from rotorfit.experiment.experiment import single_flight_experiment
    from rotorfit.identification.identify import identify

    number = log.log_number if log.logs_in_file > 1 else None
    experiment = single_flight_experiment(
        log.path, mass="unknown", airframe=airframe, log_number=number
    )
    if entry is not None:
        [configuration] = experiment.configuration
        flown = configuration.model_copy(update={"flights": (entry,)})
        experiment = experiment.model_copy(update={"configuration": (flown,)})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = identify(experiment)
    except (LogError, FlightError) as error:
        return (), [str(error)]
    by_verdict: dict[str, list[str]] = {}
    for parameter in result.parameters:
        by_verdict.setdefault(parameter.verdict, []).append(parameter.name)
    words = tuple(
        f"with {airframe.name}: {verdict}: {', '.join(names)}"
        for verdict, names in by_verdict.items()
    )
    return words, list(result.warnings)


def _response(log: FlightLog, late: float | None) -> MotorResponse | None:
    """Return when the motors do what their data say: commands are followed with a lag."""
    if late is None:
        return None
    if "rotor_speed" in log.channels:
        return MotorResponse(delay=late)
    if -SEARCHED <= late <= 0.0:
        return None  # no motor answers before its command: an autopilot answers, nobody steers
    # No motor is so slow: the clocks are apart, and that is not to be taken for a lag.
    lag = min(max(late, 0.0), LAG_PRIOR[0] if late > LATEST else LATEST)
    return MotorResponse(lag=lag, delay=late - lag)


def _cutoffs(log: FlightLog) -> dict[str, float]:
    """Return the low-pass filters that the header of a Blackbox log names [Hz]."""
    if log.format != "blackbox":
        return {}
    found = {
        key: float(log.metadata[key]) / scale
        for key, (_, scale) in CUTOFFS.items()
        if log.metadata.get(key, "").isdecimal()
    }
    raw = "Unfiltered" in (log.channels["accel"].source if "accel" in log.channels else "")
    return {
        key: cutoff
        for key, cutoff in found.items()
        if cutoff > 0 and not (raw and key == "acc_lpf_hz")
    }


def _missing(log: FlightLog, *, usable: bool) -> list[str]:
    """Return what the log lacks for an identification, and what to do where it is usable at all."""
    if set(log.channels) and set(log.channels) <= {"position", "attitude", "velocity"}:
        return [_of_a_pose_alone(log)]
    words: list[str] = []
    for name, what in (("gyro", "rotation rates"), ("accel", "specific force")):
        if name not in log.channels:
            words.append(f"no {name} channel ({what}): nothing can be identified from this log")
    if "rotor_speed" not in log.channels:
        if "command" in log.channels:
            words.append(
                'no measured rotor speed, only commands: identify with speed = "commanded"; '
                "better, log measured rotor speed"
                if usable
                else "no measured rotor speed, only commands: log measured rotor speed"
            )
        else:
            words.append("no motor data: log ESC telemetry or motor outputs")
    return words


def _of_a_pose_alone(log: FlightLog) -> str:
    """Return what a file of motion capture lacks, and what it is good for."""
    words = "only the pose is in this file, no motors"
    try:
        camera_clock(log.channels["position"].time)
    except (FlightError, KeyError) as error:
        return f"{words}, and not as a recording beside a log: {error}"
    beside = 'name it beside the log of the autopilot (flights = [{ file = "LOG", mocap = '
    return f'{words}: {beside}"THIS FILE" }}])'


def _prepared(log: FlightLog) -> PreparedFlight:
    """Return the log prepared with whatever motors it has."""
    measured = "rotor_speed" in log.channels
    motors = log.channels["rotor_speed" if measured else "command"]
    return prepare(
        log,
        rotor_count=motors.values.shape[1],
        arm=GUESSED_ARM,
        motors=MotorModel(speed="measured" if measured else "commanded"),
    )


def _airborne(prepared: PreparedFlight | None) -> tuple[tuple[float, float], ...]:
    if prepared is None:
        return ()
    t = prepared.data.time
    return tuple(
        (float(t[s.start] - t[0]), float(t[s.stop - 1] - t[0])) for s in prepared.data.segments
    )


def _plain(report: LogReport | SeveralLogs) -> dict[str, Any]:
    return plain(report) if isinstance(report, LogReport) else asdict(report)


def _width() -> int:
    """Return how wide a line may be: as the terminal, within limits that read well."""
    columns = shutil.get_terminal_size((WIDTH, 0)).columns
    return min(max(columns, NARROWEST), WIDTH)


def _text(report: LogReport | SeveralLogs, *, width: int) -> str:
    if isinstance(report, LogReport):
        return report_text(report, width=width)
    head = f"{report.file}: {len(report.logs)} logs; look at one with --log N"
    return "\n".join([head, *(f"  {line}" for line in report.logs), ""])
