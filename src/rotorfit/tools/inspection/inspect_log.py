"""Everything that one log can show: channels, airborne part, motors, gravity, prospects.

What the doctor objects to is a list of findings, each by one of `CHECKS`.
"""

from __future__ import annotations

import warnings
from dataclasses import field, replace
from typing import TYPE_CHECKING, Final

from rotorfit.checks.left_out_hovers import contradicting_hovers
from rotorfit.checks.sensors.log_settings import better_log
from rotorfit.errors import EstimationError, FlightError, LogError
from rotorfit.findings import Evidence, Finding, doubt, note, sentences
from rotorfit.fit.dataset.plausible_units import (
    GravitySeen,
    gravity_doubts,
    gravity_seen,
    gyro_in_degrees,
)
from rotorfit.flight.mocap.camera import camera_clock
from rotorfit.flight.motors.rotor_telemetry import Telemetry, telemetry
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.firmware import NO_BATTERY, NO_SPEED, SENSORS, Lack, Setting, filters_on_board
from rotorfit.logs.flight_log import other_columns
from rotorfit.tools.inspection.advised_settings import (
    channel_reports,
    lacks_of,
    log_as_argument,
    logged_low_passes,
)
from rotorfit.tools.inspection.flown_part import (
    NEEDED,
    expected_response,
    is_posed,
    name_in_usual_order,
    prepare_if_usable,
)
from rotorfit.tools.inspection.motor_lateness import motor_lateness
from rotorfit.tools.inspection.pictures import LogPictures, log_pictures
from rotorfit.tools.inspection.prospects import Prospects, foreseen_step, prospects
from rotorfit.tools.inspection.recording import ChannelReport, Vibration, settings_for, vibration
from rotorfit.tools.inspection.spectra import Sweep, frequency_sweeps
from rotorfit.tools.planning.advised_step import NextStep

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.results.result import IdentificationResult

WITH_AIRFRAME: Final = (
    "motor order, spins and arm are checked, and each number gets a verdict, once the vehicle is "
    "described: rotorfit airframe {log}"
)
BY_POSE: Final = (
    "if the poses are those of motion capture, describe the vehicle, and identify by them "
    "(--source mocap): rotorfit airframe {log}"
)
READER_NOTE: Final = "reader-note"
NO_AIRFRAME: Final = "no-airframe"
VERDICT: Final = "verdict"
PLACED: Final = (READER_NOTE, NO_AIRFRAME, VERDICT)
"""Kinds of notes that have their own place in a report; all other findings are trouble."""


@frozen_dataclass
class LogReport:
    """The report on one inspected log; seconds are since its first sample."""

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
    filters: tuple[str, ...] = ()
    settings: tuple[Setting, ...] = ()
    metadata: dict[str, str] = field(default_factory=dict[str, str])
    findings: tuple[Finding, ...] = ()
    next_step: NextStep | None = None
    pictures: LogPictures | None = None

    @property
    def as_argument(self) -> str:
        """The log as a command takes it: its file, and which log of several."""
        return log_as_argument(self.file, self.log)

    @property
    def usable(self) -> bool:
        """Whether any channel has samples left."""
        return any(channel.samples > 1 for channel in self.channels)

    @property
    def trouble(self) -> tuple[str, ...]:
        """Findings to know before the log is used, each sentence once."""
        return tuple(
            dict.fromkeys(sentences(one for one in self.findings if one.kind not in PLACED))
        )

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Verdicts of an identification with the given airframe."""
        return self._notes_of_kind(VERDICT)

    @property
    def not_judged(self) -> tuple[str, ...]:
        """Checks that more options allow."""
        # The next step may name the same command.
        said = "" if self.next_step is None else self.next_step.action
        return tuple(n for n in self._notes_of_kind(NO_AIRFRAME) if n.rsplit(": ")[-1] not in said)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the log's reader."""
        return self._notes_of_kind(READER_NOTE)

    def _notes_of_kind(self, kind: str) -> tuple[str, ...]:
        return sentences(one for one in self.findings if one.kind == kind)


