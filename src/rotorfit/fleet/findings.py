"""What changed in a fleet and who stands apart, in sentences: what was met, and what to check.

Changes that one cause explains are one finding: a propeller that wears is seen in its own thrust
coefficient, in that of all rotors, and in where their thrust acts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal

import numpy as np

from rotorfit.fleet.compared import IN_METRES, ROTORS, THRUST
from rotorfit.fleet.population.changes import NORMAL_95, Change
from rotorfit.fleet.records import KT_WEIGHT, TRIM, FlightRecord
from rotorfit.fleet.statistics import FleetStatistics, LoadingDifference, NumberStatistics
from rotorfit.logs.files import file_name
from rotorfit.report.number_words import TITLES, title_of

Sort = Literal["change", "apart", "loading"]

SLACK: Final = 3
"""Flights by which the beginnings of two changes of one cause may differ: not all numbers are
equally sharp."""
MOST_NAMED: Final = 4
"""Numbers named in one sentence; the others are counted."""
WORDS: Final = {
    KT_WEIGHT: "thrust coefficient of all rotors",
    "kt": "thrust coefficient of all rotors",
    "kd": "drag torque coefficient",
    "Jr": "rotor inertia",
    "motor_lag": "motor lag",
    TRIM[0]: "centre of thrust, forward",
    TRIM[1]: "centre of thrust, to the left",
}
AHEAD: Final = {
    "com_x": ("forward", "back"),
    TRIM[0]: ("forward", "back"),
    "com_y": ("to the left", "to the right"),
    TRIM[1]: ("to the left", "to the right"),
    "com_z": ("up", "down"),
}
BATTERY: Final = "check where battery and payload sit"
WEATHER: Final = (
    "weather and height are in it, as not every log tells the density of the air: see whether "
    "other vehicles changed on the same day"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """One number of a finding: which, where among its vehicles, and its change, if it is one."""

    number: NumberStatistics
    place: int
    change: Change | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing to look at.

    Attributes
    ----------
    sort, vehicle
        A change over time, a vehicle unlike the others, or what a loading does to a vehicle; the
        index of the vehicle.
    sentence, advice
        What was met; what to check.
    numbers
        In which it was seen, the one that names the cause first.
    record
        The first flight concerned, by the index of its record; None: all of them.
    """

    sort: Sort
    vehicle: int
    sentence: str
    advice: str
    numbers: tuple[Said, ...]
    record: int | None = None


def findings(statistics: FleetStatistics, records: Sequence[FlightRecord]) -> list[Finding]:
    """Return everything to look at, vehicle by vehicle."""
    out: list[Finding] = []
    for vehicle in range(len(statistics.vehicles)):
        out += _changes(statistics, vehicle, records)
        unlike = _unlike(statistics, vehicle)
        out += [unlike] if unlike is not None else []
        out += _loadings(statistics, vehicle)
    return out


def number_words(name: str) -> str:
    """Return a number's name within a sentence."""
    if name in WORDS:
        return WORDS[name]
    title = title_of(name) if name not in TITLES else TITLES[name]
    return title[0].lower() + title[1:]


def flight_words(records: Sequence[FlightRecord], own: Sequence[int], record: int) -> str:
    """Return which flight of a vehicle: its number, its day where the log tells it, its file.

    Parameters
    ----------
    records
        Of the fleet.
    own
        The vehicle's records in order of time.
    record
        The one that is meant.
    """
    it = records[record]
    day = "" if it.started is None else f", {day_words(it.started)}"
    return f"flight {list(own).index(record) + 1} of {len(own)} ({file_name(it.file)}{day})"


def day_words(seconds: float) -> str:
    """Return a day in words."""
    moment = datetime.fromtimestamp(seconds, UTC)
    return f"{moment.day} {moment:%B %Y}"


def size_words(name: str, size: float, low: float, high: float, reference: float) -> str:
    """Return how much larger a number is, with its interval: percent, or millimetres and where."""
    if name in IN_METRES:
        places = 1 if max(abs(low), abs(high)) >= 1e-3 else 2
        ends = (
            sorted((abs(1e3 * low), abs(1e3 * high))) if low * high > 0 else (1e3 * low, 1e3 * high)
        )
        way = AHEAD[name][0 if size >= 0 else 1]
        return (
            f"{abs(1e3 * size):.{places}f} mm {way} ({ends[0]:.{places}f} to {ends[1]:.{places}f})"
        )
    unit = 100.0 / abs(reference)
    ends = (
        sorted((abs(unit * low), abs(unit * high))) if low * high > 0 else (unit * low, unit * high)
    )
    places = 0 if abs(unit * size) >= 9.5 else 1 if abs(unit * size) >= 0.3 else 2
    return f"{abs(unit * size):.{places}f} % ({ends[0]:.{places}f} to {ends[1]:.{places}f})"


