"""What a fleet keeps of a flight: one row of numbers, or why there is none."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rotorfit.model.parameters import DERIVED, PARAMETERS

KT_WEIGHT: Final = "kt_weight"
"""k_t by which thrust carries the weight over the whole flight [N s^2/rad^2]: the sharpest number
of a flight, for what changes over time. Its std is a limit for one flight alone (the velocity at
its ends is not known), without what is the same in every flight of a vehicle: the flights of one
vehicle may well scatter ten times less."""
TRIM: Final = ("thrust_center_x", "thrust_center_y", "hover_motor")
"""What the motors alone tell of a flight: the mean centre of thrust over the used stretches, with
all rotors alike [m] (in calm flight it lies over the centre of mass: a battery that was shifted, a
weight that was added show here first), and the motors' root mean square [rad/s; 0 to 1 where only
commands are logged]. Their std is that between parts of the flight. A log that cannot be identified
but shows its motors has a record of these alone, with the reason among its warnings."""
NUMBERS: Final = (*PARAMETERS, *DERIVED, KT_WEIGHT, *TRIM)
"""Every number that a flight may have, in the order of the tables' columns."""
COMPARED: Final = (
    *("kt", KT_WEIGHT, "kd", "Jr", "motor_lag"),
    *("com_x", "com_y", "com_z", "Ixx_com", "Iyy_com", "Izz_com", "hover_speed"),
    *TRIM[:2],
)
"""Numbers by which flights are compared: a record has their covariance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecord:
    """One flight that was identified by itself.

    Attributes
    ----------
    file, log_number, sha256
        The log as found or listed, which log of the file (from 1), and its fingerprint.
    vehicle, configuration
        Whose flight it is, and how it was loaded.
    mass
        As it flew [kg]; None where it is unknown, and all numbers are per kilogram.
    started
        When the log began, seconds since 1970 (UTC); None where the log does not say.
    seconds_used
        In the air and without gaps [s].
    names, values, std, low, high, verdicts
        Every number of the result, SI, with the ends of its 95 % interval (`low`, `high`) and its
        verdict; NaN where this flight does not give it.
    compared, covariance
        Those of `COMPARED` that this flight gives, in that order, and their covariance, with the
        deviations of their intervals.
    air_density, air_temperature, air_pressure
        Means over the log [kg/m^3], [K], [Pa]; None where the log has none.
    battery
        Voltage in flight: mean [V]; None where the log has none.
    warnings
        What to doubt, one sentence each: of the result and of the flight.
    checks
        The numbers behind the warnings, by the names of a result's diagnostics.
    refused
        Why the flight was not identified, where the record is of the motors alone; else empty.
    """

    file: str
    sha256: str
    vehicle: str
    configuration: str
    log_number: int = 1
    mass: float | None
    started: float | None = None
    seconds_used: float
    names: tuple[str, ...]
    values: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]
    verdicts: tuple[str, ...]
    compared: tuple[str, ...]
    covariance: Float[np.ndarray, "c c"]
    air_density: float | None = None
    air_temperature: float | None = None
    air_pressure: float | None = None
    battery: float | None = None
    warnings: tuple[str, ...] = ()
    checks: Mapping[str, float] = field(default_factory=dict[str, float])
    refused: str = ""

    def value(self, name: str) -> float:
        """Return a number, NaN where this flight does not give it."""
        return float(self.values[self.names.index(name)]) if name in self.names else float("nan")

    def deviation(self, name: str) -> float:
        """Return its standard deviation, NaN where this flight does not give it."""
        return float(self.std[self.names.index(name)]) if name in self.names else float("nan")

    def verdict(self, name: str) -> str:
        """Return its verdict, empty where there is no such number."""
        return self.verdicts[self.names.index(name)] if name in self.names else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightFailure:
    """A log that has no row: which, why, and what to do.

    `vehicle` is empty where it is not known.
    """

    file: str
    log_number: int = 1
    vehicle: str = ""
    reason: str
    what_to_do: str = ""


Columns = dict[str, list[Any]]
"""A table: columns of equal length by name; None where a row has nothing."""


def flight_columns(records: Sequence[FlightRecord], numbers: Sequence[str]) -> Columns:
    """Return the table of flights, one row each, in the order given.

    A number has five columns: ``kt``, ``kt_std``, ``kt_low``, ``kt_high``, ``kt_verdict``.

    Parameters
    ----------
    records
        Of the table, or of some of its rows.
    numbers
        That have columns: `numbers_of` all records.
    """
    columns: Columns = {
        "file": [r.file for r in records],
        "log_number": [r.log_number for r in records],
        "sha256": [r.sha256 for r in records],
        "vehicle": [r.vehicle for r in records],
        "configuration": [r.configuration for r in records],
        "mass": [r.mass for r in records],
        "started": [moment_text(r.started) for r in records],
        "seconds_used": [r.seconds_used for r in records],
    }
    places = [{name: i for i, name in enumerate(r.names)} for r in records]
    for name in numbers:
        at = [place.get(name) for place in places]
        for ending, array in (("", "values"), ("_std", "std"), ("_low", "low"), ("_high", "high")):
            columns[f"{name}{ending}"] = [
                None if i is None else _known(float(getattr(r, array)[i]))
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


def failure_columns(failures: Iterable[FlightFailure]) -> Columns:
    """Return the table of logs without a row."""
    rows = list(failures)
    return {
        "log": [f.file for f in rows],
        "log_number": [f.log_number for f in rows],
        "vehicle": [f.vehicle or None for f in rows],
        "reason": [f.reason for f in rows],
        "what_to_do": [f.what_to_do or None for f in rows],
    }


def numbers_of(records: Iterable[FlightRecord]) -> tuple[str, ...]:
    """Return the names of all numbers that any record has, in the order of `NUMBERS`.

    The mass is a column by itself.
    """
    there = {name for record in records for name in record.names} - {"mass"}
    return tuple(name for name in NUMBERS if name in there)


def moment_text(seconds: float | None) -> str | None:
    """Return seconds since 1970 (UTC) as a date and a time."""
    if seconds is None:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
