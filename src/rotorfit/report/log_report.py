"""The report on one inspected log: one screen of text, or JSON."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

from rotorfit.checks.motors.motor_law import law_decides
from rotorfit.checks.thrust_against_weight import compare_with_weight
from rotorfit.checks.verdicts.judge import ratio_words
from rotorfit.digits import short, with_half
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION
from rotorfit.fit.timing.timing_search import ASKED_FOR
from rotorfit.sheet import wrapped
from rotorfit.tools.inspection.motor_lateness import LATEST, SEARCHED
from rotorfit.tools.inspection.recording import ChannelReport, settings_file
from rotorfit.tools.inspection.spectra import AXES, Spectrum, Sweep

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.dataset.plausible_units import GravitySeen
    from rotorfit.flight.motors.rotor_telemetry import Telemetry
    from rotorfit.tools.inspection.inspect_log import LogReport
    from rotorfit.tools.inspection.prospects import Excitation, Prospects

JSON_KEYS: Final = (
    *("file", "format", "log", "seconds", "channels", "airborne", "vibration", "sweeps"),
    *("motor_lateness", "telemetry", "gravity", "prospects", "verdicts", "not_judged"),
    *("filters", "trouble", "settings", "notes", "metadata", "next_step"),
)
MOST_SPANS: Final = 6
SLOWED: Final = 0.8
"""True over recorded rate below which it is said."""
LEAST_LIMITED: Final = 1e-4
USED: Final = ("gyro", "accel", "rotor_speed", "command")
LEAST_LATE: Final = 0.002
MUCH_JITTER: Final = 0.3
SHAKES: Final = ((10.0, "strong: balance the propellers"), (3.0, "moderate"), (0.0, "low"))
"""Levels of vibration [m/s^2] and their words."""
LEAST_LIMITED_COMMANDS: Final = 0.01
"""Share of the flight with a motor at its limit from which it is said."""
SLOW_COMMANDS: Final = 50.0
"""Rate below which commands show nothing of turns [Hz]."""
MUCH_LAG: Final = 0.01
"""Difference of two lags that is said [s]."""
LEAST_CHANGE: Final = 3.0
"""Change of thrust below which kt is found from the weight alone [%]."""
WHAT: Final = {"roll": ("Ixx", ""), "pitch": ("Iyy", ""), "yaw": ("kd / Izz", "Izz, kd and Jr")}
"""What an axis shows, and what it shows with all the others."""
KNOW: Final = "To know"
AS_BEFORE: Final = "for the same reason"
"""Reason for an axis whose reason another one has."""
LEAST_SOURCE: Final = 16
"""Room for a channel's source beside its numbers [characters]."""
WIDTH: Final = 100
"""Width of a line where nothing is known of the terminal."""


def plain(report: LogReport) -> dict[str, Any]:
    """Convert a report to what JSON can hold."""
    fields = asdict(replace(report, pictures=None, findings=()))
    found = {name: fields.get(name, getattr(report, name)) for name in JSON_KEYS}
    found["peaks"] = {s.channel: [asdict(p) for p in s.peaks] for s in _spectra_of(report)}
    for setting in found["settings"]:
        setting["asked_by"] = sorted(setting["asked_by"])
    return found


def report_text(report: LogReport, *, width: int = WIDTH) -> str:
    """Write a report as one screen, wrapped at `width` where words can be parted."""
    title = f"{report.file}: {report.format}, log {report.log}, {report.seconds:.1f} s"
    head = f"  {'channel':<12}{'columns':>8}{'samples':>9}{'rate':>10}{'gaps':>6}  {'unit':<6} "
    source = "source" if width >= len(head) + LEAST_SOURCE else ""
    lines = [*wrapped(title, width), "", f"{head}{source}".rstrip()]
    lines += [line for channel in report.channels for line in _channel_lines(channel, width)]
    facts = [name for name in ("Craft name", "Firmware revision") if name in report.metadata]
    notes = [f"airborne: {airborne_phrase(report)}"]
    notes += [*(f"{name}: {report.metadata[name]}" for name in facts), *report.notes]
    lines += ["", *(line for note in notes for line in wrapped(note, width, "  ", "    "))]
    for title, words in sections(report):
        lines += ["", f"  {title}"]
        lines += [line for text in words for line in wrapped(text, width, "  - ")]
    return "\n".join([*lines, ""])