def _changes(
    statistics: FleetStatistics, vehicle: int, records: Sequence[FlightRecord]
) -> list[Finding]:
    """Return what changed in a vehicle: each cause once."""
    seen = [
        Said(number=number, place=place, change=change)
        for number in statistics.numbers
        if vehicle in number.vehicles
        for place in [number.vehicles.index(vehicle)]
        for change in number.changes[place]
    ]
    own = own_records(statistics, vehicle)
    seen.sort(key=lambda s: (_rank(s.number.name), _chance(s)))
    out: list[Finding] = []
    while seen:
        lead = seen[0]
        mine = [s for s in seen if s is lead or _same_cause(lead, s, own)]
        seen = [s for s in seen if all(s is not one for one in mine)]
        out.append(_changed(mine, vehicle, own, records))
    return sorted(out, key=lambda finding: _chance(finding.numbers[0]))


def _chance(said: Said) -> float:
    return said.change.p if said.change is not None else 1.0


def own_records(statistics: FleetStatistics, vehicle: int) -> list[int]:
    """Return a vehicle's records that tell anything, in order of time."""
    found: dict[int, None] = {}
    for number in sorted(statistics.numbers, key=lambda n: -len(n.rows)):
        if vehicle in number.vehicles:
            rows = number.rows_of(number.vehicles.index(vehicle)).tolist()
            if not found:
                found = dict.fromkeys(rows)
            found |= dict.fromkeys(rows)
    return list(found)


def _rank(name: str) -> int:
    """Return how well a number names a cause: 0 best."""
    ranks = (ROTORS, ("com_x", "com_y"), TRIM[:2], THRUST)
    return next((i for i, names in enumerate(ranks) if name in names), len(ranks))


def _same_cause(lead: Said, other: Said, own: Sequence[int]) -> bool:
    """Whether what another number shows is explained by what a first one does."""
    a, b = lead.change, other.change
    assert a is not None
    assert b is not None
    if lead.number is other.number:
        return True
    if other.number.name in ROTORS or (a.kind == "once") != (b.kind == "once"):
        return False
    first = [[own.index(i) for i in _ends(s)] for s in (lead, other)]
    return first[0][0] - SLACK <= first[1][1] and first[1][0] - SLACK <= first[0][1]


def _ends(said: Said) -> tuple[int, int]:
    """Return the records between which a change began."""
    change, rows = said.change, said.number.rows_of(said.place)
    assert change is not None
    return int(rows[change.earliest]), int(rows[change.latest])


def _changed(
    seen: Sequence[Said], vehicle: int, own: Sequence[int], records: Sequence[FlightRecord]
) -> Finding:
    """Return one cause in words."""
    lead = seen[0]
    assert lead.change is not None
    record = int(lead.number.rows_of(lead.place)[lead.change.first])
    others = list(dict.fromkeys(s.number.name for s in seen[1:]) - {lead.number.name: None}.keys())
    also = f" Also: {_listed([number_words(name) for name in others])}." if others else ""
    return Finding(
        sort="change",
        vehicle=vehicle,
        sentence=f"{change_words(lead, own, records)}.{also}",
        advice=_advice(lead),
        numbers=tuple(seen),
        record=record,
    )


def change_words(said: Said, own: Sequence[int], records: Sequence[FlightRecord]) -> str:
    """Return what happened to a number, and when."""
    change, number = said.change, said.number
    assert change is not None
    rows = number.rows_of(said.place)
    subject = _subject(number.name)
    level = number.own[said.place]
    size = size_words(number.name, change.size, change.low, change.high, level)
    when = flight_words(records, own, int(rows[change.first]))
    ends = [list(own).index(int(rows[i])) + 1 for i in (change.earliest, change.latest)]
    between = "" if ends[0] == ends[1] else f", at the earliest {ends[0]}, at the latest {ends[1]}"
    moves = number.name in IN_METRES
    fell = change.size < 0.0
    if change.kind == "once":
        how = f"was {size}" if moves else f"was {size} {'lower' if fell else 'higher'}"
        return f"{subject} {how} in {when} alone"
    if change.kind == "step":
        how = f"moved {size}" if moves else f"{'fell' if fell else 'rose'} by {size}"
        return f"{subject} {how} with {when}{between}"
    total = size_words(number.name, change.total, change.total, change.total, level).split(" (")[0]
    how = f"moves {size}" if moves else f"{'falls' if fell else 'rises'} by {size}"
    return f"{subject} {how} a flight since {when}{between}: {total} by now"


def _subject(name: str) -> str:
    """Return a number's name at the beginning of a sentence; without a direction, which follows."""
    words = number_words(name).split(",")[0] if name in IN_METRES else number_words(name)
    return words[0].upper() + words[1:]


