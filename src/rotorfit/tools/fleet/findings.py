"""Findings of a fleet: changes and outlying vehicles, with what to check.

Changes that one cause explains are one finding: a propeller that wears is seen in its own thrust
coefficient, in that of all rotors, and in where their thrust acts.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Evidence, Finding
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name
from rotorfit.model.parameters import TITLES, title_of
from rotorfit.tools.fleet.changes import LEAST_SERIES, NORMAL_95, Change
from rotorfit.tools.fleet.compared import IN_METRES, ROTORS, THRUST
from rotorfit.tools.fleet.random_effects import LEAST_GROUPS
from rotorfit.tools.fleet.records import KT_WEIGHT, TRIM, FlightRecord

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.tools.fleet.statistics import FleetStatistics, LoadingDifference, NumberStatistics

CHANGE: Final = "change"
OUTLIER: Final = "apart"
LOADING: Final = "loading"
"""Kinds of findings: a change over time, a vehicle unlike the others, the effect of a loading."""
RANKS: Final = (ROTORS, ("com_x", "com_y"), TRIM[:2], THRUST)
"""Numbers by how well they name a cause, the best first."""
SLACK: Final = 3
"""Flights by which the beginnings of two changes of one cause may differ: not all numbers are
equally sharp."""
MOST_NAMED: Final = 4
"""Numbers named in one sentence; the others are counted."""
PHRASES: Final = {
    KT_WEIGHT: "thrust coefficient of all rotors",
    "kt": "thrust coefficient of all rotors",
    "kd": "drag torque coefficient",
    "Jr": "rotor inertia",
    "motor_lag": "motor lag",
    TRIM[0]: "centre of thrust, forward",
    TRIM[1]: "centre of thrust, to the left",
}
DIRECTIONS: Final = {
    "com_x": ("forward", "back"),
    TRIM[0]: ("forward", "back"),
    "com_y": ("to the left", "to the right"),
    TRIM[1]: ("to the left", "to the right"),
    "com_z": ("up", "down"),
}
CHECK_BALANCE: Final = "check where battery and payload sit"
WEATHER: Final = (
    "it includes weather and altitude, as not every log has the air's density: see whether "
    "other vehicles changed on the same day"
)


@frozen_dataclass
class VehicleFinding(Finding):
    """A finding about one vehicle of a fleet.

    - `vehicle`: index into the fleet's vehicles.
    - `record`: the first flight concerned, by the index of its record; None: all of them.
    """

    vehicle: int
    record: int | None = None


@frozen_dataclass
class _Seen:
    """A change of one number of a vehicle, and the vehicle's place in its statistics."""

    number: NumberStatistics
    place: int
    change: Change

    @property
    def rows(self) -> list[int]:
        return self.number.rows_of(self.place).tolist()


def findings(statistics: FleetStatistics, records: Sequence[FlightRecord]) -> list[VehicleFinding]:
    """Return everything to look at, vehicle by vehicle."""
    out: list[VehicleFinding] = []
    for vehicle in range(len(statistics.vehicles)):
        out += _find_changes(statistics, vehicle, records)
        out += _outlier_finding(statistics, vehicle)
        out += _find_loadings(statistics, vehicle)
    return out


def nothing_found(statistics: FleetStatistics) -> str:
    """State that nothing was found, or what a fleet needs before anything can be."""
    needs: list[str] = []
    if not statistics.tests:
        needs.append(f"a change takes {LEAST_SERIES} flights of one vehicle")
    if len(statistics.vehicles) < LEAST_GROUPS:
        needs.append(f"a vehicle unlike the others takes {LEAST_GROUPS} vehicles")
    nothing = "No change was found" if statistics.tests else "There is nothing to compare yet"
    if not needs:
        return f"{nothing}, and no vehicle is unlike the others."
    return f"{nothing}: to be seen, {', and '.join(needs)}."


