"""The tables of a fleet: flights, vehicles, logs without a row; Parquet with pyarrow, else CSV."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.tools.fleet.joined import Joined, LoadedVehicle, loaded_vehicle
from rotorfit.tools.fleet.records import NUMBERS, FlightRecord, RefusedLog

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rotorfit.tools.fleet.statistics import FleetStatistics

ROWS: Final = 500
"""Rows of a table in memory as Python's own numbers, which take ten times the room."""
TEXTS: Final = frozenset(
    (
        *("file", "sha256", "vehicle", "configuration", "started", "warnings", "refused"),
        *("first", "last", "airframe"),
    )
)
COUNTS: Final = frozenset(("log_number", "flights", "identified"))
Columns = dict[str, list[Any]]
"""A table: columns of equal length by name; None where a row has nothing."""


def has_parquet() -> bool:
    """Test whether tables can be written as Parquet."""
    return find_spec("pyarrow") is not None


def table_file(name: str, parts: Iterable[Columns]) -> tuple[str, bytes]:
    """Write a table, some rows after the other, in the format there is; return file and content."""
    if has_parquet():
        return f"{name}.parquet", parquet_bytes(parts)
    return f"{name}.csv", csv_bytes(parts)


def csv_bytes(parts: Iterable[Columns]) -> bytes:
    """Write a table as CSV (UTF-8); numbers with all their digits, empty cells for nothing."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for number, columns in enumerate(parts):
        if number == 0:
            writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow("" if cell is None else cell for cell in row)
    return text.getvalue().encode()


def parquet_bytes(parts: Iterable[Columns]) -> bytes:
    """Write a table as Parquet, a group of rows for each part."""
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    sink, writer = io.BytesIO(), None
    for columns in parts:
        schema = arrow.schema([(name, _column_type(arrow, name)) for name in columns])
        writer = writer or parquet.ParquetWriter(sink, schema, compression="zstd")
        writer.write_table(arrow.table(columns, schema=schema))
    if writer is not None:
        writer.close()
    return sink.getvalue()


def _column_type(arrow: Any, name: str) -> Any:
    """Return the type of a column by its name: a part may hold nothing but None."""
    if name in TEXTS or name.endswith("_verdict"):
        return arrow.string()
    if name in COUNTS:
        return arrow.int64()
    return arrow.bool_() if name.endswith("_apart") else arrow.float64()


def stacked(tables: Sequence[Columns]) -> Columns:
    """Join tables with different columns, None if a row has nothing."""
    names = dict.fromkeys(name for columns in tables for name in columns)
    rows = [len(next(iter(columns.values()))) for columns in tables]
    return {
        name: [
            cell
            for columns, count in zip(tables, rows, strict=True)
            for cell in columns.get(name, [None] * count)
        ]
        for name in names
    }


def flight_columns(records: Sequence[FlightRecord], numbers: Sequence[str]) -> Columns:
    """Tabulate flights, one row each, in the order given; of a number value, interval, verdict.

    Its five columns are ``kt``, ``kt_std``, ``kt_low``, ``kt_high``, ``kt_verdict``.
    """
    columns: Columns = {
        "file": [r.file for r in records],
        "log_number": [r.log_number for r in records],
        "sha256": [r.sha256 for r in records],
        "vehicle": [r.vehicle for r in records],
        "configuration": [r.configuration for r in records],
        "mass": [r.mass for r in records],
        "started": [_moment_text(r.started) for r in records],
        "seconds_used": [r.seconds_used for r in records],
    }
    places = [{name: i for i, name in enumerate(r.names)} for r in records]
    for name in numbers:
        at = [place.get(name) for place in places]
        for ending, array in (("", "values"), ("_std", "std"), ("_low", "low"), ("_high", "high")):
            columns[f"{name}{ending}"] = [
                None if i is None else _finite_or_none(float(getattr(r, array)[i]))
                for r, i in zip(records, at, strict=True)
            ]
        columns[f"{name}_verdict"] = [
            None if i is None else r.verdicts[i] or None for r, i in zip(records, at, strict=True)
        ]
    columns |= {
        "air_density": [r.air_density for r in records],
        "air_temperature": [r.air_temperature for r in records],
        "air_pressure": [r.air_pressure for r in records],
        "battery": [r.battery for r in records],
        "warnings": ["\n".join(r.warnings) or None for r in records],
        "refused": [r.refused or None for r in records],
    }
    return columns


def refusal_columns(logs: Sequence[RefusedLog]) -> Columns:
    """Tabulate logs that were not identified."""
    return {
        "log": [log.file for log in logs],
        "log_number": [log.log_number for log in logs],
        "vehicle": [None for _ in logs],
        "reason": [log.refusal.sentence for log in logs],
        "what_to_do": [log.refusal.next_step or None for log in logs],
    }


def numbers_of(records: Iterable[FlightRecord]) -> tuple[str, ...]:
    """Return all numbers of any record but the mass, in the order of `NUMBERS`."""
    present = {name for record in records for name in record.names} - {"mass"}
    return tuple(name for name in NUMBERS if name in present)


def vehicle_columns(
    records: Sequence[FlightRecord],
    statistics: FleetStatistics,
    joint_fits: Mapping[LoadedVehicle, Joined | None],
) -> Columns:
    """Tabulate vehicles, one row for each as it was loaded.

    A number has up to four pairs of columns, value and ``_std``: ``kt`` by the vehicle's own
    flights before any change, ``kt_now`` after the changes, ``kt_with_type`` sharpened by what the
    type is like, ``kt_joint`` of all flights fitted together; and ``kt_apart``, whether the vehicle
    is an outlier.
    """
    rows: dict[LoadedVehicle, list[FlightRecord]] = {}
    for record in records:
        rows.setdefault(loaded_vehicle(record), []).append(record)
    ordered = sorted(rows, key=lambda row: (row[0], row[1], row[2] or 0.0))
    columns: Columns = {
        "vehicle": [vehicle for vehicle, _, _ in ordered],
        "configuration": [configuration for _, configuration, _ in ordered],
        "mass": [mass for _, _, mass in ordered],
        "flights": [len(rows[row]) for row in ordered],
        "identified": [sum(not r.refused for r in rows[row]) for row in ordered],
        "first": [_moment_text(_moment_of_records(rows[row], min)) for row in ordered],
        "last": [_moment_text(_moment_of_records(rows[row], max)) for row in ordered],
    }
    for name in NUMBERS:
        columns |= _number_columns(name, ordered, statistics, joint_fits)
    return columns


def _number_columns(
    name: str,
    rows: Sequence[LoadedVehicle],
    statistics: FleetStatistics,
    joint_fits: Mapping[LoadedVehicle, Joined | None],
) -> Columns:
    """Return the columns of a number; empty if no vehicle has it."""
    cells = [_vehicle_cells(name, row, statistics) for row in rows]
    columns: Columns = {
        column: [row.get(column) for row in cells]
        for column in dict.fromkeys(column for row in cells for column in row)
    }
    fits = [joint_fits.get(row) for row in rows]
    pairs = [None if fit is None else fit.number(name) for fit in fits]
    if any(pair is not None for pair in pairs):
        columns[f"{name}_joint"] = [None if pair is None else pair[0] for pair in pairs]
        columns[f"{name}_joint_std"] = [None if pair is None else pair[1] for pair in pairs]
    return columns


def _vehicle_cells(name: str, row: LoadedVehicle, statistics: FleetStatistics) -> dict[str, Any]:
    """Return the columns that the statistics give for one number of one vehicle."""
    number = statistics.number(name, row[1]) or statistics.number(name)
    if number is None or row[0] not in statistics.vehicles:
        return {}
    vehicle = statistics.vehicles.index(row[0])
    if vehicle not in number.vehicles:
        return {}
    place = number.vehicles.index(vehicle)
    pairs = {
        "": (number.level, number.level_std),
        "_now": (number.now, number.now_std),
        "_with_type": (number.shrunk, number.shrunk_std),
    }
    cells: dict[str, Any] = {}
    for ending, (value, std) in pairs.items():
        cells[f"{name}{ending}"] = _finite_or_none(float(value[place]))
        cells[f"{name}{ending}_std"] = _finite_or_none(float(std[place]))
    return {**cells, f"{name}_apart": bool(number.outlying[place])}


def _moment_text(seconds: float | None) -> str | None:
    """Format seconds since 1970 (UTC) as a date and a time."""
    if seconds is None:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _moment_of_records(
    records: Sequence[FlightRecord], pick: Callable[[Iterable[float]], float]
) -> float | None:
    dated = [r.started for r in records if r.started is not None]
    return pick(dated) if dated else None


def _finite_or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