def _advice(said: Said) -> str:
    """Return what to check where a number changed."""
    name, change = said.number.name, said.change
    assert change is not None
    weather = f" ({WEATHER})" if said.number.weather == "in it" else ""
    if change.kind == "once":
        return (
            "see how it was loaded and flown on that flight, and the doubts in its own report: "
            "another payload or battery?" + weather
        )
    if name in ROTORS:
        i = name.removeprefix("kt_")
        return f"check or replace propeller {i}; if it is sound, check motor {i} and its bearing"
    if name in THRUST:
        return "check all propellers, and that the vehicle still weighs what was given" + weather
    return _what_to_check(name) + weather


def _what_to_check(name: str) -> str:
    if name in IN_METRES:
        return BATTERY
    if name.endswith("_com"):
        return "check what is mounted, and where: battery, payload, arms"
    if name == "motor_lag":
        return "check motors and propellers, and the settings of the speed controllers"
    return "check propellers and motors: shape, damage, dirt"


def _unlike(statistics: FleetStatistics, vehicle: int) -> Finding | None:
    """Return in what a vehicle stands apart from the others; None where it does not."""
    seen = [
        Said(number=number, place=place)
        for number in statistics.numbers
        if vehicle in number.vehicles
        for place in [number.vehicles.index(vehicle)]
        if number.apart[place]
    ]
    if not seen:
        return None
    seen.sort(key=lambda s: s.number.p[s.place])
    names = [s.number.name for s in seen]
    shown = [_difference_words(s) for s in seen[:MOST_NAMED]]
    more = len(seen) - len(shown)
    also = f"; {more} more number{'s' if more > 1 else ''}" if more else ""
    return Finding(
        sort="apart",
        vehicle=vehicle,
        sentence=f"Unlike the other vehicles: {'; '.join(shown)}{also}.",
        advice=_difference_advice(names),
        numbers=tuple(seen),
    )


def _difference_words(said: Said) -> str:
    number, place = said.number, said.place
    size, std = float(number.difference[place]), float(number.difference_std[place])
    # The spread between vehicles decides whether it stands apart; how far, it does not blur.
    half = NORMAL_95 * float(np.hypot(number.own_std[place], number.mean_std))
    half = half if np.isfinite(half) else NORMAL_95 * std
    words = size_words(number.name, size, size - half, size + half, number.mean)
    if number.name in IN_METRES:
        return f"{_subject(number.name)[0].lower()}{_subject(number.name)[1:]} {words}"
    return f"{number_words(number.name)} {'smaller' if size < 0 else 'larger'} by {words}"


def _difference_advice(names: Sequence[str]) -> str:
    """Return what to check of a vehicle that differs in these numbers."""
    rotors = [name for name in names if name in ROTORS]
    if len(rotors) == 1 and not set(names) & {"kd", "Jr"}:
        i = rotors[0].removeprefix("kt_")
        return f"compare propeller {i} and motor {i} with those of the other vehicles"
    if set(names) & {*ROTORS, *THRUST, "kd", "Jr", "kd_over_kt", "kd_over_Izz"}:
        return (
            "another propeller? Compare its propellers (size, pitch, make) and motors with those "
            "of the other vehicles, and weigh it"
        )
    return _what_to_check(names[0])


def _loadings(statistics: FleetStatistics, vehicle: int) -> list[Finding]:
    """Return in what each loading of a vehicle differs from its most flown one."""
    mine = [d for d in statistics.loadings if d.vehicle == vehicle]
    mine.sort(key=lambda d: d.p)
    return [
        _loaded([d for d in mine if d.number.configuration == configuration])
        for configuration in dict.fromkeys(d.number.configuration for d in mine)
    ]


def _loaded(seen: Sequence[LoadingDifference]) -> Finding:
    """Return what one loading does, in words."""
    configuration, against = seen[0].number.configuration, seen[0].against
    return Finding(
        sort="loading",
        vehicle=seen[0].vehicle,
        sentence=f"Loaded as {configuration}, against {against}: "
        f"{_listed([_loading_words(d) for d in seen])}.",
        advice=f"nothing, if {configuration} carries what explains it; else check the load, and "
        "which flights are listed under which configuration",
        numbers=tuple(
            Said(number=d.number, place=d.number.vehicles.index(d.vehicle)) for d in seen
        ),
    )


def _loading_words(d: LoadingDifference) -> str:
    name = d.number.name
    words = size_words(name, d.difference, d.low, d.high, d.reference)
    subject = number_words(name)
    if name in IN_METRES:
        return f"{subject.split(',')[0]} {words}"
    return f"{subject} {'smaller' if d.difference < 0 else 'larger'} by {words}"


def _listed(words: Sequence[str]) -> str:
    """Return words as a list, the last ones counted."""
    shown = list(words[:MOST_NAMED])
    more = len(words) - len(shown)
    return "; ".join([*shown, f"{more} more"] if more else shown)
