"""Section 1: what was identified; one table for the rotors, and per configuration its body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rotorfit.formatting.digits import Number, finite_interval, known, number_of
from rotorfit.model.parameters import COM, INERTIA_COM
from rotorfit.model.terms.air import DRAG_MOMENTS
from rotorfit.report.number_words import title_of, unit_words
from rotorfit.report.svg import drawing, tag
from rotorfit.results.result import Derived, IdentificationResult, Parameter, configuration_names
from rotorfit.results.verdicts import ADVICE, body_verdict, motion_for, relative_width, twin_of

WIDTH, HEIGHT, MARGIN = 132.0, 18.0, 5.0

FAMILIES = (
    *("com_", "ms", "rotor_center_", "accel_bias_"),
    *("drag_", "turn_damping_", "torque_offset_"),
)


COM_FIRST = (*COM, *INERTIA_COM)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of a table; `source` is the number with all its digits, `ends` those of its bar."""

    source: Parameter | Derived
    name: str
    title: str
    number: Number | None
    unit: str
    bar: str | None
    ends: tuple[float, float] | None
    verdict: str
    partner: str | None
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """Why some verdicts are not better and what to do, once for all rows that share it."""

    mark: str
    names: tuple[str, ...]
    reason: str | None
    advice: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterTable:
    """A table with its notes."""

    title: str
    explanation: str
    rows: tuple[Row, ...]
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A number with its verdict, before it is laid out."""

    number: Parameter | Derived
    verdict: str
    partner: str | None = None
    reason: str | None = None
    advice: str | None = None


def parameter_tables(result: IdentificationResult) -> tuple[ParameterTable, ...]:
    """Tabulate rotors, then each body about its CoM, then at the origin."""
    tables = [
        _table(
            "Rotors",
            "What all rotors and configurations share.",
            [
                *[_of_parameter(p) for p in result.parameters if p.configuration is None],
                *_shared_derived(result),
            ],
        )
    ]
    for name in configuration_names(result):
        tables += _body_tables(result, name)
    return tuple(table for table in tables if table.rows)


def _body_tables(result: IdentificationResult, configuration: str) -> list[ParameterTable]:
    own = [p for p in result.parameters if p.configuration == configuration]
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    parameters = {p.name: p for p in own}
    about_com = [
        body_entry(derived[n], parameters.get(twin_of(n)), derived)
        for n in COM_FIRST
        if n in derived
    ]
    mass = [_of_parameter(p) for p in own if p.name == "mass"]
    # With one configuration the rotors' table has the ratios; with several they differ by body.
    elsewhere = _ROTOR_DERIVED if len(configuration_names(result)) == 1 else ()
    others = [
        Entry(number=d, verdict="")
        for d in derived.values()
        if d.name not in (*COM_FIRST, *elsewhere) and known(d.value) is not None
    ]
    body = f"Body, configuration {configuration}"
    return [
        _table(
            body, "Mass, centre of mass, inertia about the centre of mass.", [*mass, *about_com]
        ),
        _table(
            f"{body}: as the equations have it",
            "First moments and inertia at the body origin, and what belongs to the sensors.",
            [*[_of_parameter(p) for p in own if p.name != "mass"], *others],
        ),
    ]


_ROTOR_DERIVED = ("kd_over_Izz", "Jr_over_Izz", "hover_speed", "motor_lag_total")


def _shared_derived(result: IdentificationResult) -> list[Entry]:
    """Collect the derived numbers of the rotors; with one configuration its ratios too."""
    names = _ROTOR_DERIVED if len(configuration_names(result)) == 1 else ()
    return [
        Entry(number=d, verdict="")
        for d in result.derived
        if (d.configuration is None or d.name in names) and known(d.value) is not None
    ]


def _of_parameter(parameter: Parameter) -> Entry:
    return Entry(
        number=parameter,
        verdict=parameter.verdict,
        partner=parameter.partner,
        reason=parameter.reason,
        advice=parameter.advice,
    )


def body_entry(derived: Derived, twin: Parameter | None, kin: Mapping[str, Derived]) -> Entry:
    """Judge a derived number, and why; `kin` is all of its body, by name."""
    verdict = body_verdict(derived, twin, kin)
    if twin is None or verdict == "identified":
        return Entry(number=derived, verdict=verdict)
    reason, advice = twin.reason, twin.advice
    if verdict == "weak" != twin.verdict:
        reason = f"known only to +-{100.0 * (relative_width(derived, kin) or 0.0):.0f} %"
        advice = ADVICE[motion_for(derived.name)]
    return Entry(
        number=derived,
        verdict=verdict,
        partner=twin.partner if verdict == "ratio-only" else None,
        reason=reason,
        advice=advice,
    )


def _table(title: str, explanation: str, entries: Sequence[Entry]) -> ParameterTable:
    axes: dict[str, list[Parameter | Derived]] = {}
    for entry in entries:
        axes.setdefault(axis_of(entry.number.name), []).append(entry.number)
    notes = _notes(entries)
    marks = {name: note.mark for note in notes for name in note.names}
    return ParameterTable(
        title=title,
        explanation=explanation,
        rows=tuple(
            _row(e, axes[axis_of(e.number.name)], marks.get(e.number.name, "")) for e in entries
        ),
        notes=notes,
    )


def _row(entry: Entry, kin: Sequence[Parameter | Derived], mark: str) -> Row:
    number = entry.number
    ends = axis_range(kin)
    return Row(
        source=number,
        name=number.name,
        title=title_of(number.name),
        number=number_of(number.value, number.interval),
        unit=unit_words(number.unit),
        bar=interval_bar(number, ends, entry.verdict or "plain"),
        ends=ends,
        verdict=entry.verdict,
        partner=entry.partner,
        note=mark,
    )


def _notes(entries: Sequence[Entry]) -> tuple[Note, ...]:
    """Collect reasons and advice, each once, lettered in the order of the rows."""
    groups: dict[tuple[str | None, str | None], list[str]] = {}
    for entry in entries:
        if entry.reason or entry.advice:
            groups.setdefault((entry.reason, entry.advice), []).append(entry.number.name)
    return tuple(
        Note(
            mark=_letter(i),
            names=tuple(names),
            reason=None if reason is None else reason.replace("+-", "± "),
            advice=advice,
        )
        for i, ((reason, advice), names) in enumerate(groups.items())
    )


def _letter(index: int) -> str:
    return chr(ord("a") + index) if index < 26 else f"a{index - 25}"


def axis_of(name: str) -> str:
    """Name the axis that a number shares with its kin, so that sizes compare."""
    for family in FAMILIES:
        if name.startswith(family) and len(name) == len(family) + 1:
            return family
    if name in DRAG_MOMENTS:
        return "drag_moment_"
    if name.startswith("I") and len(name.removesuffix("_com")) == 3:
        return "I_com" if name.endswith("_com") else "I"
    return name


def axis_range(numbers: Sequence[Parameter | Derived]) -> tuple[float, float]:
    """Choose the ends of an axis that shows zero and every interval."""
    ends = [0.0]
    for number in numbers:
        value = known(number.value)
        if value is not None:
            ends += [value, *(finite_interval(number.interval) or ())]
    return min(ends), max(ends)


def interval_bar(
    number: Parameter | Derived, ends: tuple[float, float], verdict: str
) -> str | None:
    """Draw a thin line at zero, a bar over the interval, a dot at the value."""
    value = known(number.value)
    if value is None or ends[0] == ends[1]:
        return None
    low, high = finite_interval(number.interval) or (value, value)

    def place(x: float) -> float:
        return MARGIN + (x - ends[0]) / (ends[1] - ends[0]) * (WIDTH - 2 * MARGIN)

    middle = HEIGHT / 2
    left, right = place(low), place(high)
    return drawing(
        WIDTH,
        HEIGHT,
        {"class": f"interval {verdict}", "aria-hidden": "true"},
        tag("path", {"class": "track", "d": f"M{MARGIN} {middle}H{WIDTH - MARGIN}"}),
        tag("path", {"class": "zero", "d": f"M{place(0.0):.2f} 1V{HEIGHT - 1}"}),
        tag(
            "rect",
            {
                "class": "span",
                "x": min(left, place(value) - 0.75),
                "y": middle - 4,
                "width": max(right - left, 1.5),
                "height": 8.0,
                "rx": 1.5,
            },
        ),
        tag("circle", {"class": "value", "cx": place(value), "cy": middle, "r": 2.4}),
    )
