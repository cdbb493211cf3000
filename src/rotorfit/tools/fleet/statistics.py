"""Statistics of a fleet's flights: the type, each vehicle, changes, outliers.

Number by number: every flight's estimate with its own covariance, vehicles about the type's mean,
flights about their vehicle. Nothing here looks into a log.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.tools.fleet.changes import LEAST_SERIES, Change, Changes, find_changes
from rotorfit.tools.fleet.compared import MEANS_OVER_FLIGHT, NumberTable, Weather, number_tables
from rotorfit.tools.fleet.group_differences import contrasts, discoveries, outlier_test
from rotorfit.tools.fleet.random_effects import RandomEffects, Repeated, random_effects

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.tools.fleet.records import FlightRecord

ALARM: Final = 0.05
"""Chance of one false change or more in the whole fleet."""
FALSE_DISCOVERY_RATE: Final = 0.05
"""Expected share of false ones among the vehicles said to be outliers."""


@frozen_dataclass
class NumberStatistics:
    """One number of the type, of each vehicle, and of each flight. SI; NaN if not known.

    - `name`, `configuration`, `weather`: as in `NumberTable`.
    - `rows`, `vehicle_of_row`, `values`, `std`: flights that have it, by the index of their record;
      place in `vehicles`; estimates.
    - `vehicles`: indices into the fleet's vehicles.
    - `mean`, `mean_std`: of the type.
    - `between`, `within`: standard deviations between vehicles, and between flights of one beyond
      what each states.
    - `level`, `level_std`: by each vehicle's own flights only, before any change.
    - `shrunk`, `shrunk_std`: by these and by the type; NaN for outliers.
    - `now`, `now_std`: after the changes, by the vehicle's own flights.
    - `changes`: of each vehicle, the clearest first; places count the vehicle's rows.
    - `difference`, `difference_std`, `p`, `outlying`: from the mean of the other vehicles, its
      chance among like ones, and whether the vehicle is an outlier.
    """

    name: str
    configuration: str | None
    weather: Weather
    rows: Int[np.ndarray, " n"]
    vehicle_of_row: Int[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    vehicles: tuple[int, ...]
    mean: float
    mean_std: float
    between: float
    within: float
    level: Float[np.ndarray, " g"]
    level_std: Float[np.ndarray, " g"]
    shrunk: Float[np.ndarray, " g"]
    shrunk_std: Float[np.ndarray, " g"]
    now: Float[np.ndarray, " g"]
    now_std: Float[np.ndarray, " g"]
    changes: tuple[tuple[Change, ...], ...]
    difference: Float[np.ndarray, " g"]
    difference_std: Float[np.ndarray, " g"]
    p: Float[np.ndarray, " g"]
    outlying: Bool[np.ndarray, " g"]

    def rows_of(self, place: int) -> Int[np.ndarray, " k"]:
        """Return the records of one of its vehicles, in order of time."""
        return self.rows[self.vehicle_of_row == place]


@frozen_dataclass
class LoadingDifference:
    """By how much one number of a vehicle differs between two of its loadings.

    - `number`: as the vehicle was loaded; `number.configuration` says how.
    - `vehicle`: index into the fleet's vehicles.
    - `reference`, `reference_level`: the loading of comparison, of the vehicle's loadings the one
      most flown in the fleet, and the number's level there.
    - `difference`, `low`, `high`, `p`: from that level, its 95 % interval, and its chance if both
      were alike.
    """

    number: NumberStatistics
    vehicle: int
    reference: str
    reference_level: float
    difference: float
    low: float
    high: float
    p: float


@frozen_dataclass
class FleetStatistics:
    """What a fleet's flights say together.

    - `vehicles`: their names.
    - `loadings`: differences between the configurations of a vehicle.
    - `alarm`, `rate`: chance of a false change in the fleet; expected share of false outliers.
    - `tests`: in how many series of flights a change was looked for.
    """

    vehicles: tuple[str, ...]
    numbers: tuple[NumberStatistics, ...]
    loadings: tuple[LoadingDifference, ...]
    alarm: float
    rate: float
    tests: int

    def number(self, name: str, configuration: str | None = None) -> NumberStatistics | None:
        """Return the statistics of a number; None if it is not compared."""
        found = (n for n in self.numbers if (n.name, n.configuration) == (name, configuration))
        return next(found, None)


@frozen_dataclass
class _Fitted:
    """A table with its vehicles, what changed in them, and their levels."""

    table: NumberTable
    vehicles: tuple[int, ...]
    data: Repeated
    effects: RandomEffects
    changes: tuple[tuple[tuple[Change, ...], ...], ...]


def fleet_statistics(records: Sequence[FlightRecord], *, alarm: float = ALARM) -> FleetStatistics:
    """Compare the flights of a fleet, in any order.

    `alarm` is the chance that anything is said to have changed, anywhere, if nothing did.
    """
    vehicles = tuple(sorted({record.vehicle for record in records}))
    of_vehicle = {name: i for i, name in enumerate(vehicles)}
    whose = np.array([of_vehicle[r.vehicle] for r in records], dtype=int)
    found = number_tables(records)
    tests = sum(_count_series(table, whose) for table in found)
    fits = [_fit_table(table, whose, alarm / max(tests, 1)) for table in found]
    numbers = [n for fit in fits for n in _numbers_of_fit(fit)]
    numbers = _without_outliers(fits, _mark_outliers(numbers, len(vehicles)))
    return FleetStatistics(
        vehicles=vehicles,
        numbers=tuple(numbers),
        loadings=tuple(_compare_loadings(numbers, records)),
        alarm=alarm,
        rate=FALSE_DISCOVERY_RATE,
        tests=tests,
    )


def _mark_outliers(numbers: Sequence[NumberStatistics], vehicles: int) -> list[NumberStatistics]:
    """Mark the outliers, each vehicle judged as a whole first."""
    p = np.full((vehicles, len(numbers)), np.nan)
    for k, number in enumerate(numbers):
        p[list(number.vehicles), k] = number.p
    flags = discoveries(p, FALSE_DISCOVERY_RATE)
    return [replace(n, outlying=flags[list(n.vehicles), k]) for k, n in enumerate(numbers)]


def _count_series(table: NumberTable, whose: Int[np.ndarray, " r"]) -> int:
    """Count the series of a table in which a change can be looked for."""
    known = np.isfinite(table.values)
    owner = whose[list(table.rows)]
    return sum(
        int((np.bincount(owner, known[:, k]) >= LEAST_SERIES).sum()) for k in range(known.shape[1])
    )


def _fit_table(table: NumberTable, whose: Int[np.ndarray, " r"], alarm: float) -> _Fitted:
    """Find what changed in a table, then the levels beside it."""
    vehicles, group = np.unique(whose[list(table.rows)], return_inverse=True)
    n, p = table.values.shape
    data = Repeated(
        values=table.values, covariance=table.covariance, group=group, changes=np.zeros((n, p, 0))
    )
    found = [
        _find_changes_in(data, k, table.names[k] in MEANS_OVER_FLIGHT, alarm) for k in range(p)
    ]
    changes = tuple(one.of_group for one in found)
    scale = np.sqrt([one.share for one in found])
    data = replace(
        data,
        covariance=data.covariance * np.outer(scale, scale),
        changes=_change_columns(data, changes),
    )
    return _Fitted(
        table=table,
        vehicles=tuple(vehicles.tolist()),
        data=data,
        effects=random_effects(data),
        changes=changes,
    )


def _find_changes_in(data: Repeated, k: int, overstated: bool, alarm: float) -> Changes:
    """Find the changes in a number; `overstated`: its deviations may be too large."""
    known = data.known[:, k]
    found = find_changes(
        data.values[known, k],
        data.covariance[known, k, k],
        data.group[known],
        alarm=alarm,
        overstated=overstated,
    )
    none: tuple[tuple[Change, ...], ...] = ((),) * (data.groups - len(found.of_group))
    return replace(found, of_group=found.of_group + none)


def _change_columns(
    data: Repeated, changes: tuple[tuple[tuple[Change, ...], ...], ...]
) -> Float[np.ndarray, "n p m"]:
    """Return a column for each change; groups share columns."""
    n, p = data.values.shape
    counts = [sum(len(number[g]) for number in changes) for g in range(data.groups)]
    out = np.zeros((n, p, max(counts, default=0)))
    for g in range(data.groups):
        column = 0
        for k, number in enumerate(changes):
            at = np.flatnonzero(data.known[:, k] & (data.group == g))
            for change in number[g]:
                out[at, k, column] = change.shape
                column += 1
    return out


def _numbers_of_fit(fit: _Fitted) -> list[NumberStatistics]:
    """Return each number of a table, before outliers are marked."""
    table, data, effects = fit.table, fit.data, fit.effects
    out: list[NumberStatistics] = []
    for k, name in enumerate(table.names):
        known = data.known[:, k]
        level = _among_flights(effects.level[:, k], data, k)
        level_std = _deviations_of(effects.level_covariance, k)
        test = outlier_test(level, level_std**2)
        now, now_std = _current_levels(fit, k)
        out.append(
            NumberStatistics(
                name=name,
                configuration=table.configuration,
                weather=table.weather[k],
                rows=np.array(table.rows)[known],
                vehicle_of_row=data.group[known],
                values=data.values[known, k],
                std=np.sqrt(data.covariance[known, k, k]),
                vehicles=fit.vehicles,
                mean=float(effects.mean[k]),
                mean_std=float(np.sqrt(effects.mean_covariance[k, k])),
                between=float(effects.between[k]),
                within=float(effects.within[k]),
                level=level,
                level_std=level_std,
                shrunk=effects.shrunk[:, k],
                shrunk_std=_deviations_of(effects.shrunk_covariance, k),
                now=_among_flights(now, data, k),
                now_std=now_std,
                changes=fit.changes[k],
                difference=test.difference,
                difference_std=test.std,
                p=test.p,
                outlying=np.zeros(len(level), dtype=bool),
            )
        )
    return out


def _deviations_of(covariance: Float[np.ndarray, "g p p"], k: int) -> Float[np.ndarray, " g"]:
    return np.sqrt(covariance[:, k, k])


def _among_flights(
    level: Float[np.ndarray, " g"], data: Repeated, k: int
) -> Float[np.ndarray, " g"]:
    """Return the levels, or the nearest of the vehicle's flights where one lies beyond them all."""
    low, high = np.full((2, data.groups), np.nan)
    np.fmin.at(low, data.group, data.values[:, k])
    np.fmax.at(high, data.group, data.values[:, k])
    # A mean cannot lie beyond; the end of a ramp can, and a mean of several numbers with correlated
    # errors.
    return np.clip(level, low, high)


