"""A result on one screen: what is known, how well, and what to do about the rest."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

from rotorfit.checks.verdicts.judge import WEAK, twin_of
from rotorfit.digits import known, short, with_interval
from rotorfit.logs.files import file_name
from rotorfit.model.parameters import NUISANCE, OF_FLIGHT
from rotorfit.model.terms.air import DRAG_MOMENTS
from rotorfit.report.law_words import formula_of, law_sentences, motors_lines
from rotorfit.report.parameters import COM_FIRST, VERDICT_MEANING, Entry, body_entry, percent
from rotorfit.results.result import (
    Derived,
    IdentificationResult,
    Parameter,
    configuration_names,
    verdict_of,
)
from rotorfit.sheet import table_lines, wrapped
from rotorfit.tools.planning.next_step import next_step

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Mapping

ROTOR_DERIVED = (
    *("motor_lag_total", "kd_over_kt", "kd_over_Izz", "Jr_over_Izz", "hover_speed"),
    *OF_FLIGHT,
)
DOUBTFUL = ("weak", "doubtful", "ratio-only", "not-identified", "removed")
"""Verdicts that need a word of explanation, and mostly of advice."""
WIDTH = 100
MOST_NAMED = 3
"""Flights of which one note is true."""
UNEXPLAINED = "Validation flights: prediction error"

Line = tuple[Parameter | Derived, str]
"""A number with the words that follow its unit."""


def result_text(result: IdentificationResult, *, width: int = WIDTH) -> str:
    """Format a result as text for a terminal: every number with unit, interval and verdict.

    Parameters
    ----------
    result
        What `identify` returned, or `IdentificationResult.load`.
    width
        Of a line [characters]; tables are as wide as their numbers.
    """
    sections = [
        textwrap.wrap(_result_title(result), width),
        _table_of_entries("Rotors", _rotor_lines(result), width),
        _law_lines(result, width),
        *(
            _table_of_entries(f"Body, configuration {name}", _body_lines(result, name), width)
            for name in configuration_names(result)
        ),
        _list_texts(UNEXPLAINED, map(_validation_line, result.validation), width),
        _list_texts("What the verdicts mean", _verdict_meanings(result), width),
        _list_texts("What the weak and missing numbers need", advice_of(result), width),
        _list_texts("To know", warnings_of(result), width),
        _list_texts(
            "No flight can check these: make sure that they are right",
            assumptions_of(result),
            width,
        ),
        wrapped(next_step(result).sentence, width, "Next step: "),
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines) + "\n"


def flights_in_words(result: IdentificationResult) -> str:
    """Name the result, and state how much was flown for it."""
    seconds = sum(flight.seconds_used for flight in result.flights)
    count = len(result.flights)
    flights = "1 flight" if count == 1 else f"{count} flights"
    return f"{result.name}: {flights}, {seconds:.1f} s in the air"


def _result_title(result: IdentificationResult) -> str:
    return f"{flights_in_words(result)}, method {result.method}; +- is half of the 95 % interval"


def _rotor_lines(result: IdentificationResult) -> list[Line]:
    shared = [p for p in result.parameters if p.configuration is None]
    # Numbers of one configuration stand with the rotors where there is no other.
    own = {None, *configuration_names(result)} if len(configuration_names(result)) < 2 else {None}
    return [*map(_of_parameter, shared), *_rotor_derived(result, own)]


def _law_lines(result: IdentificationResult, width: int) -> list[str]:
    """Write the motors' law with its numbers, and what flights without speeds need of it."""
    law = result.command_law
    if law is None:
        return []
    rows = [
        f"  {n.name:<16} {with_interval(n.value, n.interval):>23}  {n.unit.removeprefix('1')}"
        for n in law.numbers
    ]
    motors = motors_lines(law)
    paste = [f"      {line}" for line in motors]
    return [
        f"Motors, u being the command: {formula_of(law)}",
        *(row.rstrip() for row in rows),
        *(line for words in law_sentences(law) for line in wrapped(words, width, "  - ")),
        *(["  - for flights of this vehicle without rotor speed:", *paste] if motors else []),
    ]


def _rotor_derived(result: IdentificationResult, owners: Container[str | None]) -> list[Line]:
    return [
        (d, verdict_of(result, d))
        for d in result.derived
        if d.name in ROTOR_DERIVED and d.configuration in owners and known(d.value) is not None
    ]


def _body_lines(result: IdentificationResult, configuration: str) -> list[Line]:
    """Select the mass, what is about the CoM, and what has no number about the CoM."""
    parameters = {p.name: p for p in result.parameters if p.configuration == configuration}
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    about_com = [derived[name] for name in COM_FIRST if name in derived]
    twins = {twin_of(d.name) for d in about_com}
    others = [p for name, p in parameters.items() if name not in {"mass", *twins, *DRAG_MOMENTS}]
    several = len(configuration_names(result)) > 1
    return [
        *(_of_parameter(p) for name, p in parameters.items() if name == "mass"),
        *(
            (d, _verdict_text(body_entry(d, parameters.get(twin_of(d.name)), derived)))
            for d in about_com
        ),
        *map(_of_parameter, others),
        *(_rotor_derived(result, {configuration}) if several else []),
    ]


