"""A TOML file to plain tables, its short forms written out."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, cast

from rotorfit.errors import ExperimentError
from rotorfit.logs.read import kind_of

MOST_VALUES: Final = 20_000
"""In one file; each that is wrong would be told, at a kilobyte or two."""


def file_as_table(data: Any, key: str) -> Any:
    """Return the table with one plain file name written out as a table."""
    if not isinstance(data, dict):
        return data
    table = dict(cast("dict[str, Any]", data))
    if isinstance(table.get(key), str):
        table[key] = {"file": table[key]}
    return table


def files_as_tables(data: Any, keys: tuple[str, ...]) -> Any:
    """Return the table with plain file names written out as tables."""
    if not isinstance(data, dict):
        return data
    table = dict(cast("dict[str, Any]", data))
    for key in keys:
        entries = table.get(key)
        if isinstance(entries, list):
            rows = cast("list[Any]", entries)
            table[key] = [{"file": row} if isinstance(row, str) else row for row in rows]
    return table


def with_known_motors(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the tables with law and lag of ``[motors]`` from a result, where one is named.

    Parameters
    ----------
    tables
        Of an experiment or airframe file. What its ``[motors]`` says itself stands.
    folder
        From which the result's path is.

    Raises
    ------
    ExperimentError
        If the file is not a result that tells the motors' law.
    """
    motors = tables.get("motors")
    if not isinstance(motors, dict) or "result" not in motors:
        return tables
    own = dict(cast("dict[str, Any]", motors))
    known = _known_motors(own.pop("result"), folder)
    if own.get("speed", "commanded") != "commanded":
        raise ExperimentError(
            'motors.result gives law and lag for flights on commands: speed = "commanded", or '
            "leave result out"
        )
    if "lag" in own:
        known.pop("lag_std", None)
    return {**tables, "motors": {**known, **own}}


def _known_motors(name: Any, folder: Path) -> dict[str, Any]:
    """Return the table ``[motors]`` that a result has for flights without rotor speed."""
    if not isinstance(name, str):
        raise ExperimentError(
            f"motors.result is {name!r}, expected the path of a result that identify -o wrote"
        )
    path = folder / name
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["command_law"]
        motors = None if found is None else dict(cast("dict[str, Any]", found["motors"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ExperimentError(
            f"motors.result: {path} is not a result with the motors' law ({error}); give the JSON "
            "file that identify -o wrote of a log with commands and measured rotor speeds"
        ) from error
    if not motors:
        raise ExperimentError(
            f"motors.result: {path.name} has no law from command to rotor speed; identify a log "
            "with commands and measured rotor speeds, or give law under [motors]"
        )
    return motors


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a file.

    Raises
    ------
    ExperimentError
        If it is missing or not TOML.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ExperimentError(
            f"no file {path}; give the path of an airframe file (rotorfit airframe LOG writes one) "
            "or of an experiment file"
        ) from None
    except IsADirectoryError:
        raise ExperimentError(f"{path} is a folder; give the TOML file in it") from None
    except (OSError, UnicodeDecodeError) as error:
        why = f"{path} cannot be read as text ({error}); expected TOML"
        raise ExperimentError(_in_place_of_toml(path) or why) from error
    try:
        tables = tomllib.loads(text)
    # Besides its own errors, tomllib gives a number of 4300 digits or deep nesting to Python.
    except (ValueError, RecursionError) as error:
        why = f"{path} is not valid TOML: {error}"
        raise ExperimentError(_in_place_of_toml(path) or why) from error
    refuse_too_many_values(tables, path)
    return tables


def refuse_too_many_values(tables: Mapping[str, Any], source: Path) -> None:
    """Raise where tables hold more than any experiment does."""
    if (count := _values(tables)) > MOST_VALUES:
        raise ExperimentError(
            f"{source} holds {count} values, expected at most {MOST_VALUES}; flights, rotors and "
            "laws are named in an experiment file, their data stay in the logs"
        )


def _in_place_of_toml(path: Path) -> str | None:
    """Return what a file is that is no TOML, and what would be right; None where that is open.

    A file that is called TOML is one, with a mistake that Python names.
    """
    kind = None if path.suffix == ".toml" else kind_of(path)
    if kind is None:
        return None
    return f"{path}: this is {kind}; give an airframe or experiment file (.toml) in its place"


def _values(tables: Mapping[str, Any]) -> int:
    """Return how many values there are, at any depth."""
    count, left = 0, list[Any](tables.values())
    while left:
        value = left.pop()
        count += 1
        if isinstance(value, dict):
            left.extend(cast("dict[str, Any]", value).values())
        elif isinstance(value, list):
            left.extend(cast("list[Any]", value))
    return count