@frozen_dataclass
class _Look:
    """The input of the checks: a log, its prepared flight, and why something is absent."""

    log: FlightLog
    airframe: Path | None
    prepared: PreparedFlight | None
    unprepared: str | None
    foreseen: Prospects | None
    unforeseen: str | None
    telemetry: Telemetry | None
    gravity: GravitySeen | None
    result: IdentificationResult | None
    unidentified: str | None


def inspect_log(
    log: FlightLog, *, airframe: Path | None = None, entry: FlightEntry | None = None
) -> LogReport:
    """Inspect a log: its channels, its gaps, its airborne part, and what this can identify."""
    channels = channel_reports(log)
    prepared, unprepared = prepare_if_usable(log)
    late = None if prepared is None else motor_lateness(prepared.data)
    foreseen, unforeseen = _predict_prospects(log, prepared, late)
    result, unidentified = _identify_log(log, airframe, entry)
    look = _Look(
        log=log,
        airframe=airframe,
        prepared=prepared,
        unprepared=unprepared,
        foreseen=foreseen,
        unforeseen=unforeseen,
        telemetry=telemetry(log),
        gravity=None if prepared is None else gravity_seen(prepared.data),
        result=result,
        unidentified=unidentified,
    )
    pictures = log_pictures(log, prepared, channels)
    filters = logged_low_passes(log)
    lacking = lacks_of(channels, filters)
    return LogReport(
        file=str(log.path),
        format=log.format,
        log=f"{log.log_number} of {log.logs_in_file}",
        seconds=log.seconds,
        channels=tuple(channels.values()),
        airborne=() if prepared is None else _airborne_spans(prepared),
        vibration=() if prepared is None else vibration(prepared.data),
        sweeps=() if prepared is None else _find_sweeps(prepared),
        motor_lateness=late,
        telemetry=look.telemetry,
        gravity=look.gravity,
        prospects=foreseen,
        filters=(*(f.words for f in filters), *_bandwidth_words(log, foreseen)),
        settings=settings_for(log.format, lacking, log.metadata),
        metadata=dict(log.metadata),
        findings=tuple(finding for check in CHECKS for finding in check(look)),
        next_step=_next_step(look, foreseen, lacking),
        pictures=pictures,
    )


def _bandwidth_words(log: FlightLog, foreseen: Prospects | None) -> Iterator[str]:
    """Say up to which frequency a sensor follows the rotors, and which settings would raise it."""
    if foreseen is None:
        return
    passed = [one for one in filters_on_board(log) if one.passed]
    for sensor, found in foreseen.bandwidths.items():
        low, high = found.interval
        own = [one.setting for one in passed if one.channel == sensor and one.kind == "low-pass"]
        cure = f"raise {' and '.join(own)}" if own else "log it less filtered or smoothed"
        yield (
            f"{SENSORS[sensor]} follows the rotors up to {found.cutoff:.2g} Hz only ({low:.2g} to "
            f"{high:.2g}), and faster motion does not count: {cure}"
        )


def _next_step(
    look: _Look, foreseen: Prospects | None, lacking: frozenset[Lack]
) -> NextStep | None:
    """Choose the next step: the one of the identification, else the predicted one."""
    if look.result is not None:
        from rotorfit.tools.planning.next_step import next_step  # brings what a plan needs

        return next_step(look.result)
    if look.prepared is None:
        needed = better_log(look.log, lacking - NO_SPEED - NO_BATTERY)
        by_pose = (
            NextStep(kind="done", action=BY_POSE.format(log=look.log.as_argument))
            if is_posed(look.log)
            else None
        )
        return by_pose if needed is None else NextStep(kind="log", action=needed)
    if foreseen is None:
        return None
    return foreseen_step(look.log, look.prepared, foreseen)


def _predict_prospects(
    log: FlightLog, prepared: PreparedFlight | None, late: float | None
) -> tuple[Prospects | None, str | None]:
    """Predict what a flight can show, or say why that fails."""
    if prepared is None:
        return None, None
    commanded = "rotor_speed" not in log.channels
    law = None if log.motors is None else log.motors.law
    try:
        found = prospects(prepared, expected_response(log, late), commanded=commanded, law=law)
        return replace(found, motors=found.motors and name_in_usual_order(log, found.motors)), None
    except (FlightError, EstimationError) as error:
        return None, str(error)