def lead_number(statistics: FleetStatistics, finding: Finding) -> NumberStatistics:
    """Return the number that names the cause of a finding."""
    name, _, configuration = finding.numbers[0].partition("@")
    found = statistics.number(name, configuration or None)
    assert found is not None
    return found


def number_phrase(name: str) -> str:
    """Return a number's name within a sentence."""
    if name in PHRASES:
        return PHRASES[name]
    title = title_of(name) if name not in TITLES else TITLES[name]
    return title[0].lower() + title[1:]


def day_text(seconds: float) -> str:
    """Format seconds since 1970 (UTC) as a day."""
    moment = datetime.fromtimestamp(seconds, UTC)
    return f"{moment.day} {moment:%B %Y}"


def flights_of(statistics: FleetStatistics, vehicle: int) -> list[int]:
    """Return a vehicle's records with any number, in order of time."""
    found: dict[int, None] = {}
    for number in sorted(statistics.numbers, key=lambda n: -len(n.rows)):
        if vehicle in number.vehicles:
            found |= dict.fromkeys(number.rows_of(number.vehicles.index(vehicle)).tolist())
    return list(found)


def _flight_phrase(records: Sequence[FlightRecord], flights: Sequence[int], record: int) -> str:
    """Name a flight of a vehicle: its number among the vehicle's, its file, its day if logged."""
    it = records[record]
    day = "" if it.started is None else f", {day_text(it.started)}"
    return f"flight {flights.index(record) + 1} of {len(flights)} ({file_name(it.file)}{day})"


def _size_phrase(name: str, size: float, low: float, high: float, reference: float) -> str:
    """Format a difference with its interval: percent, or millimetres and the direction."""
    metres = name in IN_METRES
    unit = 1e3 if metres else 100.0 / abs(reference)
    if metres:
        places = 1 if max(abs(low), abs(high)) >= 1e-3 else 2
        text = f"mm {DIRECTIONS[name][0 if size >= 0 else 1]}"
    else:
        places = 0 if abs(unit * size) >= 9.5 else 1 if abs(unit * size) >= 0.3 else 2
        text = "%"
    ends = (
        sorted((abs(unit * low), abs(unit * high))) if low * high > 0 else (unit * low, unit * high)
    )
    return f"{abs(unit * size):.{places}f} {text} ({ends[0]:.{places}f} to {ends[1]:.{places}f})"


def _difference_phrase(name: str, size: float, low: float, high: float, reference: float) -> str:
    """Format a difference of a number from another level, with the number's name."""
    sizes = _size_phrase(name, size, low, high, reference)
    if name in IN_METRES:
        return f"{number_phrase(name).split(',')[0]} {sizes}"
    return f"{number_phrase(name)} {'smaller' if size < 0 else 'larger'} by {sizes}"


def _full_name(number: NumberStatistics) -> str:
    return f"{number.name}@{number.configuration}" if number.configuration else number.name


def _find_changes(
    statistics: FleetStatistics, vehicle: int, records: Sequence[FlightRecord]
) -> list[VehicleFinding]:
    """Describe the changes in a vehicle: each cause once."""
    seen = [
        _Seen(number=number, place=place, change=change)
        for number in statistics.numbers
        if vehicle in number.vehicles
        for place in [number.vehicles.index(vehicle)]
        for change in number.changes[place]
    ]
    flights = flights_of(statistics, vehicle)
    seen.sort(key=lambda s: (*[s.number.name not in names for names in RANKS], s.change.p))
    causes: list[list[_Seen]] = []
    while seen:
        causes.append([s for s in seen if s is seen[0] or _same_cause(seen[0], s, flights)])
        seen = [s for s in seen if all(s is not one for one in causes[-1])]
    causes.sort(key=lambda cause: cause[0].change.p)
    return [_change_finding(cause, vehicle, flights, records) for cause in causes]


