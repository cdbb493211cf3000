"""The head of page and terminal: ten lines that a pilot reads."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace
from math import floor, log10, pi, sqrt
from typing import TYPE_CHECKING, Final

from rotorfit.digits import known, number_of, with_interval
from rotorfit.flight.airborne import GRAVITY
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.parameters import VERDICT_MEANING
from rotorfit.report.text import flight_notes, flights_in_words
from rotorfit.results.command_law import AT_COMMAND, UNDER_LOAD
from rotorfit.results.result import (
    Derived,
    IdentificationResult,
    Parameter,
    configuration_names,
    verdict_of,
)
from rotorfit.sheet import wrapped
from rotorfit.tools.planning.next_step import next_step

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rotorfit.findings import Finding

DIRECTIONS: Final = {
    "com_x": ("forward", "back"),
    "com_y": ("left", "right"),
    "com_z": ("up", "down"),
}
MOST_REMARKS: Final = 3
"""Most remarks; the others are counted."""
PILOT_NAMES: Final = {
    "kt": "thrust",
    "kd": "drag torque",
    "kd_over_kt": "drag torque over thrust",
    "Jr": "rotor inertia",
    "max_thrust": "largest thrust",
    **dict.fromkeys(("Ixx", "Iyy", "Izz"), "inertia"),
    **dict.fromkeys(("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt"), "inertia"),
    **dict.fromkeys(("Ixy", "Ixz", "Iyz"), "products of inertia"),
    **dict.fromkeys(("com_x", "com_y", "com_z", "msx", "msy", "msz"), "centre of mass"),
}
TITLE_WIDTH: Final = 26
REST: Final = "Full tables{more}: --full; a page: --report FILE.html; data: --json"


@frozen_dataclass
class Part:
    """One number of a line in the line's unit; `words` say which, or are empty."""

    words: str
    value: float | None
    interval: tuple[float, float] | None
    verdict: str

    @property
    def shown(self) -> str:
        """Format the number with half of its interval."""
        lost = "only as a ratio" if self.verdict == "ratio-only" else "not known"
        return str(number_of(self.value, self.interval) or lost)

    @property
    def doubt(self) -> str:
        """The verdict if the number does not show it; empty for a good number."""
        return "" if self.value is None or self.verdict == "identified" else self.verdict