def _identify_log(
    log: FlightLog, airframe: Path | None, entry: FlightEntry | None
) -> tuple[IdentificationResult | None, str | None]:
    """Identify a log with an airframe, per kilogram, or say why that fails."""
    if airframe is None:
        return None, None
    # Without an airframe nothing is identified, and what identifies need not be loaded.
    from rotorfit.fit.experiment.experiment import single_flight_experiment
    from rotorfit.identification import identify
    from rotorfit.tools.planning.next_step import advise_flights

    number = log.log_number if log.logs_in_file > 1 else None
    experiment = single_flight_experiment(
        log.path, mass="unknown", airframe=airframe, log_number=number
    )
    if entry is not None:
        [configuration] = experiment.configuration
        configuration = configuration.model_copy(update={"flights": (entry,)})
        experiment = experiment.model_copy(update={"configuration": (configuration,)})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return identify(experiment, adviser=advise_flights), None
    except (LogError, FlightError) as error:
        # Without an IMU `_missing_channels` says so, and what to do.
        by_imu = experiment.identification.source == "imu"
        lacking = by_imu and not all(name in log.channels for name in NEEDED)
        return None, None if lacking else str(error)


def _reader_findings(look: _Look) -> Iterator[Finding]:
    yield from look.log.findings
    yield from (note(READER_NOTE, sentence) for sentence in look.log.notes)


def _missing_channels(look: _Look) -> Iterator[Finding]:
    """Yield findings on the log's lacks for an identification, with advice where it is usable."""
    present = look.log.channels.keys()
    if present and present <= {"position", "attitude", "velocity"}:
        yield _make_refusal("pose-alone", _pose_alone(look.log))
        return
    has_motors = bool({"rotor_speed", "command"} & present)
    loss = (
        'identify with source = "mocap" if position and attitude are those of motion capture'
        if is_posed(look.log)
        else f"nothing can be identified from this log{other_columns(look.log)}"
    )
    measured = (("gyro", "rotation rates"), ("accel", "specific force"))
    lacking = [f"no {name} channel ({what})" for name, what in measured if name not in present]
    # By its poses the flight may have been identified all the same.
    if lacking and look.result is None:
        yield _make_refusal("missing-channel", f"{' and '.join(lacking)}: {loss}")
    if not has_motors:
        cure = f"log ESC telemetry or motor outputs{other_columns(look.log)}"
        yield _make_refusal("missing-motors", f"no motor data: {cure}")
    elif "rotor_speed" not in present:
        yield doubt(
            "commands-alone",
            "no measured rotor speed, only commands: " + _without_speed(look),
        )


def _without_speed(look: _Look) -> str:
    """Advise on commands without speeds; a simulator measures no speed."""
    cures = ['identify with speed = "commanded"'] if look.prepared is not None else []
    if not look.log.simulator:
        cures.append(f"{'better, ' if cures else ''}log measured rotor speed")
    return "; ".join(cures) or "fly a flight in the simulator"


def _pose_alone(log: FlightLog) -> str:
    """Explain the lacks of a file of motion capture, and its use."""
    lack = "this file has only the pose, no motors"
    try:
        camera_clock(log.channels["position"].time)
    except (FlightError, KeyError) as error:
        return f"{lack}; it cannot be used as a recording together with a log either: {error}"
    use = 'give it together with the log of the autopilot (flights = [{ file = "LOG", mocap = '
    return f'{lack}: {use}"THIS FILE" }}])'


def _preparation_findings(look: _Look) -> Iterator[Finding]:
    if look.unprepared is not None:
        yield _make_refusal("preparation", look.unprepared)
    if look.prepared is None:
        return
    yield from look.prepared.findings
    if look.result is None:
        yield from contradicting_hovers(look.prepared, look.log.path.name)
    degrees = gyro_in_degrees(look.prepared.data, takes_columns=look.log.takes_columns)
    if degrees is not None:
        yield doubt("gyro-in-degrees", degrees)


def _prediction_findings(look: _Look) -> Iterator[Finding]:
    if look.unforeseen is not None:
        yield doubt("prospects", look.unforeseen)


