"""Numbers and verdicts in words, and their tables: section 1 of the page, and LaTeX for a paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.checks.verdicts.judge import body_advice, body_reason, body_verdict, twin_of
from rotorfit.digits import Number, finite_interval, known, number_of
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, INERTIA_COM, NUISANCE, OF_FLIGHT, TITLES, title_of
from rotorfit.model.terms.registry import TERMS
from rotorfit.report.pages import drawing, plus_minus, tag
from rotorfit.results.result import (
    Derived,
    IdentificationResult,
    Parameter,
    configuration_names,
    verdict_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

VERDICT_MEANING = {
    "identified": "known to +- 25 % or better; near zero, to a quarter of a size that matters "
    "(docs/method.md)",
    "weak": "known to worse than +- 25 %, or assumed from the other rotors (marked so)",
    "doubtful": "may be outside its interval: a check contradicts it, the reason is given",
    "ratio-only": "known only together with another parameter",
    "not-identified": "these flights do not determine it",
    "given": "given to rotorfit, not estimated",
    "removed": "taken out of the model as unessential",
}

PREDICTED_WELL = (
    "For comparison, a good model has up to 5 % for thrust (Fz) and up to 30 % for the moments "
    "(Mx roll, My pitch, Mz yaw)."
)
"""What relative errors on flights kept apart are worth."""
NOTHING_PREDICTED = (
    "At 100 % and over the model predicts nothing of that component: the rotors hardly moved it "
    "in this flight (validate on a livelier one), or the vehicle has changed or is another "
    "configuration (identify from both flights)."
)


def unit_words(unit: str) -> str:
    """Return a unit with raised powers; nothing for a plain number."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def half_width(number: Parameter | Derived) -> float | None:
    """Return half of the interval."""
    interval = finite_interval(number.interval)
    return None if interval is None else 0.5 * (interval[1] - interval[0])


def percent(number: Parameter | Derived) -> float | None:
    """Compute the half-width relative to the value [%]; silly where the value is near zero."""
    half, value = half_width(number), known(number.value)
    return None if half is None or not value else 100.0 * half / abs(value)


WIDTH, HEIGHT, MARGIN = 132.0, 18.0, 5.0

AXES: Final = {
    **{
        name: f"{term.name} [{info.unit}]"
        for term in TERMS
        if term.owner == "configuration"
        for name, info in term.parameters.items()
    },
    **dict.fromkeys(COM, "centre of mass"),
    **dict.fromkeys(INERTIA_COM, "inertia about the CoM"),
}
"""Of numbers that are drawn over one axis with their kin."""


COM_FIRST = (*COM, *INERTIA_COM)


@frozen_dataclass
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


@frozen_dataclass
class Note:
    """Why some verdicts are not better and what to do, once for all rows that share it."""

    mark: str
    names: tuple[str, ...]
    reason: str | None
    advice: str | None


@frozen_dataclass
class ParameterTable:
    """A table with its notes."""

    title: str
    explanation: str
    rows: tuple[Row, ...]
    notes: tuple[Note, ...]


@frozen_dataclass
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
        _make_table(
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
        Entry(number=d, verdict=d.verdict or "", reason=d.reason)
        for d in derived.values()
        if d.name not in (*COM_FIRST, *elsewhere) and known(d.value) is not None
    ]
    body = f"Body, configuration {configuration}"
    return [
        _make_table(
            body, "Mass, centre of mass, inertia about the centre of mass.", [*mass, *about_com]
        ),
        _make_table(
            f"{body}: as the equations have it",
            "First moments and inertia at the body origin, and what belongs to the sensors.",
            [*[_of_parameter(p) for p in own if p.name != "mass"], *others],
        ),
    ]


_ROTOR_DERIVED = ("kd_over_Izz", "Jr_over_Izz", "hover_speed", "motor_lag_total", *OF_FLIGHT)


def _shared_derived(result: IdentificationResult) -> list[Entry]:
    """Collect the derived numbers of the rotors; with one configuration its ratios too."""
    names = _ROTOR_DERIVED if len(configuration_names(result)) == 1 else ()
    return [
        Entry(number=d, verdict=d.verdict or "", reason=d.reason)
        for d in result.derived
        if (d.configuration is None or d.name in names) and known(d.value) is not None
    ]


def _of_parameter(parameter: Parameter) -> Entry:
    return Entry(
        number=parameter,
        verdict=parameter.verdict,
        partner=parameter.partner,
        reason=parameter.reason,
        # Nobody flies for a sensor's numbers.
        advice=None if parameter.name in NUISANCE else parameter.advice,
    )


def body_entry(derived: Derived, twin: Parameter | None, kin: Mapping[str, Derived]) -> Entry:
    """Judge a derived number, and why; `kin` is all of its body, by name."""
    verdict = body_verdict(derived, twin, kin)
    if twin is None or verdict == "identified":
        return Entry(number=derived, verdict=verdict)
    return Entry(
        number=derived,
        verdict=verdict,
        partner=twin.partner if verdict == "ratio-only" else None,
        reason=body_reason(derived, verdict, twin, kin),
        advice=body_advice(derived.name, verdict, twin),
    )