def _of_parameter(parameter: Parameter) -> Line:
    verdict = _verdict_text(parameter)
    # Weak by another rule than the width of its interval, which is seen beside it.
    width = percent(parameter)
    narrow = width is not None and width <= 100.0 * WEAK
    own = parameter.verdict == "weak" and narrow and parameter.name.startswith("kt_")
    return parameter, f"{verdict} (mostly assumed)" if own else verdict


def _judge_entries(result: IdentificationResult) -> list[Entry]:
    """Judge every parameter as the tables show it: itself, or its like about the CoM."""
    about_com = {
        (twin_of(d.name), d.configuration): d for d in result.derived if d.name in COM_FIRST
    }
    entries: list[Entry] = []
    for p in result.parameters:
        if p.name in DRAG_MOMENTS:
            continue  # six more lines, of numbers that only keep the others right
        shown = about_com.get((p.name, p.configuration))
        if shown is None:
            entry = Entry(number=p, verdict=p.verdict, reason=p.reason, advice=p.advice)
        else:
            kin = {d.name: d for d in result.derived if d.configuration == p.configuration}
            entry = body_entry(shown, p, kin)
        entries.append(entry)
    return entries


def _verdict_text(of: Parameter | Entry) -> str:
    with_partner = of.verdict == "ratio-only" and of.partner
    return f"{of.verdict} with {of.partner}" if with_partner else of.verdict


def _table_of_entries(title: str, lines: list[Line], width: int) -> list[str]:
    """Align numbers, units and verdicts in columns, on one line where the width allows it."""
    if not lines:
        return []
    units = ["" if number.unit == "1" else number.unit for number, _ in lines]
    names = max(15, *(len(number.name) for number, _ in lines))
    room = max(14, *map(len, units))
    values = [with_interval(number.value, number.interval) for number, _ in lines]
    room_left = width - names - room - max(len(words) for _, words in lines) - 6
    digits = max(min(room_left, 24), *map(len, values))
    rows = [
        (
            f"  {number.name:<{names}}",
            f"{value:>{digits}} ",
            f"{unit:<{room}}",
            words,
        )
        for (number, words), value, unit in zip(lines, values, units, strict=True)
    ]
    return [title, *table_lines(rows, width)]


def _validation_line(row: Mapping[str, Any]) -> str:
    errors: Mapping[str, float | None] = row.get("relative_error", {})
    shown = ", ".join(f"{k} {short(100.0 * v)} %" for k, v in errors.items() if v is not None)
    return f"{file_name(str(row.get('flight', '')))} ({row.get('configuration')}): {shown}"


def _verdict_meanings(result: IdentificationResult) -> list[str]:
    met = {entry.verdict for entry in _judge_entries(result)}
    return [f"{verdict}: {VERDICT_MEANING[verdict]}" for verdict in DOUBTFUL if verdict in met]


def advice_of(result: IdentificationResult) -> list[str]:
    """Collect each advice once, after its numbers and what is wrong with them."""
    groups: dict[str, dict[str, list[str]]] = {}
    for entry in _judge_entries(result):
        if entry.advice is None or entry.verdict not in DOUBTFUL or entry.number.name in NUISANCE:
            continue
        names = groups.setdefault(entry.advice, {}).setdefault(_what_is_wrong(entry), [])
        name = entry.number.name
        names += [name] if name not in names else []
    return [
        "; ".join(f"{', '.join(names)} ({wrong})" for wrong, names in group.items()) + f": {advice}"
        for advice, group in groups.items()
    ]


def _what_is_wrong(entry: Entry) -> str:
    # How wide a weak interval is, is seen in the table.
    return entry.verdict if entry.verdict == "weak" else entry.reason or "-"


def warnings_of(result: IdentificationResult) -> list[str]:
    """Collect the warnings of the result and its flights, without advice already given."""
    doubts = [*result.warnings, *flight_notes(result)]
    for parameter in result.parameters:
        if parameter.advice:
            doubts = [doubt.replace(f"; {parameter.advice}", "") for doubt in doubts]
    return list(dict.fromkeys(doubts))


def flight_notes(result: IdentificationResult) -> list[str]:
    """Collect what is to be known of single flights; the same of several is one line."""
    flights: dict[str, list[str]] = {}
    for flight in result.flights:
        for words in dict.fromkeys(flight.warnings):
            flights.setdefault(words, []).append(file_name(flight.file))
    return [
        f"{names[0]}: {words}"
        if len(names) == 1
        else f"{len(names)} of {len(result.flights)} flights ({_first_names(names)}): {words}"
        for words, names in flights.items()
    ]


def _first_names(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"


def assumptions_of(result: IdentificationResult) -> list[str]:
    """Collect the quantities that the numbers of a result are proportional to."""
    used = result.settings.get("used", {})
    return [str(words) for words in used.get("hangs_on", ())]


def _list_texts(title: str, texts: Iterable[str], width: int) -> list[str]:
    lines = [line for text in texts for line in wrapped(text, width, "  - ")]
    return [title, *lines] if lines else []