def _telemetry_findings(look: _Look) -> Iterator[Finding]:
    seen = look.telemetry
    if seen is not None:
        late = seen.lateness
        evidence = () if late is None else (Evidence(name="telemetry_lateness", value=late),)
        yield from (doubt("telemetry", sentence, evidence=evidence) for sentence in seen.doubts)


def _gravity_findings(look: _Look) -> Iterator[Finding]:
    if look.gravity is None:
        return
    # With an airframe the identification has looked at the flight itself.
    identified = look.result is not None and bool(look.result.parameters)
    seen = replace(look.gravity, in_flight=None) if identified else look.gravity
    if look.result is not None and _is_against_gravity(look.result):
        return  # which says the same of the hover
    measured = {"gravity_at_rest": seen.at_rest, "gravity_in_flight": seen.in_flight}
    evidence = tuple(Evidence(name=n, value=v) for n, v in measured.items() if v is not None)
    yield from (doubt("gravity", sentence, evidence=evidence) for sentence in gravity_doubts(seen))


def _is_against_gravity(result: IdentificationResult) -> bool:
    """Test whether an identification objects to thrust or accelerometer by the hover."""
    from rotorfit.checks.hover_thrust import AGAINST_GRAVITY

    return any(one.kind == AGAINST_GRAVITY and one.sentence for one in result.findings)


def _identification_findings(look: _Look) -> Iterator[Finding]:
    if look.unidentified is not None:
        yield _make_refusal("identification", look.unidentified)
    if look.result is not None:
        yield from look.result.findings


def _verdict_notes(look: _Look) -> Iterator[Finding]:
    """Yield one note for each verdict, with the numbers that have it."""
    by_verdict: dict[str, list[str]] = {}
    for parameter in () if look.result is None else look.result.parameters:
        by_verdict.setdefault(parameter.verdict, []).append(parameter.name)
    file = "" if look.airframe is None else look.airframe.name
    for verdict, names in by_verdict.items():
        sentence = f"with {file}: {verdict}: {', '.join(names)}"
        yield note(VERDICT, sentence, numbers=tuple(names))


def _stated_law(look: _Look) -> Iterator[Finding]:
    """Say what settles a law that settings of the firmware state; an identification says so too."""
    motors, foreseen = look.log.motors, look.foreseen
    if motors is None or motors.law.exact or foreseen is None or look.result is not None:
        return
    if foreseen.commanded:
        from rotorfit.checks.motors.motor_law import STATED, stated_sentence

        shown = "one flight at one weight hardly shows whether they are right"
        sentence = stated_sentence(motors.words, foreseen.thrust.law_full, shown=shown)
        yield note(STATED, sentence, numbers=("thrust_to_weight", "max_thrust"))


def _missing_airframe(look: _Look) -> Iterator[Finding]:
    if look.prepared is not None and look.airframe is None:
        yield note(NO_AIRFRAME, WITH_AIRFRAME.format(log=look.log.as_argument))


def _make_refusal(kind: str, sentence: str) -> Finding:
    return Finding(kind=kind, severity="refusal", sentence=sentence)


CHECKS: Final[tuple[Callable[[_Look], Iterable[Finding]], ...]] = (
    _reader_findings,
    _missing_channels,
    _preparation_findings,
    _prediction_findings,
    _telemetry_findings,
    _gravity_findings,
    _identification_findings,
    _verdict_notes,
    _stated_law,
    _missing_airframe,
)
"""The doctor's checks, in the order of a report."""


def _airborne_spans(prepared: PreparedFlight) -> tuple[tuple[float, float], ...]:
    t = prepared.data.time
    return tuple(
        (float(t[s.start] - t[0]), float(t[s.stop - 1] - t[0])) for s in prepared.data.segments
    )


def _find_sweeps(prepared: PreparedFlight) -> tuple[Sweep, ...]:
    """Find the frequency sweeps in flight, in seconds since the first sample."""
    data = prepared.data
    time = data.time - data.time[0]
    return tuple(
        sweep
        for s in data.segments
        for sweep in frequency_sweeps(
            time[s.start : s.stop], data.angular_velocity[s.start : s.stop]
        )
    )
