"""The table of vehicles: what each one's flights say, apart from what the type says of it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rotorfit.errors import EstimationError
from rotorfit.experiment.experiment import Experiment
from rotorfit.fit.joint.joint_fit import FittedFactors
from rotorfit.fleet.entries import read_entry
from rotorfit.fleet.joined import Joined, joined
from rotorfit.fleet.kept_factors import fitted_factors
from rotorfit.fleet.listing import FlightTask
from rotorfit.fleet.one_flight import experiment_of
from rotorfit.fleet.records import NUMBERS, Columns, FlightRecord, moment_text
from rotorfit.fleet.statistics import FleetStatistics, NumberStatistics

Loaded = tuple[str, str, float | None]
"""Vehicle, configuration and mass: what one row is of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Where the factors of a flight are, and what they were made with."""

    key: str
    task: FlightTask


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinTask:
    """The flights of one vehicle as it was loaded, to be fitted together."""

    cache: Path
    flights: tuple[Kept, ...]


def joined_vehicle(task: JoinTask) -> Joined | None:
    """Return what the flights of a vehicle say together; None where they do not settle."""
    experiment = experiment_of(task.flights[0].task)
    loads = [partial(_load, task.cache, kept.key, experiment) for kept in task.flights]
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return joined(loads)
        except (EstimationError, np.linalg.LinAlgError):
            return None


def _load(cache: Path, key: str, experiment: Experiment) -> FittedFactors:
    entry = read_entry(cache, key, factors=True)
    if entry is None:
        raise EstimationError("what was kept of a flight was spoilt meanwhile: run again")
    return fitted_factors(entry.factors, experiment)


def join_tasks(
    records: Sequence[FlightRecord], kept: Sequence[Kept], cache: Path
) -> dict[Loaded, JoinTask]:
    """Return the vehicles of which several flights were identified, each as it was loaded."""
    groups: dict[Loaded, list[Kept]] = {}
    for record, one in zip(records, kept, strict=True):
        if not record.refused:
            groups.setdefault(loaded(record), []).append(one)
    return {
        key: JoinTask(cache=cache, flights=tuple(own))
        for key, own in groups.items()
        if len(own) > 1 and len({one.task.airframe for one in own}) == 1
    }


def loaded(record: FlightRecord) -> Loaded:
    """Return which row of the table a flight belongs to."""
    return record.vehicle, record.configuration, record.mass


def vehicle_columns(
    records: Sequence[FlightRecord],
    statistics: FleetStatistics,
    together: Mapping[Loaded, Joined | None],
) -> Columns:
    """Return the table of vehicles, one row for each as it was loaded.

    A number has up to four pairs of columns, value and ``_std``: ``kt`` by the vehicle's own
    flights before any change, ``kt_now`` after the changes, ``kt_with_type`` sharpened by what the
    type is like, ``kt_joint`` of all flights fitted together; and ``kt_apart``, whether it stands
    apart.

    Parameters
    ----------
    records
        Of all flights.
    statistics
        What they say together.
    together
        Joint fits, by `loaded`.
    """
    rows: dict[Loaded, list[FlightRecord]] = {}
    for record in records:
        rows.setdefault(loaded(record), []).append(record)
    ordered = sorted(rows, key=lambda row: (row[0], row[1], row[2] or 0.0))
    columns: Columns = {
        "vehicle": [vehicle for vehicle, _, _ in ordered],
        "configuration": [configuration for _, configuration, _ in ordered],
        "mass": [mass for _, _, mass in ordered],
        "flights": [len(rows[row]) for row in ordered],
        "identified": [sum(not r.refused for r in rows[row]) for row in ordered],
        "first": [moment_text(_moment(rows[row], min)) for row in ordered],
        "last": [moment_text(_moment(rows[row], max)) for row in ordered],
    }
    for name in NUMBERS:
        columns |= _columns_of(name, ordered, statistics, together)
    return columns


def _columns_of(
    name: str,
    rows: Sequence[Loaded],
    statistics: FleetStatistics,
    together: Mapping[Loaded, Joined | None],
) -> Columns:
    """Return the columns of one number; none where nobody tells it."""
    columns: Columns = {}
    cells = [_own_cells(name, row, statistics) for row in rows]
    for column in dict.fromkeys(column for own in cells for column in own):
        columns[column] = [own.get(column) for own in cells]
    fits = [together.get(row) for row in rows]
    there = [fit is not None and name in fit.names for fit in fits]
    if any(there):
        at = [None if fit is None else fit.number(name) for fit in fits]
        columns[f"{name}_joint"] = [None if pair is None else pair[0] for pair in at]
        columns[f"{name}_joint_std"] = [None if pair is None else pair[1] for pair in at]
    return columns


def _own_cells(name: str, row: Loaded, statistics: FleetStatistics) -> dict[str, Any]:
    """Return what the statistics say of one number of one vehicle."""
    number = statistics.number(name, row[1]) or statistics.number(name)
    if number is None or row[0] not in statistics.vehicles:
        return {}
    vehicle = statistics.vehicles.index(row[0])
    if vehicle not in number.vehicles:
        return {}
    return _cells(number, number.vehicles.index(vehicle))


def _cells(number: NumberStatistics, place: int) -> dict[str, Any]:
    pairs = {
        "": (number.own, number.own_std),
        "_now": (number.now, number.now_std),
        "_with_type": (number.shrunk, number.shrunk_std),
    }
    cells: dict[str, Any] = {}
    for ending, (value, std) in pairs.items():
        cells[f"{number.name}{ending}"] = _known(float(value[place]))
        cells[f"{number.name}{ending}_std"] = _known(float(std[place]))
    return {**cells, f"{number.name}_apart": bool(number.apart[place])}


def _moment(
    records: Sequence[FlightRecord], pick: Callable[[Iterable[float]], float]
) -> float | None:
    told = [r.started for r in records if r.started is not None]
    return pick(told) if told else None


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