def sections(report: LogReport) -> list[tuple[str, list[str]]]:
    """Collect the headed lists of a report that are not empty."""
    found = [
        ("Recording", recording_messages(report)),
        ("Flight", flight_messages(report)),
        (
            "What this flight shows" if report.verdicts else "What this flight can show",
            # Verdicts are what the prospects only foresee.
            [*(report.verdicts or prospect_messages(report.prospects)), *report.not_judged],
        ),
        (KNOW, list(report.trouble)),
        ("Settings to change", setting_messages(report)),
        ("Next step", [] if report.next_step is None else [report.next_step.sentence]),
    ]
    return [(title, words) for title, words in found if words]


def recording_messages(report: LogReport) -> list[str]:
    """Report on the samples as they were recorded."""
    named: dict[str, list[str]] = {}
    for channel in report.channels:
        for text in _channel_messages(channel):
            name, _, words = text.partition(": ")
            named.setdefault(words, []).append(name)
    return [*(f"{', '.join(names)}: {words}" for words, names in named.items()), *report.filters]


def _channel_messages(c: ChannelReport) -> list[str]:
    words: list[str] = []
    if c.name in USED and c.true_rate < SLOWED * c.rate:
        words.append(
            f"{c.name}: recorded at {c.rate:.0f} Hz, but only {c.true_rate:.0f} samples a second "
            "are new: the rest repeats the last one or lies on a straight line"
        )
    if c.gaps:
        used = "; they are cut out" if c.name in USED else ""
        words.append(
            f"{c.name}: a gap of {c.longest_gap:.3g} s{', which is cut out' if used else ''}"
            if c.gaps == 1
            else f"{c.name}: {c.gaps} gaps, the longest {c.longest_gap:.3g} s{used}"
        )
    if c.rate > 0 and c.jitter * c.rate > MUCH_JITTER:
        words.append(
            f"{c.name}: steps vary by {1e3 * c.jitter:.2g} ms around {1e3 / c.rate:.3g} ms"
        )
    if c.at_limit > LEAST_LIMITED:
        words.append(
            f"{c.name}: {100 * c.at_limit:.3g} % of the samples stand at the sensor's limit: fly "
            "gentler there, or set a larger range"
        )
    if c.missing:
        words.append(f"{c.name}: {c.missing} samples without a value")
    return words


def flight_messages(report: LogReport) -> list[str]:
    """Report on the airborne part."""
    words: list[str] = []
    if report.vibration:
        levels = ", ".join(
            f"{v.level:.2g} m/s^2 at {v.low:.0f} to {v.high:.0f} Hz" for v in report.vibration
        )
        worst = max(v.level for v in report.vibration)
        verdict = next(name for level, name in SHAKES if worst >= level)
        words.append(f"vibration {levels}: {verdict}")
    words += peak_messages(report)
    words += sweep_messages(report.sweeps)
    words += lateness_messages(report)
    words += [*telemetry_messages(report.telemetry), *gravity_messages(report.gravity)]
    if report.prospects is not None and report.prospects.motors is not None:
        words.append(
            f"the motors turn the vehicle as those of {report.prospects.motors}: measure the arms "
            "and the shape of the frame, which no flight shows"
        )
    return words


def peak_messages(report: LogReport) -> list[str]:
    """Report where vibration is strongest, and whether the rotors make it."""
    parts = [
        f"{spectrum.channel} {'; '.join(peak.words for peak in spectrum.peaks)}"
        for spectrum in _spectra_of(report)
        if spectrum.airborne and spectrum.peaks
    ]
    return [f"peaks of vibration: {', '.join(parts)}"] if parts else []


def _spectra_of(report: LogReport) -> tuple[Spectrum, ...]:
    return () if report.pictures is None else report.pictures.spectra


def sweep_messages(sweeps: Sequence[Sweep]) -> list[str]:
    """Report which axes an autopilot swept, and which are still to be."""
    if not sweeps:
        return []
    flown = {sweep.axis for sweep in sweeps}
    missing = [axis for axis in AXES if axis not in flown]
    listed = "; ".join(sweep.words() for sweep in sweeps)
    words = f"frequency sweeps (ArduPilot's SystemID mode, Betaflight's chirp): {listed}"
    return [f"{words}; sweep {' and '.join(missing)}, too" if missing else words]