@frozen_dataclass
class Line:
    """What a pilot asks for, with a remark on all parts; without parts it says why."""

    title: str
    unit: str
    parts: tuple[Part, ...]
    remark: str

    @property
    def heading(self) -> str:
        """Write the title with the unit in brackets."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@frozen_dataclass
class Summary:
    """A result in ten lines, by what they are of, with doubts, next step, counts of verdicts.

    - `doubts`: which numbers may be outside their intervals, and why.
    - `notes`: other objections of checks, in short.
    - `more`: how many other doubts and notes there are.
    - `counts`: verdict, how many parameters have it, what it means.
    """

    groups: tuple[tuple[str, tuple[Line, ...]], ...]
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    more: int
    next_step: str | None
    counts: tuple[tuple[str, int, str], ...]


def summary_of(result: IdentificationResult) -> Summary:
    """Summarise a result in the numbers that a pilot asks for."""
    names = configuration_names(result)
    motors, bodies = _motor_lines(result), {name: _body_lines(result, name) for name in names}
    if len(names) == 1:
        thrust, place = bodies[names[0]]
        groups = [("", _drop_repeated((*thrust, *motors, *place)))]
    else:
        groups = [("Motors", tuple(motors))]
        groups += [(f"Body, configuration {n}", (*a, *b)) for n, (a, b) in bodies.items()]
    verdicts = [p.verdict for p in result.parameters]
    doubts, notes, more = _select_remarks(result)
    return Summary(
        groups=tuple(group for group in groups if group[1]),
        doubts=doubts,
        notes=notes,
        more=more,
        next_step=next_step(result).sentence,
        counts=tuple(
            (word, verdicts.count(word), meaning)
            for word, meaning in VERDICT_MEANING.items()
            if word in verdicts
        ),
    )


def summary_text(result: IdentificationResult, *, width: int) -> str:
    """Write a result for a terminal in about ten lines; what has no verdict is identified."""
    summary = summary_of(result)
    lines = textwrap.wrap(f"{flights_in_words(result)}; +- is half of the 95 % interval", width)
    for title, members in summary.groups:
        lines += [title] if title else []
        for member in members:
            lines += wrapped(_line_body(member), width, f"  {member.heading:<{TITLE_WIDTH}}")
    for words in summary.doubts:
        lines += wrapped(words, width, "Doubt: ")
    for words in summary.notes:
        lines += wrapped(words, width, "Note:  ")
    if summary.next_step:
        lines += wrapped(summary.next_step, width, "Next:  ")
    count = f"{summary.more} more remark{'' if summary.more == 1 else 's'}"
    more = f", {count}" if summary.more else ""
    lines += wrapped(REST.format(more=more), width)
    return "\n".join(lines) + "\n"


def _drop_repeated(lines: Sequence[Line]) -> tuple[Line, ...]:
    """Leave out lines without a number that say why in the words of one before."""
    said = [line.remark for line in lines]
    return tuple(x for i, x in enumerate(lines) if x.parts or x.remark not in said[:i])


def _line_body(line: Line) -> str:
    parts = [*map(_part_in_ascii, line.parts), *([line.remark] if line.remark else [])]
    return ", ".join(parts)


def _part_in_ascii(part: Part) -> str:
    number = part.shown if part.value is None else with_interval(part.value, part.interval)
    return " ".join(filter(None, (part.words, number, part.doubt and f"({part.doubt})")))


def _select_remarks(result: IdentificationResult) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Select doubts and notes that say the most, in short, and count what else there is to know."""
    found = [one for one in result.findings if one.severity == "doubt"]
    every = [one for one in result.every_finding if one.severity == "doubt"]
    disowned = (_disowned_numbers(one, result) for one in every if one.doubtful_because)
    doubts = list(dict.fromkeys(filter(None, disowned)))[:MOST_REMARKS]
    covered = (_in_short(one) for one in found if not one.doubtful_because)
    notes = list(dict.fromkeys(covered))[: MOST_REMARKS - len(doubts)]
    count = len(result.warnings) + len(flight_notes(result))
    return tuple(doubts), tuple(notes), max(count - len(doubts) - len(notes), 0)


def _disowned_numbers(finding: Finding, result: IdentificationResult) -> str:
    """State which numbers may be outside their intervals, and why; empty if none is shown."""
    numbers = (*result.parameters, *result.derived)
    doubtful = [n for n in numbers if n.value is not None and verdict_of(result, n) == "doubtful"]
    about = [name_of(n) for n in doubtful if finding.is_about(n.full_name)]
    if not about:
        return ""
    names, own = list(dict.fromkeys(about)), "its interval"
    if len(names) > 1:
        own = "their intervals"
    ratio = next((one.value for one in finding.evidence if one.name == "thrust_over_weight"), None)
    by = "" if ratio is None else f" by {100.0 * abs(ratio - 1.0):.0f} %"
    return f"{', '.join(names)} may be outside {own}: {finding.doubtful_because}{by}"


def name_of(number: Parameter | Derived) -> str:
    """Name what a number is of, as a pilot does."""
    base = number.name.removesuffix("_com").rstrip("0123456789").rstrip("_")
    return PILOT_NAMES.get(base, base.replace("_", " "))


def _in_short(finding: Finding) -> str:
    """Shorten a finding's sentence: no remarks in brackets, consequence or advice."""
    plain = re.sub(r" \([^()]*\)", "", finding.sentence)
    flight = re.match(r"[^:;]*\.[A-Za-z]\w*: ", plain)
    name = "" if flight is None else flight[0]
    met = re.split(r"(?<=.{20})(?:: |; )", plain.removeprefix(name), maxsplit=1)[0]
    covered = "cover" in plain.removeprefix(name + met)
    return f"{name}{met}{' (the intervals cover this)' if covered else ''}"


