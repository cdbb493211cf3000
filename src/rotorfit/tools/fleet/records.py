"""The records of a fleet: a row of numbers per log, or why there is none; and the cache of both.

The cache has a file for each log, named by the hash of log, options and version: a NumPy archive
with the record as JSON, and the factors of the flight. It is written under another name and moved
into place; a file that cannot be read is made again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import zipfile
import zlib
from dataclasses import field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit import version
from rotorfit.errors import OutputError
from rotorfit.findings import Finding, finding_from_plain, finding_to_plain
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.model.parameters import DERIVED, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.fit.experiment.experiment import Experiment

KT_WEIGHT: Final = "kt_weight"
"""k_t by which thrust carries the weight over the whole flight [N s^2/rad^2]: the sharpest number
of a flight, for what changes over time. Its std is a limit for one flight alone (the velocity at
its ends is not known), without what is the same in every flight of a vehicle: the flights of one
vehicle may well scatter ten times less."""
TRIM: Final = ("thrust_center_x", "thrust_center_y", "hover_motor")
"""What the motors alone show of a flight: the mean centre of thrust over the used stretches, with
all rotors alike [m] (in calm flight it lies over the centre of mass: a battery that was shifted, a
weight that was added show here first), and the motors' root mean square [rad/s; 0 to 1 where only
commands are logged]. Their std is that between parts of the flight. A log that cannot be identified
but shows its motors has a record of these alone, with the reason in `refused`."""
NUMBERS: Final = (*PARAMETERS, *DERIVED, KT_WEIGHT, *TRIM)
"""Every number that a flight may have, in the order of the tables' columns."""
COMPARED: Final = (
    *("kt", KT_WEIGHT, "kd", "Jr", "motor_lag"),
    *("com_x", "com_y", "com_z", "Ixx_com", "Iyy_com", "Izz_com", "hover_speed"),
    *TRIM[:2],
)
"""Numbers by which flights are compared: a record has their covariance."""
FORM: Final = 3
"""Form of the cache's entries: with another number all are made anew."""
_ARRAYS: Final = ("values", "std", "low", "high", "covariance")
_TUPLES: Final = ("names", "verdicts", "compared", "warnings")
DAMAGE_ERRORS: Final = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)
"""What reading a damaged archive raises."""


@frozen_dataclass
class FlightRecord:
    """One flight that was identified by itself.

    Attributes
    ----------
    file, log_number, sha256
        The log as found or listed, which log of the file (from 1), and its fingerprint.
    mass
        As it flew [kg]; None if it is unknown, and all numbers are per kilogram.
    started
        When the log began, seconds since 1970 (UTC); None if the log does not say.
    seconds_used
        In the air and without gaps [s].
    names, values, std, low, high, verdicts
        Every number of the result, SI, with its 95 % interval; NaN if this flight does not give
        it.
    compared, covariance
        Those of `COMPARED` that this flight gives, in that order, and their covariance, with the
        deviations of their intervals.
    air_density, air_temperature, air_pressure, battery
        Means over the log [kg/m^3], [K], [Pa], and in flight [V]; None if the log has none.
    warnings, checks
        Of the result and of the flight, one sentence each, and the numbers behind them.
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
        """Return a number, NaN if this flight does not give it."""
        return float(self.values[self.names.index(name)]) if name in self.names else float("nan")

    def deviation(self, name: str) -> float:
        """Return a number's standard deviation, NaN if this flight does not give it."""
        return float(self.std[self.names.index(name)]) if name in self.names else float("nan")

    def verdict(self, name: str) -> str:
        """Return a number's verdict, empty if there is no such number."""
        return self.verdicts[self.names.index(name)] if name in self.names else ""


@frozen_dataclass
class RefusedLog:
    """A log that was not identified, and why; there may be a record of its motors all the same."""

    file: str
    log_number: int = 1
    airframe: str = ""
    refusal: Finding


def refusal(kind: str, reason: str, next_step: str) -> Finding:
    """Make the finding of a log that cannot be identified."""
    return Finding(kind=kind, severity="refusal", sentence=reason, next_step=next_step)


@frozen_dataclass
class Entry:
    """What one log came to.

    - `record`: its row, with file, vehicle and configuration left empty: they do not follow from
      the log.
    - `refusal`: why it was not identified; there may be a record of its motors all the same.
    - `hardware`: the autopilot's own number; empty if the log has none.
    - `factors`: arrays by `one_flight.factor_arrays`; empty if there are none, or not asked for.
    """

    record: FlightRecord | None
    refusal: Finding | None
    hardware: str = ""
    factors: Mapping[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])


def key_of(sha256: str, experiment: Experiment) -> str:
    """Hash log, options and version to the name of an entry; where a file lies does not count."""
    options = experiment.model_dump(mode="json", exclude={"name"})
    for configuration in options["configuration"]:
        for flight in configuration["flights"]:
            flight["file"] = ""
    hashed = [FORM, version.__version__, np.__version__, sha256, options]
    return hashlib.sha256(json.dumps(hashed, sort_keys=True).encode()).hexdigest()


def path_of(cache: Path, key: str) -> Path:
    """Return the file of an entry, in one of 256 folders."""
    return cache / key[:2] / f"{key}.npz"


def write_entry(cache: Path, key: str, entry: Entry) -> None:
    """Write an entry, whole or not at all."""
    plain = {
        "form": FORM,
        "hardware": entry.hardware,
        "record": None if entry.record is None else _record_to_plain(entry.record),
        "refusal": None if entry.refusal is None else finding_to_plain(entry.refusal),
    }
    content = io.BytesIO()
    text = np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8)
    arrays: dict[str, Any] = {"entry": text, **entry.factors}
    np.savez_compressed(content, **arrays)
    path = path_of(cache, key)
    make_folder(path.parent)
    write_whole(path, content.getvalue(), force=True)


def read_entry(cache: Path, key: str, *, factors: bool = False) -> Entry | None:
    """Read an entry, with its factors if asked for; None if there is none, or it is damaged."""
    path = path_of(cache, key)
    if not path.exists():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            plain = json.loads(archive["entry"].tobytes())
            arrays = {n: archive[n] for n in archive.files if n != "entry"} if factors else {}
        if plain["form"] != FORM:
            return None
        record, refusal = plain["record"], plain["refusal"]
        return Entry(
            record=None if record is None else _record_from_plain(record),
            refusal=None if refusal is None else finding_from_plain(refusal),
            hardware=plain["hardware"],
            factors=arrays,
        )
    except DAMAGE_ERRORS:
        return None


def _record_to_plain(record: FlightRecord) -> dict[str, Any]:
    fields = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    return {**plain, "checks": dict(record.checks)}


def _record_from_plain(plain: Mapping[str, Any]) -> FlightRecord:
    fields = dict(plain)
    fields |= {name: np.array(fields[name], dtype=float) for name in _ARRAYS}
    fields |= {name: _share_tuple(tuple(fields[name])) for name in _TUPLES}
    size = len(fields["compared"])
    fields["covariance"] = fields["covariance"].reshape(size, size)
    return FlightRecord(**fields)


@lru_cache(maxsize=1000)
def _share_tuple(texts: tuple[str, ...]) -> tuple[str, ...]:
    """Return one object for equal tuples: thousands of records have the names of one."""
    return texts


def make_folder(folder: Path) -> None:
    """Make a folder where there is none, or raise `OutputError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error.strerror})") from error
