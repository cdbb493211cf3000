"""The numbers of a fleet's flights that are compared, with their partners and scales."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.model.terms.rotors import MOST_ROTORS
from rotorfit.tools.fleet.records import KT_WEIGHT, TRIM, FlightRecord

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

Weather = Literal["taken out", "in it", "none"]

REFERENCE_DENSITY: Final = 1.225
"""Density at which numbers that go with it are compared [kg/m^3]."""
WITH_DENSITY: Final = 0.9
"""Share of the flights that must log the density for it to be taken out."""
ROTORS: Final = tuple(f"kt_{i}" for i in range(1, MOST_ROTORS + 1))
THRUST: Final = (KT_WEIGHT, "kt", "hover_speed")
"""Three names of one quantity; the first that half of the flights have is compared."""
PROPULSION: Final = (*ROTORS, "kd", "Jr", "motor_lag")
BODY: Final = (
    *("com_x", "com_y", "com_z", *TRIM[:2], "Ixx_com", "Iyy_com", "Izz_com"),
    *("kd_over_Izz", "Jr_over_Izz"),
)
"""Numbers of a vehicle as it is loaded: compared among flights of one configuration."""
RATIOS: Final = {
    "kd_over_kt": ("kd", "kt"),
    "Ixx_over_kt": ("Ixx_com", "kt"),
    "Iyy_over_kt": ("Iyy_com", "kt"),
    "Izz_over_kt": ("Izz_com", "kt"),
}
"""Compared where their parts are not known each by itself."""
TOGETHER: Final = ("kd", "Jr", "Izz_com")
"""All of the yaw equation, with correlated errors: judged in one likelihood where a fleet has one
configuration."""
DENSITY_POWER: Final = {
    **dict.fromkeys(("kt", KT_WEIGHT, *ROTORS, "kd", "kd_over_Izz"), 1.0),
    "hover_speed": -0.5,
    **dict.fromkeys(("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt"), -1.0),
}
"""Power of the density of the air with which a number goes."""
MEANS_OVER_FLIGHT: Final = (KT_WEIGHT, *TRIM[:2])
"""Gusts and manoeuvres move parts of a flight more than they move its mean: where flights of one
vehicle scatter less than they state, their scatter counts."""
IN_METRES: Final = ("com_x", "com_y", "com_z", *TRIM[:2])
"""Lengths that may be zero: their changes are given in millimetres, others in percent."""


@frozen_dataclass
class NumberTable:
    """Some numbers of some flights, in order of vehicle and time.

    - `configuration`: in which they were flown; None if it does not matter.
    - `rows`: indices of the records.
    - `values`, `covariance`: SI, NaN if a flight does not have a number.
    - `weather`: of each number: whether the density of the air is taken out.
    """

    names: tuple[str, ...]
    configuration: str | None
    rows: tuple[int, ...]
    values: Float[np.ndarray, "n p"]
    covariance: Float[np.ndarray, "n p p"]
    weather: tuple[Weather, ...]


def in_order(records: Sequence[FlightRecord]) -> list[int]:
    """Sort the records' indices by vehicle, then by time."""
    # Where one log of a vehicle has no time, the names of the files decide, numbers in them counted
    # as numbers.
    dated = {r.vehicle for r in records} - {r.vehicle for r in records if r.started is None}

    def key(i: int) -> tuple[str, float, tuple[tuple[int, int, str], ...], int]:
        r = records[i]
        moment = r.started if r.vehicle in dated and r.started is not None else 0.0
        return r.vehicle, moment, _natural_order(r.file), r.log_number

    return sorted(range(len(records)), key=key)