def _same_cause(lead: _Seen, second: _Seen, flights: Sequence[int]) -> bool:
    """Return whether one cause explains a change of another number as well."""
    if lead.number is second.number:
        return True
    if second.number.name in ROTORS or (lead.change.kind == "once") != (
        second.change.kind == "once"
    ):
        return False
    (a, b), (c, d) = (
        (flights.index(s.rows[s.change.earliest]), flights.index(s.rows[s.change.latest]))
        for s in (lead, second)
    )
    return a - SLACK <= d and c - SLACK <= b


def _change_finding(
    seen: Sequence[_Seen], vehicle: int, flights: Sequence[int], records: Sequence[FlightRecord]
) -> VehicleFinding:
    """Return the finding of one cause, by the number that names it best and the others."""
    lead = seen[0]
    record = lead.rows[lead.change.first]
    others = dict.fromkeys(s.number.name for s in seen if s.number.name != lead.number.name)
    also = f" Also: {_join_phrases([number_phrase(name) for name in others])}." if others else ""
    return VehicleFinding(
        kind=CHANGE,
        severity="note",
        vehicle=vehicle,
        record=record,
        sentence=f"{_change_phrase(lead, flights, records)}.{also}",
        next_step=_change_advice(lead),
        numbers=tuple(dict.fromkeys(_full_name(s.number) for s in seen)),
        flights=(records[record].file,),
        evidence=tuple(
            Evidence(
                name=_full_name(s.number),
                value=s.change.size,
                interval=(s.change.low, s.change.high),
            )
            for s in seen
        ),
    )


def _change_phrase(seen: _Seen, flights: Sequence[int], records: Sequence[FlightRecord]) -> str:
    change, number, rows = seen.change, seen.number, seen.rows
    subject = number_phrase(number.name)
    moves = number.name in IN_METRES
    subject = subject.split(",")[0] if moves else subject  # a direction follows
    subject = subject[0].upper() + subject[1:]
    level = float(number.level[seen.place])
    size = _size_phrase(number.name, change.size, change.low, change.high, level)
    when = _flight_phrase(records, flights, rows[change.first])
    first, last = (flights.index(rows[i]) + 1 for i in (change.earliest, change.latest))
    between = "" if first == last else f", at the earliest {first}, at the latest {last}"
    fell = change.size < 0.0
    if change.kind == "once":
        how = f"was {size}" if moves else f"was {size} {'lower' if fell else 'higher'}"
        return f"{subject} {how} in {when} alone"
    if change.kind == "step":
        how = f"moved {size}" if moves else f"{'fell' if fell else 'rose'} by {size}"
        return f"{subject} {how} with {when}{between}"
    total = _size_phrase(number.name, change.total, change.total, change.total, level)
    how = f"moves {size}" if moves else f"{'falls' if fell else 'rises'} by {size}"
    return f"{subject} {how} a flight since {when}{between}: {total.split(' (')[0]} by now"


def _change_advice(seen: _Seen) -> str:
    name = seen.number.name
    weather = f" ({WEATHER})" if seen.number.weather == "in it" else ""
    if seen.change.kind == "once":
        return (
            "see how it was loaded and flown on that flight, and the doubts in its own report: "
            "another payload or battery?" + weather
        )
    if name in ROTORS:
        i = name.removeprefix("kt_")
        return f"check or replace propeller {i}; if it is sound, check motor {i} and its bearing"
    if name in THRUST:
        return "check all propellers, and that the vehicle still weighs what was given" + weather
    return _advice_on_change(name) + weather


def _advice_on_change(name: str) -> str:
    if name in IN_METRES:
        return CHECK_BALANCE
    if name.endswith("_com"):
        return "check what is mounted, and where: battery, payload, arms"
    if name == "motor_lag":
        return "check motors and propellers, and the settings of the speed controllers"
    return "check propellers and motors: shape, damage, dirt"