def _current_levels(
    fit: _Fitted, k: int
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Estimate each vehicle's number after its changes, by its own flights."""
    effects, data = fit.effects, fit.data
    value, std = effects.level[:, k].copy(), _deviations_of(effects.level_covariance, k)
    within = effects.within[k] if np.isfinite(effects.within[k]) else 0.0
    for g, changes in enumerate(fit.changes[k]):
        if not any(change.shape[-1] for change in changes):
            continue
        at = np.flatnonzero(data.known[:, k] & (data.group == g))
        X: Float[np.ndarray, "n m"] = np.column_stack(
            [np.ones(len(at)), *(change.shape for change in changes)]
        )
        weighted: Float[np.ndarray, "m n"] = X.T / (data.covariance[at, k, k] + within**2)
        covariance: Float[np.ndarray, "m m"] = np.linalg.inv(weighted @ X)
        value[g] = X[-1] @ (covariance @ (weighted @ data.values[at, k]))
        std[g] = np.sqrt(X[-1] @ covariance @ X[-1])
    return value, std


def _without_outliers(
    fits: Sequence[_Fitted], numbers: Sequence[NumberStatistics]
) -> list[NumberStatistics]:
    """Estimate the type again without the outliers."""
    out: list[NumberStatistics] = []
    waiting = list(numbers)
    for fit in fits:
        mine, waiting = waiting[: len(fit.table.names)], waiting[len(fit.table.names) :]
        if not any(n.outlying.any() for n in mine):
            out += mine
            continue
        values = fit.data.values.copy()
        for k, number in enumerate(mine):
            values[number.outlying[fit.data.group], k] = np.nan
        effects = random_effects(replace(fit.data, values=values))
        out += [_with_type(number, effects, k) for k, number in enumerate(mine)]
    return out


def _with_type(number: NumberStatistics, effects: RandomEffects, k: int) -> NumberStatistics:
    return replace(
        number,
        mean=float(effects.mean[k]),
        mean_std=float(np.sqrt(effects.mean_covariance[k, k])),
        between=float(effects.between[k]),
        within=float(effects.within[k]),
        shrunk=np.where(number.outlying, np.nan, effects.shrunk[:, k]),
        shrunk_std=np.where(number.outlying, np.nan, _deviations_of(effects.shrunk_covariance, k)),
    )


def _compare_loadings(
    numbers: Sequence[NumberStatistics], records: Sequence[FlightRecord]
) -> list[LoadingDifference]:
    """Find differences between the loadings of a vehicle, each loading judged as a whole."""
    counts = Counter(record.configuration for record in records)
    ordered = sorted(counts, key=lambda name: (-counts[name], name))
    names = list(dict.fromkeys(n.name for n in numbers if n.configuration is not None))
    found = [
        _loading_differences([n for n in numbers if n.name == name and n.configuration], ordered)
        for name in names
    ]
    tested = [
        (d, (d.vehicle, d.number.configuration), k)
        for k, differences in enumerate(found)
        for d in differences
    ]
    row = {key: i for i, key in enumerate(dict.fromkeys(key for _, key, _ in tested))}
    p = np.full((len(row), len(names)), np.nan)
    for d, key, k in tested:
        p[row[key], k] = d.p
    discovered = discoveries(p, FALSE_DISCOVERY_RATE)
    return [d for d, key, k in tested if discovered[row[key], k]]


def _loading_differences(
    numbers: Sequence[NumberStatistics], ordered: Sequence[str]
) -> list[LoadingDifference]:
    """Compare a number in each loading of a vehicle with its level in the most flown one.

    `ordered` holds the configurations, the most flown first.
    """
    by_loading = {n.configuration: n for n in numbers}
    loadings = [by_loading[name] for name in ordered if name in by_loading]
    groups = [(v, n) for n in loadings for v in n.vehicles]
    places = {(v, n.configuration): i for i, (v, n) in enumerate(groups)}
    first = {v: n for v, n in reversed(groups)}
    compared = [(v, n) for v, n in groups if n is not first[v]]
    values, std = (np.concatenate([getattr(n, a) for n in loadings]) for a in ("values", "std"))
    group = np.concatenate(
        [[places[n.vehicles[g], n.configuration] for g in n.vehicle_of_row] for n in loadings]
    )
    found = contrasts(
        values,
        np.maximum(std**2, np.finfo(float).eps * np.max(values**2)),
        group,
        [(places[v, n.configuration], places[v, first[v].configuration]) for v, n in compared],
    )
    return [
        LoadingDifference(
            number=n,
            vehicle=v,
            reference=first[v].configuration or "",
            reference_level=float(first[v].level[first[v].vehicles.index(v)]),
            difference=float(found.difference[i]),
            low=float(found.low[i]),
            high=float(found.high[i]),
            p=float(found.p[i]),
        )
        for i, (v, n) in enumerate(compared)
    ]