def number_tables(records: Sequence[FlightRecord]) -> list[NumberTable]:
    """Tabulate every number that is compared, with the flights that have it."""
    ordered = in_order(records)
    configurations = sorted({r.configuration for r in records})
    single = configurations[0] if len(configurations) == 1 else None
    count = {name: _count_known(records, name) for name in (*THRUST, *PROPULSION, *BODY, *RATIOS)}
    half = 0.5 * max(max(count.values(), default=0), 1)
    thrust = next((name for name in THRUST if count[name] >= half), "kt")
    ratios = [n for n, parts in RATIOS.items() if min(count[p] for p in parts) < 0.5 * count[n]]
    together = TOGETHER if single is not None and all(count[n] for n in TOGETHER) else ()
    plain = [name for name in (thrust, *PROPULSION, "kd_over_kt") if name not in together]
    plain = [name for name in plain if name not in RATIOS or name in ratios]
    out = [_tabulate_numbers(records, ordered, (name,), None) for name in plain]
    if together:
        out.append(_tabulate_numbers(records, ordered, together, None))
    body = [name for name in BODY if name not in together]
    body += [name for name in ratios if name != "kd_over_kt"]
    for configuration in configurations:
        rows = [i for i in ordered if records[i].configuration == configuration]
        label = None if single is not None else configuration
        out += [_tabulate_numbers(records, rows, (name,), label) for name in body]
    return [table for table in out if len(table.rows) > 1]


def unit_of(name: str) -> str:
    """Return the SI unit of a number."""
    if name in TRIM[:2]:
        return "m"
    known = PARAMETERS | DERIVED
    return known["kt" if name == KT_WEIGHT else name].unit


def _tabulate_numbers(
    records: Sequence[FlightRecord],
    ordered: Sequence[int],
    names: tuple[str, ...],
    configuration: str | None,
) -> NumberTable:
    """Tabulate some numbers of the flights that have at least one of them."""
    weighed = any(records[i].mass is not None for i in ordered)
    kept = [i for i in ordered if records[i].mass is not None or not weighed]
    weather: list[Weather] = [_weather_of(records, kept, name) for name in names]
    factor = np.ones((len(kept), len(names)))
    for k, name in enumerate(names):
        if weather[k] == "taken out":
            density = np.array([records[i].air_density or np.nan for i in kept])
            factor[:, k] = (REFERENCE_DENSITY / density) ** DENSITY_POWER[name]
    values = np.array([[_estimated_value(records[i], name) for name in names] for i in kept])
    values = values.reshape(len(kept), len(names)) * factor
    covariance = np.array([_record_covariance(records[i], names) for i in kept])
    covariance = covariance.reshape(len(kept), len(names), len(names))
    covariance = covariance * factor[:, :, None] * factor[:, None, :]
    present = np.isfinite(values).any(axis=1)
    return NumberTable(
        names=names,
        configuration=configuration,
        rows=tuple(kept[i] for i in np.flatnonzero(present)),
        values=values[present],
        covariance=covariance[present],
        weather=tuple(weather),
    )


def _weather_of(records: Sequence[FlightRecord], rows: Sequence[int], name: str) -> Weather:
    if name not in DENSITY_POWER:
        return "none"
    has = [records[i].air_density is not None for i in rows if _count_known([records[i]], name)]
    return "taken out" if has and np.mean(has) >= WITH_DENSITY else "in it"


def _count_known(records: Sequence[FlightRecord], name: str) -> int:
    return sum(bool(np.isfinite(_estimated_value(record, name))) for record in records)


def _estimated_value(record: FlightRecord, name: str) -> float:
    """Return a number that this flight estimated; NaN if it was given, or is not known."""
    estimated = record.verdict(name) not in ("given", "removed", "not-identified", "ratio-only")
    return record.value(name) if estimated and np.isfinite(record.deviation(name)) else np.nan


def _record_covariance(record: FlightRecord, names: tuple[str, ...]) -> Float[np.ndarray, "p p"]:
    """Return the covariance of some numbers; without correlations where the record has none."""
    if all(name in record.compared for name in names):
        at = [record.compared.index(name) for name in names]
        return record.covariance[np.ix_(at, at)]
    std = np.array([record.deviation(name) for name in names])
    return np.diag(np.where(np.isfinite(std), std, 0.0) ** 2)


def _natural_order(file: str) -> tuple[tuple[int, int, str], ...]:
    """Split a name so that ``log9`` sorts before ``log10``."""
    parts = re.findall(r"\d+|\D+", file)
    return tuple((0, int(p), "") if p.isascii() and p.isdigit() else (1, 0, p) for p in parts)
