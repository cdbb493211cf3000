"""What inspect says of one log: one screen of text, JSON, or a page."""

import textwrap
from dataclasses import asdict, dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Final

from rotorfit.flight.doctor import ChannelReport, Vibration
from rotorfit.flight.telemetry import Telemetry
from rotorfit.identification.doctor import Excitation, Prospects
from rotorfit.identification.gravity_check import GravitySeen
from rotorfit.logs.files import write_whole
from rotorfit.report.settings import FILES, Setting

MOST_SPANS: Final = 6
SLOWED: Final = 0.8
"""True over recorded rate below which it is said."""
LEAST_LIMITED: Final = 1e-4
USED: Final = ("gyro", "accel", "rotor_speed", "command")
LEAST_LATE: Final = 0.002
MUCH_JITTER: Final = 0.3
SHAKES: Final = ((10.0, "strong: balance the propellers"), (3.0, "moderate"), (0.0, "low"))
"""Levels of vibration [m/s^2] and their words."""
LEAST_CHANGE: Final = 3.0
"""Change of thrust from which kt is found well [%]."""
PROSPECT: Final = {
    "well": "{what} can be found well",
    "roughly": "{what} roughly: disturbances are not small against this motion",
    "not": "{what} cannot be found: the motors explain too little of the motion",
}
WHAT: Final = {
    "roll": "Ixx",
    "pitch": "Iyy",
    "yaw": "kd / Izz, and Izz, kd, Jr with roll and pitch",
}


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

    @property
    def usable(self) -> bool:
        """Whether any channel has samples left."""
        return any(channel.samples > 1 for channel in self.channels)


def plain(report: LogReport) -> dict[str, Any]:
    """Return a report as JSON can hold it."""
    found = asdict(report)
    for setting in found["settings"]:
        setting["asked_by"] = sorted(setting["asked_by"])
    return found


def report_text(report: LogReport) -> str:
    """Return a report as one screen."""
    lines = [f"{report.file}: {report.format}, log {report.log}, {report.seconds:.1f} s", ""]
    lines.append(
        f"  {'channel':<12}{'columns':>8}{'samples':>9}{'rate':>10}{'gaps':>6}  {'unit':<6} source"
    )
    lines += [_channel_line(channel) for channel in report.channels]
    lines += ["", f"  airborne: {_spans(report.airborne)}"]
    facts = [name for name in ("Craft name", "Firmware revision") if name in report.metadata]
    lines += [f"  {name}: {report.metadata[name]}" for name in facts]
    lines += [f"  {note}" for note in report.notes]
    for title, words in sections(report):
        lines += ["", f"  {title}", *(line for text in words for line in _wrapped(text))]
    return "\n".join([*lines, ""])


def sections(report: LogReport) -> list[tuple[str, list[str]]]:
    """Return the headed lists of a report that are not empty."""
    found = [
        ("Recording", recording_words(report)),
        ("Flight", flight_words(report)),
        (
            "What this flight could tell",
            [*prospect_words(report.prospects), *report.verdicts, *report.not_judged],
        ),
        ("To know", list(report.trouble)),
        ("To set before the next flight", setting_words(report)),
    ]
    return [(title, words) for title, words in found if words]


def recording_words(report: LogReport) -> list[str]:
    """Return what is to be said of the samples as they were recorded."""
    words = [text for channel in report.channels for text in _channel_words(channel)]
    return [*words, *report.filters]


def _channel_words(c: ChannelReport) -> list[str]:
    words: list[str] = []
    if c.name in USED and c.true_rate < SLOWED * c.rate:
        words.append(
            f"{c.name}: recorded at {c.rate:.0f} Hz, but only {c.true_rate:.0f} samples a second "
            "are new: the rest repeats the last one or lies on a straight line"
        )
    if c.gaps:
        used = "; they are cut out" if c.name in USED else ""
        words.append(f"{c.name}: {c.gaps} gaps, the longest {c.longest_gap:.3g} s{used}")
    if c.rate > 0 and c.jitter * c.rate > MUCH_JITTER:
        words.append(
            f"{c.name}: steps vary by {1e3 * c.jitter:.2g} ms around {1e3 / c.rate:.3g} ms"
        )
    if c.at_limit > LEAST_LIMITED:
        words.append(
            f"{c.name}: {100 * c.at_limit:.2g} % of the samples stand at the sensor's limit: fly "
            "gentler there, or set a larger range"
        )
    if c.missing:
        words.append(f"{c.name}: {c.missing} samples without a value")
    return words


