"""Everything that one log can show: channels, airborne part, motors, gravity, prospects."""

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path

from rotorfit.dataset.checks.gravity import GravitySeen, gravity_doubts, gravity_seen
from rotorfit.dataset.checks.plausible_units import gyro_in_degrees
from rotorfit.errors import EstimationError, FlightError, LogError
from rotorfit.experiment.experiment import FlightEntry, single_flight_experiment
from rotorfit.identification.identify import identify
from rotorfit.inspection.frequency_sweep import Sweep, frequency_sweeps
from rotorfit.inspection.motor_lateness import LATEST, SEARCHED, motor_lateness
from rotorfit.inspection.pictures import LogPictures, log_pictures
from rotorfit.inspection.prospects import Prospects, prospects
from rotorfit.inspection.recording import (
    ChannelReport,
    Vibration,
    channel_report,
    lacks,
    vibration,
)
from rotorfit.inspection.settings import settings_for
from rotorfit.logs.firmware import Filter, Setting
from rotorfit.logs.flight_log import CHANNELS, FlightLog
from rotorfit.logs.formats import BY_NAME
from rotorfit.preprocessing.mocap.camera import camera_clock
from rotorfit.preprocessing.motors.motor_model import MotorModel, MotorResponse
from rotorfit.preprocessing.motors.rotor_telemetry import Telemetry, telemetry
from rotorfit.preprocessing.prepare import PreparedFlight, prepare
from rotorfit.reduction.motor_timing import LAG_PRIOR

