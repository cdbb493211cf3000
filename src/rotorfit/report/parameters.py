"""Section 1: what was identified; one table for the rotors, and per configuration its body."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rotorfit.report.intervals import axis_of, axis_range, interval_bar
from rotorfit.report.number_words import (
    Number,
    configurations,
    known,
    number_of,
    title_of,
    twin_of,
    unit_words,
)
from rotorfit.results.result import Derived, IdentificationResult, Parameter
from rotorfit.results.verdicts import ADVICE, WEAK, motion_for

COM_FIRST = (
    *("com_x", "com_y", "com_z"),
    *("Ixx_com", "Iyy_com", "Izz_com", "Ixy_com", "Ixz_com", "Iyz_com"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of a table."""

    name: str
    title: str
    number: Number | None
    unit: str
    bar: str | None
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
    """Return the tables: rotors, then each body about its CoM, then at the origin."""
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
    for name in configurations(result):
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
    elsewhere = _ROTOR_DERIVED if len(configurations(result)) == 1 else ()
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
    """Return the derived numbers of the rotors; with one configuration its ratios too."""
    names = _ROTOR_DERIVED if len(configurations(result)) == 1 else ()
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
    """Return a derived number with its verdict, and why; `kin` is all of its body, by name."""
    verdict = body_verdict(derived, twin, kin)
    if twin is None or verdict == "identified":
        return Entry(number=derived, verdict=verdict)
    reason, advice = twin.reason, twin.advice
    if verdict == "weak" != twin.verdict:
        reason = f"known only to +-{100.0 * (_relative(derived, kin) or 0.0):.0f} %"
        advice = ADVICE[motion_for(derived.name)]
    return Entry(
        number=derived,
        verdict=verdict,
        partner=twin.partner if verdict == "ratio-only" else None,
        reason=reason,
        advice=advice,
    )


def body_verdict(
    derived: Derived, twin: Parameter | None, kin: Mapping[str, Derived] | None = None
) -> str:
    """Return the verdict on a derived number: by its own interval, else its twin's.

    Inertia about the centre of mass can be sharp where that at the origin is not, and the other way
    round. `kin` is all of its body, by name: what products of inertia are measured by.
    """
    verdict = "" if twin is None else twin.verdict
    if known(derived.value) is None:
        return verdict if verdict in ("ratio-only", "removed") else "not-identified"
    relative = _relative(derived, kin or {})
    if relative is None or verdict == "given":
        return verdict if verdict in ("weak", "given") else "identified"
    if relative <= WEAK:
        return "identified"
    # Where a moment is not known, the estimate had a better idea of what matters than the value.
    measured = twin is not None and _size(derived, kin or {}) is None
    return "identified" if measured and verdict == "identified" else "weak"


def _relative(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return half of the interval of an inertia about the CoM over what its verdict goes by."""
    value, interval = known(derived.value), derived.interval
    if value is None or interval is None or not derived.name.endswith("_com"):
        return None
    size = max(abs(value), _size(derived, kin) or 0.0)
    return 0.5 * (interval[1] - interval[0]) / size if size else None


def _size(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return the size of an inertia that matters; None for a product without its two moments."""
    i, j = derived.name[1:3]
    if i == j:
        return 0.0
    found = [known(kin[n].value) for n in (f"I{i}{i}_com", f"I{j}{j}_com") if n in kin]
    moments = [abs(value) for value in found if value is not None]
    return math.sqrt(moments[0] * moments[1]) / 20.0 if len(moments) == 2 else None


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
    return Row(
        name=number.name,
        title=title_of(number.name),
        number=number_of(number.value, number.interval),
        unit=unit_words(number.unit),
        bar=interval_bar(number, axis_range(kin), entry.verdict or "plain"),
        verdict=entry.verdict,
        partner=entry.partner,
        note=mark,
    )


def _notes(entries: Sequence[Entry]) -> tuple[Note, ...]:
    """Return reasons and advice, each once, lettered in the order of the rows."""
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
