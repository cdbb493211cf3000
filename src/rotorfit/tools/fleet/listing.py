"""List the logs of a fleet: all of a folder, or those of a table."""

from __future__ import annotations

import csv
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.errors import ExperimentError, LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import read_bytes
from rotorfit.logs.formats import FORMATS
from rotorfit.logs.read import format_of
from rotorfit.written_mass import EXAMPLES, Mass, read_mass

if TYPE_CHECKING:
    import re
    from collections.abc import Iterator, Mapping

COLUMNS: Final = ("file", "vehicle", "configuration", "mass", "airframe", "log")
"""Columns of a table of logs; all but the first may be left out."""
EXPECTED: Final = (
    f"expected a CSV with the columns {', '.join(COLUMNS)} (all but file may be left out)"
)
SUFFIXES: Final = frozenset(suffix for form in FORMATS for suffix in form.suffixes)
"""Suffixes of files that are logs by their names, so that one that cannot be read is reported."""
BAG: Final = "metadata.yaml"
"""A file in every folder that is one recording of ROS 2."""


@frozen_dataclass
class FlightTask:
    """One log to identify: all that its numbers depend on, but for the bytes of the files.

    `log_number` is None where the file may hold several.
    """

    file: str
    airframe: str
    mass: Mass
    log_number: int | None = None


@frozen_dataclass
class ListedLog:
    """A log of a fleet, `name` as in tables and page; `vehicle` None: by the log, or its folder."""

    name: str
    task: FlightTask
    vehicle: str | None = None
    configuration: str = "A"


@frozen_dataclass
class Defaults:
    """What holds for every log for which no table gives it."""

    mass: Mass | None = None
    airframe: Path | None = None
    vehicle_of: re.Pattern[str] | None = None


def listed_logs(
    source: Path, defaults: Defaults, *, excluded: Path | None = None
) -> tuple[ListedLog, ...]:
    """List the logs of a folder and its subfolders but for one, or of a table (CSV, `COLUMNS`).

    Paths in a table count from its folder. Raises `ExperimentError` where there is no log, the
    table is none, or mass or airframe are missing.
    """
    if not source.exists():
        raise ExperimentError(
            f"{source}: no such file or folder: name a folder with logs, or a table of them (CSV)"
        )
    rows = (
        [{"file": str(path)} for path in _logs_in(source, excluded)]
        if source.is_dir()
        else _rows_of(source)
    )
    if not rows:
        raise ExperimentError(f"{source}: there is no flight log in it; check the folder")
    base = source if source.is_dir() else source.parent
    logs = [_list_row(row, base, defaults) for row in rows]
    logs.sort(key=lambda log: (log.name, log.task.log_number or 0))
    for one, other in pairwise(logs):
        if (one.task.file, one.task.log_number) == (other.task.file, other.task.log_number):
            raise ExperimentError(f"{source}: {one.name} is listed twice; it would count twice")
    return tuple(logs)


def _logs_in(folder: Path, excluded: Path | None) -> Iterator[Path]:
    """Yield every log under a folder; a folder that is a bag counts as one."""
    for path in sorted(folder.iterdir()):
        hidden = path.name.startswith(".")
        if hidden or (excluded is not None and path.absolute() == excluded.absolute()):
            continue
        if path.is_dir() and not (path / BAG).exists():
            yield from () if path.is_symlink() else _logs_in(path, excluded)
        elif not (path.is_file() or path.is_dir()):
            continue  # a pipe would be waited for
        elif path.suffix.lower() in SUFFIXES or ((f := format_of(path)) and f.certain):
            yield path


def _rows_of(table: Path) -> list[dict[str, str]]:
    try:
        text = read_bytes(table).decode("utf-8-sig")
        rows = list(csv.DictReader(StringIO(text)))
        names = [str(name) for name in csv.DictReader(StringIO(text)).fieldnames or []]
    except (LogError, UnicodeDecodeError, csv.Error) as error:
        raise ExperimentError(f"{table}: no table of logs ({error}): {EXPECTED}") from error
    unknown = [name for name in names if name not in COLUMNS]
    if "file" not in names or unknown:
        met = f"column {unknown[0]!r}" if unknown else "no column file"
        raise ExperimentError(f"{table}: {met}; {EXPECTED}")
    for number, row in enumerate(rows, start=2):
        if not (row["file"] or "").strip() or None in row:
            raise ExperimentError(f"{table}, line {number}: no file named, or too many cells")
    return [{key: (value or "").strip() for key, value in row.items()} for row in rows]


def _list_row(row: Mapping[str, str], base: Path, defaults: Defaults) -> ListedLog:
    """Return one log, its row completed by the defaults."""
    path = base / row["file"] if base not in Path(row["file"]).parents else Path(row["file"])
    name = path.relative_to(base).as_posix() if path.is_relative_to(base) else str(path)
    vehicle, configuration = _by_pattern(name, defaults.vehicle_of)
    airframe = _airframe_of_cell(row.get("airframe", ""), base, defaults)
    return ListedLog(
        name=name,
        task=FlightTask(
            file=str(path.absolute()),
            airframe=str(airframe.absolute()),
            mass=_mass_of_cell(row.get("mass", ""), name, defaults),
            log_number=_log_number(row.get("log", ""), name),
        ),
        vehicle=row.get("vehicle") or vehicle,
        configuration=row.get("configuration") or configuration or "A",
    )


def _by_pattern(name: str, pattern: re.Pattern[str] | None) -> tuple[str | None, str | None]:
    """Extract vehicle and configuration from a path by the pattern."""
    if pattern is None:
        return None, None
    found = pattern.search(name)
    if found is None:
        raise ExperimentError(
            f"--vehicle-of {pattern.pattern!r} does not match {name}: give a pattern that every "
            "path matches, or a table with a column vehicle"
        )
    named = found.groupdict()
    first = found[1] if pattern.groups and not named else found[0]
    return named.get("vehicle", first), named.get("configuration")


def _airframe_of_cell(cell: str, base: Path, defaults: Defaults) -> Path:
    if cell:
        return base / cell
    if defaults.airframe is None:
        raise ExperimentError(
            "no airframe is given: add --airframe FILE (rotorfit airframe LOG writes one), or a "
            "table with a column airframe"
        )
    return defaults.airframe


def _mass_of_cell(cell: str, name: str, defaults: Defaults) -> Mass:
    if not cell:
        if defaults.mass is None:
            raise ExperimentError(
                f"{name}: no mass is given: add --mass KG, a table with a column mass, or "
                "--mass unknown (all numbers are per kilogram then)"
            )
        return defaults.mass
    subject = f"the mass of {name}"
    try:
        return read_mass(cell, subject)
    except ValueError:
        raise ExperimentError(f"{subject} is {cell!r}; expected {EXAMPLES}") from None


def _log_number(cell: str, name: str) -> int | None:
    if not cell:
        return None
    if not cell.isdecimal() or int(cell) < 1:
        raise ExperimentError(f"{name}: log is {cell!r}; expected a number from 1")
    return int(cell)