def _motor_lines(result: IdentificationResult) -> list[Line]:
    """Describe the motors: largest thrust, lag, imbalance."""
    shared = {n.name: n for n in (*result.derived, *result.parameters) if n.configuration is None}
    lag = next(
        (
            (title, number)
            for name, title in (("motor_lag", "motor lag"), ("motor_lag_total", "lag and delay"))
            if (number := shared.get(name)) is not None and known(number.value) is not None
        ),
        ("motor lag", None),
    )
    imbalance = _strong_and_weak(result)
    return [
        *_summary_lines(
            result,
            "full thrust, a motor",
            "g",
            1e3 / GRAVITY,
            _at_voltages(result, shared, "max_thrust"),
        ),
        *_summary_line(result, lag[0], "ms", 1e3, lag[1]),
        *_summary_line(
            result,
            "imbalance of motors",
            "%",
            100.0,
            shared.get("motor_imbalance"),
            remark=imbalance,
        ),
    ]


def _at_voltages(
    result: IdentificationResult, numbers: Mapping[str, Parameter | Derived], name: str
) -> list[tuple[str, Parameter | Derived]]:
    """List full thrust with the voltage at which it holds, and under full load."""
    if name not in numbers:
        return []
    voltage, loaded = (result.diagnostics.get(at) for at in (AT_COMMAND, UNDER_LOAD))
    listed: list[tuple[str, Parameter | Derived]] = [
        ("" if voltage is None else f"at {voltage:.3g} V", numbers[name])
    ]
    under_load = numbers.get(f"{name}_loaded")
    if loaded is not None and under_load is not None and under_load.value is not None:
        listed.append((f"under full load ({loaded:.3g} V)", under_load))
    return listed


def _strong_and_weak(result: IdentificationResult) -> str:
    """Name the motors with the most and the least thrust, where the difference is clear."""
    rotors = [p for p in result.parameters if p.name.startswith("kt_") and p.value]
    found = next((d for d in result.derived if d.name == "motor_imbalance"), None)
    if len(rotors) < 2 or found is None or found.interval is None or found.interval[0] <= 0.0:
        return ""
    rotors.sort(key=lambda p: p.value or 0.0)
    weak, strong = (p.name.removeprefix("kt_") for p in (rotors[0], rotors[-1]))
    return f"motor {strong} pulls most, {weak} least"


def _body_lines(
    result: IdentificationResult, configuration: str
) -> tuple[tuple[Line, ...], tuple[Line, ...]]:
    """Describe thrust against weight, and the place and inertia of the mass."""
    own = {d.name: d for d in result.derived if d.configuration == configuration}
    throttle, hover = own.get("hover_throttle"), own.get("hover_speed")
    if throttle is not None and throttle.value is None and hover is not None and hover.value:
        hovering = _summary_line(result, "hover speed", "rpm", 30.0 / pi, hover)
    else:
        hovering = _summary_line(result, "hover throttle", "%", 100.0, throttle)
    center = any(p.name == "rotor_center_x" for p in result.parameters)
    place = [_direct_number(own[name], DIRECTIONS[name]) for name in DIRECTIONS if name in own]
    off_center = [
        _direct_number(found, DIRECTIONS[axis])
        for axis in ("com_x", "com_y")
        if axis in own and (found := _from_rotors(result, own[axis])) is not None
    ]
    turns = [
        (word, own[name])
        for word, name in (("roll", "Ixx_com"), ("pitch", "Iyy_com"), ("yaw", "Izz_com"))
        if name in own
    ]
    power, unit = _power_of_ten([d for _, d in turns])
    return (
        (
            *hovering,
            *_summary_lines(
                result, "thrust to weight", "", 1.0, _at_voltages(result, own, "thrust_to_weight")
            ),
        ),
        (
            *_summary_lines(
                result, "centre of mass", "mm", 1e3, off_center, remark="from the rotors' centre"
            ),
            *_summary_lines(
                result,
                "the same" if off_center else "centre of mass",
                "mm",
                1e3,
                place,
                remark=f"from the {'IMU' if center else 'origin'}",
            ),
            *_summary_lines(result, "inertia", unit, 10.0**-power, turns),
        ),
    )