def lateness_messages(report: LogReport) -> list[str]:
    """Report the delay between motor data and motion, and the cure where it is too long."""
    late = report.motor_lateness
    if late is None or abs(late) <= LEAST_LATE:
        return []
    words = (
        f"the vehicle responds {1e3 * late:.0f} ms after the motor data"
        if late >= 0
        else f"the motor data were recorded {-1e3 * late:.0f} ms after the motion that they cause"
    )
    measured = any(channel.name == "rotor_speed" for channel in report.channels)
    cause = "no motor is so slow" if late > 0 else "their clocks differ"
    if late > LATEST or late < -SEARCHED:
        return [
            f"{words}: {cause}; bring motor data and IMU on one clock, or log both by one recorder"
        ]
    if not measured and late < 0.0:
        return [
            f"the commands follow the motion by {-1e3 * late:.0f} ms instead of leading it: the "
            "pilot hardly steers, and the autopilot reacts to gusts and to the noise of its gyro"
        ]
    if measured and late > ASKED_FOR:
        return [
            f"{words}: these may be the speeds that were asked for, which motors reach that much "
            f"later; log those measured, or, if they are, write delay = {late:.3f} under [motors]"
        ]
    if measured and late > SEARCHED:
        return [
            f"{words}: write delay = {late:.3f} under [motors], as it is looked for up to 12 ms"
        ]
    return [words]


def telemetry_messages(found: Telemetry | None) -> list[str]:
    """Report how the measured rotor speeds go with the commands, where they do."""
    if found is None or found.doubts:
        return []
    correlations = [r.correlation for r in found.rotors if r.correlation is not None]
    if not correlations or found.lateness is None:
        return ["motor commands and measured rotor speeds: too little in common to compare them"]
    low, high = min(correlations), max(correlations)
    return [
        f"each measured rotor speed follows its own command (correlation {low:.2f} to {high:.2f}, "
        f"{1e3 * found.lateness:.0f} ms later)"
        if all(r.state == "follows" for r in found.rotors)
        else "motor commands move too little to show that each measured rotor speed is its own "
        f"(correlation {low:.2f} to {high:.2f})"
    ]


def gravity_messages(found: GravitySeen | None) -> list[str]:
    """Report what the accelerometer makes of gravity."""
    if found is None:
        return []
    rest = [] if found.at_rest is None else [f"{found.at_rest:.3f} g at rest"]
    half = 1.96 * (found.in_flight_std or 0.0)
    flight = (
        []
        if found.in_flight is None
        else [f"{with_half(found.in_flight, half)} g on average in hover"]
    )
    return [f"the accelerometer reads {' and '.join([*rest, *flight])}"] if rest or flight else []


def prospect_messages(found: Prospects | None) -> list[str]:
    """Report which parameters the motion can show."""
    if found is None:
        return []
    messages, given = [_thrust_message(found)], set[str]()
    for axis in found.excitation:
        reason = _explain_axis(axis, found)
        messages.append(_axis_message(axis, found, AS_BEFORE if reason in given else reason))
        given.add(reason)
    return messages


def _thrust_message(found: Prospects) -> str:
    thrust = found.thrust
    change = 100.0 * thrust.change
    if change <= LEAST_CHANGE:
        return f"thrust changes by {change:.1f} % only: kt from the weight alone; climb and sink"
    verdict = {
        "well": "kt (per kilogram) can be found",
        "roughly": "kt (per kilogram) can be found roughly",
        "not": "kt cannot be found",
    }[thrust.prospect]
    if found.useless_because is not None and found.commands is None:
        by_weight = "" if thrust.prospect == "not" else " from the weight alone"
        return f"{verdict}{by_weight}: the log is too slow for changes of thrust"
    if not thrust.followed:
        by_weight = "" if thrust.prospect == "not" else " by the weight"
        return f"thrust changes by {change:.0f} %: {verdict}{by_weight}. {_explain_turns(found)}"
    if thrust.law_full:
        full = f"Full thrust is known to +-{100 * thrust.law_full:.0f} % only"
        why = "for want of a law from command to rotor speed: give it under [motors], or log the"
        stated = found.commands is not None and found.commands.law_known
        known = f"{full} (see To know)" if stated else f"{full}, {why} rotor speed"
        return f"thrust changes by {change:.0f} %: {verdict}. {known}"
    if thrust.agree or thrust.ratio is None:
        sure = " well" if thrust.prospect == "well" else ": too few changes of thrust"
        return f"thrust changes by {change:.0f} %: {verdict}{sure}"
    joined = "because" if thrust.prospect == "not" else "but"
    return (
        f"thrust changes by {change:.0f} %: {verdict}, {joined} by these changes "
        f"{compare_with_weight(thrust.ratio)} (without the turns, which identify weighs, too). "
        "Drag in climb and descent may be the cause, or the accelerometer's scale: calibrate it"
    )