def flight_words(report: LogReport) -> list[str]:
    """Return what is to be said of the airborne part."""
    words: list[str] = []
    if report.vibration:
        levels = ", ".join(
            f"{v.level:.2g} m/s^2 at {v.low:.0f} to {v.high:.0f} Hz" for v in report.vibration
        )
        worst = max(v.level for v in report.vibration)
        verdict = next(name for level, name in SHAKES if worst >= level)
        words.append(f"vibration {levels}: {verdict}")
    if report.motor_lateness is not None and abs(report.motor_lateness) > LEAST_LATE:
        late = 1e3 * report.motor_lateness
        words.append(
            f"the vehicle answers {late:.0f} ms after the motor data"
            if late >= 0
            else f"the motor data were recorded {-late:.0f} ms after the motion that they make"
        )
    words += [*telemetry_words(report.telemetry), *gravity_words(report.gravity)]
    if report.prospects is not None and report.prospects.motors is not None:
        words.append(f"the motors answer like {report.prospects.motors}")
    return words


def telemetry_words(found: Telemetry | None) -> list[str]:
    """Return how the measured rotor speeds go with the commands, where they do."""
    if found is None or found.doubts:
        return []
    told = [r.correlation for r in found.rotors if r.correlation is not None]
    if not told or found.lateness is None:
        return ["motor commands and measured rotor speeds: too little in common to compare them"]
    return [
        f"each measured rotor speed follows its own command (correlation {min(told):.2f} to "
        f"{max(told):.2f}, {1e3 * found.lateness:.0f} ms later)"
        if all(r.state == "follows" for r in found.rotors)
        else "motor commands move too little to tell whether each measured rotor speed is its own "
        f"(correlation {min(told):.2f} to {max(told):.2f})"
    ]


def gravity_words(found: GravitySeen | None) -> list[str]:
    """Return what the accelerometer makes of gravity."""
    if found is None:
        return []
    rest = [] if found.at_rest is None else [f"{found.at_rest:.3f} g at rest"]
    flight = (
        []
        if found.in_flight is None
        else [f"{found.in_flight:.3f}{_plus_minus(found)} g on average in flight"]
    )
    return [f"the accelerometer reads {' and '.join([*rest, *flight])}"] if rest or flight else []


def _plus_minus(found: GravitySeen) -> str:
    return "" if found.in_flight_std is None else f" +- {1.96 * found.in_flight_std:.3f}"


def prospect_words(found: Prospects | None) -> list[str]:
    """Return in words which parameters the motion could tell."""
    if found is None:
        return []
    change = 100.0 * found.thrust_change
    thrust = (
        f"thrust changes by {change:.0f} %: kt (per kilogram) can be found well"
        if change > LEAST_CHANGE
        else f"thrust changes by {change:.1f} % only: kt from the weight alone; climb and sink"
    )
    return [thrust, *map(_axis_words, found.excitation)]


def _axis_words(axis: Excitation) -> str:
    verdict = PROSPECT[axis.prospect].format(what=WHAT[axis.axis])
    return (
        f"{axis.axis}: {axis.turning:.2g} rad/s^2, motors over the rest {axis.rho:.2g}: {verdict}"
    )


def setting_words(report: LogReport) -> list[str]:
    """Return the settings to change, and the file that holds them."""
    if not report.settings:
        return []
    words = [
        f"{s.name} {s.value}: {s.why}" if s.name.endswith(":") else f"{s.name} = {s.value}: {s.why}"
        for s in report.settings
    ]
    return [*words, f"ready to load: examples/settings/{FILES[report.format]}"]


def _wrapped(text: str) -> list[str]:
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


def write_page(path: Path, reports: list[LogReport], *, force: bool) -> None:
    """Write reports as one page that needs nothing else, whole or not at all.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    write_whole(path, page(reports), force=force)


def page(reports: list[LogReport]) -> str:
    """Return reports as one HTML page."""
    style = (Path(__file__).parent / "templates" / "page.css").read_text(encoding="utf-8")
    body = "\n".join(map(_article, reports))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; style-src 'unsafe-inline'\">"
        f"<title>Flight logs</title>\n<style>\n{style}</style></head>\n<body><main>\n{body}\n"
        "</main></body></html>\n"
    )


def _article(report: LogReport) -> str:
    cells = ("channel", "samples", "rate [Hz]", "new [Hz]", "gaps", "unit", "source")
    rows = "\n".join(map(_row, report.channels))
    lists = "\n".join(
        f"<h2>{title}</h2><ul>{''.join(f'<li>{escape(text)}</li>' for text in words)}</ul>"
        for title, words in [*sections(report), ("What the reader says", list(report.notes))]
        if words
    )
    return (
        f"<h1>{escape(Path(report.file).name)}</h1>\n<p>{escape(report.format)}, log {report.log}, "
        f"{report.seconds:.1f} s; airborne: {_spans(report.airborne)}</p>\n<table><thead><tr>"
        f"{''.join(f'<th>{cell}</th>' for cell in cells)}</tr></thead><tbody>\n{rows}\n"
        f"</tbody></table>\n{lists}"
    )


def _row(c: ChannelReport) -> str:
    cells = (
        c.name,
        str(c.samples),
        f"{c.rate:.0f}",
        f"{c.true_rate:.0f}",
        str(c.gaps),
        c.unit,
        c.source,
    )
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