def _make_table(title: str, explanation: str, entries: Sequence[Entry]) -> ParameterTable:
    axes: dict[str, list[Parameter | Derived]] = {}
    for entry in entries:
        axes.setdefault(axis_of(entry.number.name), []).append(entry.number)
    notes = _collect_notes(entries)
    marks = {name: note.mark for note in notes for name in note.names}
    return ParameterTable(
        title=title,
        explanation=explanation,
        rows=tuple(
            _make_row(e, axes[axis_of(e.number.name)], marks.get(e.number.name, ""))
            for e in entries
        ),
        notes=notes,
    )


def _make_row(entry: Entry, kin: Sequence[Parameter | Derived], mark: str) -> Row:
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


def _collect_notes(entries: Sequence[Entry]) -> tuple[Note, ...]:
    """Collect reasons and advice, each once, lettered in the order of the rows."""
    groups: dict[tuple[str | None, str | None], list[str]] = {}
    for entry in entries:
        if entry.reason or entry.advice:
            groups.setdefault((entry.reason, entry.advice), []).append(entry.number.name)
    return tuple(
        Note(
            mark=_note_letter(i),
            names=tuple(names),
            reason=None if reason is None else plus_minus(reason),
            advice=advice,
        )
        for i, ((reason, advice), names) in enumerate(groups.items())
    )


def _note_letter(index: int) -> str:
    return chr(ord("a") + index) if index < 26 else f"a{index - 25}"


def axis_of(name: str) -> str:
    """Name the axis that a number shares with its kin, so that sizes compare."""
    return AXES.get(name, name)


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


ROTORS: Final = ("kt", "kd", "Jr", "motor_lag", "motor_lag_up", "motor_lag_down", "motor_delay")
SYMBOLS: Final = {
    "kt": "k_t",
    "kd": "k_d",
    "Jr": "J_r",
    "motor_lag": r"\tau",
    "motor_lag_up": r"\tau_\uparrow",
    "motor_lag_down": r"\tau_\downarrow",
    "motor_delay": "T",
    "mass": "m",
    **{f"com_{a}": f"c_{a}" for a in "xyz"},
    **{f"I{a}{b}_com": f"I_{{{a}{b}}}" for a in "xyz" for b in "xyz"},
}
MARKS: Final = {"weak": r"$^{w}$", "doubtful": r"$^{d}$", "given": r"$^{g}$"}


def latex_table(result: IdentificationResult) -> str:
    r"""Format a result as a LaTeX table for a paper; it needs the package booktabs.

    One column a configuration; rotors first, then mass, centre of mass and the inertia about it.
    What the flights do not determine is a dash; weak, doubtful and given ones are marked.

    Parameters
    ----------
    result
        What `identify` returned, or `IdentificationResult.load`.
    """
    owners = configuration_names(result)
    found = {(e.name, e.configuration): e for e in (*result.parameters, *result.derived)}
    verdicts = {(n, o): verdict_of(result, e) for (n, o), e in found.items()}
    rows: list[str] = []
    for name in (*ROTORS, "mass", *COM_FIRST):
        own = [None] if name in ROTORS else owners
        entries = [found.get((name, owner)) for owner in own]
        if not any(entries):
            continue
        cells = [
            _latex_cell(e, verdicts.get((name, o), "")) for e, o in zip(entries, own, strict=True)
        ]
        if own == [None]:
            cells = [rf"\multicolumn{{{len(owners)}}}{{c}}{{{cells[0]}}}"]
        unit = next(e.unit for e in entries if e is not None)
        title = TITLES.get(name, name)
        rows.append(rf"{title} & ${SYMBOLS[name]}$ & {' & '.join(cells)} & {_latex_unit(unit)} \\")
    heads = " & ".join(_escape_latex(name) for name in owners)
    return (
        "\\begin{table}\n\\centering\n"
        + rf"\caption{{{_table_caption(result)}}}"
        + f"\n\\begin{{tabular}}{{ll{'r' * len(owners)}l}}\n\\toprule\n"
        + rf"Parameter & Symbol & {heads} & Unit \\"
        + "\n\\midrule\n"
        + "\n".join(rows)
        + "\n\\bottomrule\n\\end{tabular}\n\\end{table}\n"
    )


def _table_caption(result: IdentificationResult) -> str:
    seconds = sum(flight.seconds_used for flight in result.flights)
    count = len(result.flights)
    return (
        f"{_escape_latex(result.name)}: identified from {count} flight{'' if count == 1 else 's'}, "
        f"{seconds:.0f} s in the air; $\\pm$ is half of the 95\\,\\% interval; "
        "$^{w}$ weak, $^{d}$ doubtful, $^{g}$ given; --: not determined."
    )


def _latex_cell(entry: Parameter | Derived | None, verdict: str) -> str:
    number = None if entry is None else number_of(entry.value, entry.interval)
    return "--" if number is None else f"${_latex_digits(number)}${MARKS.get(verdict, '')}"


def _latex_digits(number: Number) -> str:
    body = number.value
    if number.low:
        body += f"\\ ({number.low}\\ \\text{{to}}\\ {number.high})"
    elif number.half:
        body += f" \\pm {number.half}"
    if number.exponent:
        body = f"({body})" if number.half else body
        body += f" \\times 10^{{{number.exponent}}}"
    return body.replace("−", "-")


def _latex_unit(unit: str) -> str:
    """Write a unit upright, powers raised: ``N s^2/rad^2``."""
    plain = "" if unit == "1" else unit
    return f"$\\mathrm{{{plain.replace(' ', chr(92) + ',')}}}$" if plain else ""


def _escape_latex(words: str) -> str:
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, f"\\{c}" if c in "&%$#_{}" else c) for c in words)