def _explain_turns(found: Prospects) -> str:
    """Explain possible faults where commands do not explain the turns that a pilot flies."""
    commands = found.commands
    if commands is not None and commands.rate < SLOW_COMMANDS:
        return f"Commands at {commands.rate:.0f} Hz are too slow to explain the turns"
    if found.motors is None:
        return "Neither roll nor pitch follows the motor commands"
    words = "The commands explain quick turns, but not the slow ones that a pilot flies"
    if commands is None:
        return words
    causes = [] if commands.law_known else ["the law from command to rotor speed is not known"]
    if commands.limited >= LEAST_LIMITED_COMMANDS:
        causes.append(f"a motor is at its limit in {100.0 * commands.limited:.0f} % of the flight")
    if abs(commands.lag - commands.seen_lag) > MUCH_LAG:
        causes.append(
            f"slow turns fit a motor lag of {1e3 * commands.lag:.0f} ms, quick ones "
            f"{1e3 * commands.seen_lag:.0f} ms"
        )
    cure = "Log the rotor speed, or give law and lag under [motors]"
    return ". ".join([f"{words}: {', or '.join(causes)}" if causes else words, cure])


def _axis_message(axis: Excitation, found: Prospects, reason: str) -> str:
    what, others = WHAT[axis.axis]
    slow = found.useless_because is not None
    width = ""
    if axis.width is not None and not slow:
        width = f" (to about +-{short(100.0 * axis.width)} %)"
    verdict = {
        # The scale of Izz depends on small terms of all equations, which only an estimate weighs.
        "well": f"{what} can be found well{width}{others and f'; {others} less well'}",
        "roughly": f"{what} roughly{width}{others and f', {others} less well'}; {reason}",
        "not": f"{what}{others and f', {others}'} cannot be found; {reason}",
    }["roughly" if slow and axis.prospect == "well" else axis.prospect]
    return f"{axis.axis} ({short(axis.turning)} rad/s^2): {verdict}"


def _explain_axis(axis: Excitation, found: Prospects) -> str:
    """Explain why the number of an axis is not found well, in an estimate's words."""
    if found.useless_because is not None:
        return "the log is too slow"
    if axis.rho < LEAST_EXCITATION:
        if axis.prospect == "not" and not found.thrust.followed and found.motors is not None:
            return f"the commands do not explain {axis.axis}, see thrust"
        words = (
            "noise and gusts hide the motion"
            if axis.prospect == "not"
            else f"{axis.axis} is not much stronger than gusts"
        )
        return f"{words} ({ratio_words(axis.rho)})"
    if axis.axis != "yaw" and found.thrust.prospect != "well":
        return "limited by how well kt is known"
    if axis.axis != "yaw" and law_decides(found.thrust.law_reach, axis.width or math.inf):
        return "limited by the changes of thrust above"
    return "fly more of this motion"


def setting_messages(report: LogReport) -> list[str]:
    """List the settings to change, and the command that writes them into a file."""
    if not report.settings:
        return []
    words = [
        f"{s.name}{' ' if s.name.endswith(':') else ' = '}{s.value}: {_why_set(s.why, report)}"
        for s in report.settings
    ]
    file = settings_file(report.format, report.metadata)
    if file is None:
        return words
    return [
        *words,
        f"as a file, from this log's own values: rotorfit settings {report.as_argument}",
    ]


def _why_set(why: str, report: LogReport) -> str:
    """Say what a setting gives, without the sentences that the next step has."""
    gives, _, more = why.partition(". ")
    step = "" if report.next_step is None else report.next_step.action
    return gives if more and more in step else why


def _channel_lines(c: ChannelReport, width: int) -> list[str]:
    gaps = f"{c.gaps}" if c.gaps else "-"
    start = f"  {c.name:<12}{c.columns:>8}{c.samples:>9}{c.rate:>7.0f} Hz{gaps:>6}  {c.unit:<6} "
    if width < len(start) + LEAST_SOURCE:  # below it
        return [start.rstrip(), *wrapped(c.source, width, "      ")]
    return wrapped(c.source, width, start) or [start.rstrip()]


def airborne_phrase(report: LogReport) -> str:
    """Describe the airborne part, or why it was not looked for."""
    channels = {channel.name for channel in report.channels}
    if not report.airborne and not channels & {"gyro", "accel"}:
        return "not looked for, as the log has no IMU"
    return spans_phrase(report.airborne)


def spans_phrase(spans: tuple[tuple[float, float], ...]) -> str:
    """Describe the airborne part."""
    if not spans:
        # The autopilot's own account may well know of a flight.
        return "not found from motors and IMU; the reason is below"
    total = sum(end - start for start, end in spans)
    if len(spans) > MOST_SPANS:
        first, last = spans[0][0], spans[-1][1]
        return f"{len(spans)} stretches between {first:.2f} and {last:.2f} s ({total:.1f} s)"
    parts = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in spans)
    return f"{parts} ({total:.1f} s)"
