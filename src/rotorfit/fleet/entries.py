"""The cache: what is kept of a log, a file each, by the hash of log, options and version.

An entry is a NumPy archive with the record as JSON, and the factors of the flight. It is written
under another name and moved into place; one that cannot be read is made anew.
"""

import dataclasses
import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from rotorfit import version
from rotorfit.errors import OutputError
from rotorfit.experiment.experiment import Experiment
from rotorfit.fleet.records import FlightFailure, FlightRecord
from rotorfit.logs.files import write_whole

FORM: Final = 3
"""Of the entries: with another number all are made anew."""
_ARRAYS: Final = ("values", "std", "low", "high", "covariance")
_TUPLES: Final = ("names", "verdicts", "compared", "warnings")
SPOILT: Final = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)
"""What reading a damaged archive raises."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """What one log came to.

    Attributes
    ----------
    record
        Its row, with file, vehicle and configuration left empty: they are not the log's business.
    failure
        Why it was not identified; there may be a record of its motors all the same.
    hardware
        The autopilot's own number; empty where the log has none.
    factors
        Arrays of `kept_factors.py`; empty where there are none, or they were not asked for.
    """

    record: FlightRecord | None
    failure: FlightFailure | None
    hardware: str = ""
    factors: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict[str, np.ndarray])


def key_of(sha256: str, experiment: Experiment) -> str:
    """Return the name of an entry: a hash of log, options and version.

    What a file is called, and where it lies, is none of the options.
    """
    options = experiment.model_dump(mode="json", exclude={"name"})
    for configuration in options["configuration"]:
        for flight in configuration["flights"]:
            flight["file"] = ""
    told = [FORM, version.__version__, np.__version__, sha256, options]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def path_of(cache: Path, key: str) -> Path:
    """Return where an entry is kept, in one of 256 folders."""
    return cache / key[:2] / f"{key}.npz"


def write_entry(cache: Path, key: str, entry: Entry) -> None:
    """Write an entry, whole or not at all."""
    told = {
        "form": FORM,
        "hardware": entry.hardware,
        "record": None if entry.record is None else _plain(entry.record),
        "failure": None if entry.failure is None else dataclasses.asdict(entry.failure),
    }
    content = io.BytesIO()
    text = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    arrays: dict[str, Any] = {"told": text, **entry.factors}
    np.savez_compressed(content, **arrays)
    path = path_of(cache, key)
    make_folder(path.parent)
    write_whole(path, content.getvalue(), force=True)


def read_entry(cache: Path, key: str, *, factors: bool = False) -> Entry | None:
    """Return an entry, with its factors if asked for; None where there is none, or it is spoilt."""
    path = path_of(cache, key)
    if not path.exists():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            told = json.loads(archive["told"].tobytes())
            arrays = {n: archive[n] for n in archive.files if n != "told"} if factors else {}
        if told["form"] != FORM:
            return None
        record, failure = told["record"], told["failure"]
        return Entry(
            record=None if record is None else _record(record),
            failure=None if failure is None else FlightFailure(**failure),
            hardware=told["hardware"],
            factors=arrays,
        )
    except SPOILT:
        return None


def _plain(record: FlightRecord) -> dict[str, Any]:
    fields = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    return {**plain, "checks": dict(record.checks)}


def _record(plain: Mapping[str, Any]) -> FlightRecord:
    fields = dict(plain)
    fields |= {name: np.array(fields[name], dtype=float) for name in _ARRAYS}
    fields |= {name: _shared(tuple(fields[name])) for name in _TUPLES}
    size = len(fields["compared"])
    fields["covariance"] = fields["covariance"].reshape(size, size)
    return FlightRecord(**fields)


@lru_cache(maxsize=1000)
def _shared(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the same words for equal ones: thousands of records have the names of one."""
    return words


def make_folder(folder: Path) -> None:
    """Make a folder where there is none.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error.strerror})") from error