def _outlier_finding(statistics: FleetStatistics, vehicle: int) -> list[VehicleFinding]:
    """Return the differences of an outlying vehicle from the others; empty if it is none."""
    seen = [
        (number, place)
        for number in statistics.numbers
        if vehicle in number.vehicles
        for place in [number.vehicles.index(vehicle)]
        if number.outlying[place]
    ]
    if not seen:
        return []
    seen.sort(key=lambda one: one[0].p[one[1]])
    evidence = [_outlier_evidence(number, place) for number, place in seen]
    shown = [
        _difference_phrase(number.name, e.value, *(e.interval or (e.value, e.value)), number.mean)
        for (number, _), e in zip(seen[:MOST_NAMED], evidence, strict=False)
    ]
    more = len(seen) - len(shown)
    also = f"; {more} more number{'s' if more > 1 else ''}" if more else ""
    return [
        VehicleFinding(
            kind=OUTLIER,
            severity="note",
            vehicle=vehicle,
            sentence=f"Unlike the other vehicles: {'; '.join(shown)}{also}.",
            next_step=_outlier_advice([number.name for number, _ in seen]),
            numbers=tuple(e.name for e in evidence),
            evidence=tuple(evidence),
        )
    ]


def _outlier_evidence(number: NumberStatistics, place: int) -> Evidence:
    """Return the difference from the other vehicles' mean, with its interval."""
    size, std = float(number.difference[place]), float(number.difference_std[place])
    # The spread between vehicles decides whether one is an outlier; it does not blur by how much.
    half = NORMAL_95 * float(np.hypot(number.level_std[place], number.mean_std))
    half = half if np.isfinite(half) else NORMAL_95 * std
    return Evidence(name=_full_name(number), value=size, interval=(size - half, size + half))


def _outlier_advice(names: Sequence[str]) -> str:
    rotors = [name for name in names if name in ROTORS]
    if len(rotors) == 1 and not set(names) & {"kd", "Jr"}:
        i = rotors[0].removeprefix("kt_")
        return f"compare propeller {i} and motor {i} with those of the other vehicles"
    if set(names) & {*ROTORS, *THRUST, "kd", "Jr", "kd_over_kt", "kd_over_Izz"}:
        return (
            "another propeller? Compare its propellers (size, pitch, make) and motors with those "
            "of the other vehicles, and weigh it"
        )
    return _advice_on_change(names[0])


def _find_loadings(statistics: FleetStatistics, vehicle: int) -> list[VehicleFinding]:
    """Return how each loading of a vehicle differs from its most flown loading."""
    groups: dict[str | None, list[LoadingDifference]] = {}
    for d in sorted(statistics.loadings, key=lambda d: d.p):
        if d.vehicle == vehicle:
            groups.setdefault(d.number.configuration, []).append(d)
    return [_loading_finding(seen) for seen in groups.values()]


def _loading_finding(seen: Sequence[LoadingDifference]) -> VehicleFinding:
    configuration, reference = seen[0].number.configuration, seen[0].reference
    phrases = [
        _difference_phrase(d.number.name, d.difference, d.low, d.high, d.reference_level)
        for d in seen
    ]
    return VehicleFinding(
        kind=LOADING,
        severity="note",
        vehicle=seen[0].vehicle,
        sentence=f"Loaded as {configuration}, against {reference}: {_join_phrases(phrases)}.",
        next_step=f"nothing, if {configuration} carries what explains it; else check the load, and "
        "which flights are listed under which configuration",
        numbers=tuple(_full_name(d.number) for d in seen),
        evidence=tuple(
            Evidence(name=_full_name(d.number), value=d.difference, interval=(d.low, d.high))
            for d in seen
        ),
    )


def _join_phrases(phrases: Sequence[str]) -> str:
    """Join phrases, the last ones counted."""
    shown = list(phrases[:MOST_NAMED])
    more = len(phrases) - len(shown)
    return "; ".join([*shown, f"{more} more"] if more else shown)