GUESSED_ARM = 0.15
"""Only a scale for telling flight from ground, where no airframe is given [m]."""
NEEDED = ("gyro", "accel")
WITH_AIRFRAME = (
    "give --airframe FILE to check motor order, spins and arm, and to get a verdict for each number"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogReport:
    """What inspect says of one log; seconds are since its first sample."""

    file: str
    format: str
    log: str
    seconds: float
    channels: tuple[ChannelReport, ...]
    airborne: tuple[tuple[float, float], ...] = ()
    vibration: tuple[Vibration, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    motor_lateness: float | None = None
    telemetry: Telemetry | None = None
    gravity: GravitySeen | None = None
    prospects: Prospects | None = None
    verdicts: tuple[str, ...] = ()
    not_judged: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()
    trouble: tuple[str, ...] = ()
    settings: tuple[Setting, ...] = ()
    notes: tuple[str, ...] = ()
    metadata: dict[str, str] = field(default_factory=dict[str, str])
    pictures: LogPictures | None = None

    @property
    def usable(self) -> bool:
        """Whether any channel has samples left."""
        return any(channel.samples > 1 for channel in self.channels)


def inspect_log(
    log: FlightLog, *, airframe: Path | None = None, entry: FlightEntry | None = None
) -> LogReport:
    """Return what a log holds and lacks, which part of it is flight, and what that can show."""
    channels = {
        name: channel_report(name, log.channels[name]) for name in CHANNELS if name in log.channels
    }
    prepared, trouble = _flight(log)
    trouble = [*log.warnings, *_missing(log, usable=prepared is not None), *trouble]
    late = None if prepared is None else motor_lateness(prepared.data)
    foreseen, unforeseen = _foreseen(log, prepared, late)
    trouble += unforeseen
    speeds = telemetry(log)
    trouble += [] if speeds is None else speeds.doubts
    verdicts, refused = _with_airframe(log, airframe, entry)
    gravity = None if prepared is None else gravity_seen(prepared.data)
    if gravity is not None:
        # With an airframe the identification has looked at the flight itself.
        trouble += gravity_doubts(replace(gravity, in_flight=None) if verdicts else gravity)
    pictures = log_pictures(log, prepared, channels)
    filters = _low_passes(log, pictures)
    accel = [f.low for f in filters if f.channel == "accel"]
    lacking = lacks(channels, accel_cutoff=min(accel, default=None))
    return LogReport(
        file=str(log.path),
        format=log.format,
        log=f"{log.log_number} of {log.logs_in_file}",
        seconds=log.seconds,
        channels=tuple(channels.values()),
        airborne=_airborne(prepared),
        vibration=() if prepared is None else vibration(prepared.data),
        sweeps=_sweeps(prepared),
        motor_lateness=late,
        telemetry=speeds,
        gravity=gravity,
        prospects=foreseen,
        verdicts=verdicts,
        not_judged=(WITH_AIRFRAME,) if prepared is not None and airframe is None else (),
        filters=tuple(f.words for f in filters),
        trouble=tuple(dict.fromkeys([*trouble, *refused])),
        settings=settings_for(log.format, lacking, log.metadata),
        notes=log.notes,
        metadata=dict(log.metadata),
        pictures=pictures,
    )


def _flight(log: FlightLog) -> tuple[PreparedFlight | None, list[str]]:
    """Return the flight in a log that can be prepared, and what troubles it."""
    motors = {"rotor_speed", "command"} & log.channels.keys()
    if not motors or not all(name in log.channels for name in NEEDED):
        return None, []
    try:
        prepared = _prepared(log)
        degrees = gyro_in_degrees(prepared.data, takes_columns=log.takes_columns)
    except (LogError, FlightError) as error:
        return None, [str(error)]
    return prepared, [*prepared.warnings, *filter(None, [degrees])]


def _foreseen(
    log: FlightLog, prepared: PreparedFlight | None, late: float | None
) -> tuple[Prospects | None, list[str]]:
    """Return what a flight can show, and why that cannot be said."""
    if prepared is None:
        return None, []
    commanded = "rotor_speed" not in log.channels
    try:
        return prospects(prepared, _response(log, late), commanded=commanded), []
    except (FlightError, EstimationError) as error:
        return None, [str(error)]


def _with_airframe(
    log: FlightLog, airframe: Path | None, entry: FlightEntry | None
) -> tuple[tuple[str, ...], list[str]]:
    """Return the verdicts of an identification with an airframe, and why there are none."""
    if airframe is None:
        return (), []

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


def _low_passes(log: FlightLog, pictures: LogPictures) -> list[Filter]:
    """Select the low-passes that the samples went through, where the reader's notes do not."""
    form = BY_NAME.get(log.format)
    if form is not None and form.notes_filters:
        return []
    return [f for f in pictures.filters if f.kind == "low-pass" and f.passed]


def _missing(log: FlightLog, *, usable: bool) -> list[str]:
    """Return what the log lacks for an identification, and what to do where it is usable at all."""
    if set(log.channels) and set(log.channels) <= {"position", "attitude", "velocity"}:
        return [_of_a_pose_alone(log)]
    posed = {"position", "attitude"} <= log.channels.keys()
    loss = (
        'identify with source = "mocap" if position and attitude are those of motion capture'
        if posed and {"rotor_speed", "command"} & log.channels.keys()
        else "nothing can be identified from this log"
    )
    words = [
        f"no {name} channel ({what}): {loss}"
        for name, what in (("gyro", "rotation rates"), ("accel", "specific force"))
        if name not in log.channels
    ]
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
    words = "this file has only the pose, no motors"
    try:
        camera_clock(log.channels["position"].time)
    except (FlightError, KeyError) as error:
        return f"{words}; it cannot be used as a recording beside a log either: {error}"
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
        motors=MotorModel(speed="measured") if measured else _commanded(log),
    )


def _commanded(log: FlightLog) -> MotorModel:
    """Return commanded motors, by the law that the log's own parameters tell."""
    if log.motors is None:
        return MotorModel(speed="commanded")
    return MotorModel(speed="commanded", law=log.motors.law, lag_on=log.motors.lag_on)


def _airborne(prepared: PreparedFlight | None) -> tuple[tuple[float, float], ...]:
    if prepared is None:
        return ()
    t = prepared.data.time
    return tuple(
        (float(t[s.start] - t[0]), float(t[s.stop - 1] - t[0])) for s in prepared.data.segments
    )


def _sweeps(prepared: PreparedFlight | None) -> tuple[Sweep, ...]:
    """Return the frequency sweeps in flight, in seconds since the first sample."""
    if prepared is None:
        return ()
    data = prepared.data
    time = data.time - data.time[0]
    return tuple(
        sweep
        for s in data.segments
        for sweep in frequency_sweeps(
            time[s.start : s.stop], data.angular_velocity[s.start : s.stop]
        )
    )