def _from_rotors(result: IdentificationResult, com: Derived) -> Derived | None:
    """Return a coordinate of the centre of mass from the rotors' centre, which a pilot balances."""
    axis, owner = com.name[-1], com.configuration
    center = next(
        (p for p in result.parameters if p.full_name == f"rotor_center_{axis}@{owner}"), None
    )
    names = list(result.covariance_names)
    pair = (f"ms{axis}@{owner}", f"rotor_center_{axis}@{owner}")
    if center is None or center.value is None or com.value is None or not {*pair} <= {*names}:
        return None
    if center.std is None or com.std is None:
        return None
    i, j = map(names.index, pair)
    own = result.covariance
    # Both are known far less well from the IMU than from one another.
    correlation = float(own[i, j] / sqrt(own[i, i] * own[j, j]))
    variance = com.std**2 + center.std**2 - 2.0 * correlation * com.std * center.std
    value, half = com.value - center.value, 1.96 * sqrt(max(variance, 0.0))
    doubtful = "doubtful" in (verdict_of(result, com), center.verdict)
    return replace(
        com,
        name=f"com_from_rotors_{axis}",
        value=value,
        std=half / 1.96,
        interval=(value - half, value + half),
        verdict="doubtful" if doubtful else "identified",
    )


def _direct_number(number: Derived, ways: tuple[str, str]) -> tuple[str, Derived]:
    value, interval = known(number.value), number.interval
    if value is None or value >= 0.0:
        return ways[0], number
    turned = None if interval is None else (-interval[1], -interval[0])
    return ways[1], replace(number, value=-value, interval=turned)


def _power_of_ten(numbers: Sequence[Derived]) -> tuple[int, str]:
    """Choose the power of ten that all inertia is written in, and its unit."""
    sizes = [abs(value) for d in numbers if (value := known(d.value))]
    power = floor(log10(max(sizes))) if sizes else 0
    unit = numbers[0].unit if numbers else ""
    return (power, f"1e{power} {unit}") if power < -1 else (0, unit)


def _summary_line(
    result: IdentificationResult,
    title: str,
    unit: str,
    factor: float,
    number: Parameter | Derived | None,
    *,
    remark: str = "",
) -> Iterator[Line]:
    numbers = [] if number is None else [("", number)]
    return _summary_lines(result, title, unit, factor, numbers, remark=remark)


def _summary_lines(
    result: IdentificationResult,
    title: str,
    unit: str,
    factor: float,
    numbers: Sequence[tuple[str, Parameter | Derived]],
    *,
    remark: str = "",
) -> Iterator[Line]:
    """Write numbers in one line; yield nothing if there are no numbers."""
    if not numbers:
        return
    parts = tuple(_scale_part(result, words, number, factor) for words, number in numbers)
    if all(part.value is None for part in parts):
        reasons = [number.reason for _, number in numbers if number.reason]
        why = reasons[0] if reasons else "these flights do not show it"
        parts, remark = (), f"not known: {why}"
    yield Line(title=title, unit=unit if parts else "", parts=parts, remark=remark)


def _scale_part(
    result: IdentificationResult, words: str, number: Parameter | Derived, factor: float
) -> Part:
    value, ends = known(number.value), number.interval
    return Part(
        words=words,
        value=None if value is None else factor * value,
        interval=None if ends is None else (factor * ends[0], factor * ends[1]),
        verdict=verdict_of(result, number),
    )
