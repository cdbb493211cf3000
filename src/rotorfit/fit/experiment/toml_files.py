"""TOML files as plain tables: read with their short forms written out, and written.

Of the libraries, tomli-w writes every list over several lines and inner tables under heads of
their own, and tomlkit wants each of them built by hand: users would see another file, or there
would be as much code.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, cast

from rotorfit.errors import ExperimentError

if TYPE_CHECKING:
    from pathlib import Path

    from rotorfit.logs.formats import ReadOptions

MOST_VALUES: Final = 20_000
"""Most values in one file; each that is wrong would be reported, at a kilobyte or two."""
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
CURLY: Final = frozenset("\u2018\u2019\u201c\u201d")
"""Quotes that word processors write for straight ones."""
WIDEST: Final = 88
"""Widest list on one line [characters]."""


def file_as_table(data: Any, key: str) -> Any:
    """Write out one plain file name of a table as a table."""
    if not isinstance(data, dict):
        return data
    table = dict(cast("dict[str, Any]", data))
    if isinstance(table.get(key), str):
        table[key] = {"file": table[key]}
    return table


def files_as_tables(data: Any, keys: tuple[str, ...]) -> Any:
    """Write out lists of plain file names of a table as tables."""
    if not isinstance(data, dict):
        return data
    table = dict(cast("dict[str, Any]", data))
    for key in keys:
        entries = table.get(key)
        if isinstance(entries, list):
            rows = cast("list[Any]", entries)
            table[key] = [{"file": row} if isinstance(row, str) else row for row in rows]
    return table


def with_payload_masses(data: Any) -> Any:
    """Write out the mass of configurations that have a payload and none: with the bare one's."""
    if not isinstance(data, dict):
        return data
    tables = dict(cast("dict[str, Any]", data))
    listed = tables.get("configuration")
    if not isinstance(listed, list):
        return tables
    entries = cast("list[Any]", listed)
    known = [cast("dict[str, Any]", one) for one in entries if isinstance(one, dict)]
    return {**tables, "configuration": [_with_payload_mass(one, known) for one in entries]}


def _with_payload_mass(entry: Any, known: Sequence[dict[str, Any]]) -> Any:
    if not isinstance(entry, dict) or "mass" in entry:
        return cast("Any", entry)
    own = cast("dict[str, Any]", entry)
    bare = (one for one in known if one.get("name", "A") == own.get("payload_of"))
    try:
        parts = [next(bare)["mass"], *(item["mass"] for item in own["payload"])]
        return {**own, "mass": sum(map(float, parts))}
    except (StopIteration, KeyError, TypeError, ValueError):
        return own  # what is missing or no number is said where the tables are checked


def with_known_motors(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Take law and lag of ``[motors]`` from a result, where one is named by its path from a folder.

    What ``[motors]`` gives itself stands.
    """
    motors = tables.get("motors")
    if not isinstance(motors, dict) or "result" not in motors:
        return tables
    given = dict(cast("dict[str, Any]", motors))
    known = _known_motors(given.pop("result"), folder)
    if given.get("speed", "commanded") != "commanded":
        raise ExperimentError(
            'motors.result gives law and lag for flights on commands: speed = "commanded", or '
            "leave result out"
        )
    if "lag" in given:
        known.pop("lag_std", None)
    return {**tables, "motors": {**known, **given}}


def _known_motors(name: Any, folder: Path) -> dict[str, Any]:
    """Read the table ``[motors]`` that a result has for flights without rotor speed."""
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
    """Read the tables of a file; raise ExperimentError if it is missing or not TOML."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ExperimentError(
            f"no file {path}; give the path of an airframe file (rotorfit airframe LOG writes one) "
            "or of an experiment file"
        ) from None
    except IsADirectoryError:
        raise ExperimentError(f"{path} is a folder; give the TOML file in it") from None
    except UnicodeDecodeError as error:
        why = f"{path} is not text in UTF-8, as TOML is: save it anew with that encoding"
        raise ExperimentError(_other_kind(path) or why) from error
    except OSError as error:
        why = f"{path} cannot be read as text ({error}); expected TOML"
        raise ExperimentError(_other_kind(path) or why) from error
    try:
        tables = tomllib.loads(text)
    # Besides its own errors, tomllib gives a number of 4300 digits or deep nesting to Python.
    except (ValueError, RecursionError) as error:
        curly = "; write straight quotes instead of curly ones" if CURLY & set(text) else ""
        why = f"{path} is not valid TOML: {error}{curly}"
        raise ExperimentError(_other_kind(path) or why) from error
    refuse_too_many_values(tables, path)
    return tables


def refuse_too_many_values(tables: Mapping[str, Any], source: Path) -> None:
    """Raise an error if tables hold more than any experiment does."""
    if (count := _count_values(tables)) > MOST_VALUES:
        raise ExperimentError(
            f"{source} holds {count} values, expected at most {MOST_VALUES}; flights, rotors and "
            "laws are named in an experiment file, their data stay in the logs"
        )


def _other_kind(path: Path) -> str | None:
    """Explain which kind a file is that is no TOML; None if it is called TOML or unknown."""
    from rotorfit.logs.read import kind_of

    kind = None if path.suffix == ".toml" else kind_of(path)
    if kind is None:
        return None
    return f"{path}: this is {kind}; give an airframe or experiment file (.toml) in its place"


def _count_values(tables: Mapping[str, Any]) -> int:
    count, left = 0, list[Any](tables.values())
    while left:
        value = left.pop()
        count += 1
        if isinstance(value, dict):
            left.extend(cast("dict[str, Any]", value).values())
        elif isinstance(value, list):
            left.extend(cast("list[Any]", value))
    return count


def experiment_text(tables: Mapping[str, Any]) -> str:
    """Write tables as `read_toml` returns them into the text of a file; None is left out."""
    plain = [f"{_toml_key(k)} = {_toml_value(v)}" for k, v in tables.items() if not _is_table(v)]
    blocks = ["\n".join(plain)] if plain else []
    for key, value in tables.items():
        if isinstance(value, Mapping):
            blocks.append(_table_block(f"[{_toml_key(key)}]", cast("Mapping[str, Any]", value)))
        elif _is_table(value):
            blocks += [_table_block(f"[[{_toml_key(key)}]]", one) for one in value]
    return "\n\n".join(blocks) + "\n"


def _is_table(value: Any) -> bool:
    """Decide whether a value has a head of its own, or is nothing at all."""
    if not isinstance(value, list):
        return value is None or isinstance(value, Mapping)
    rows = cast("list[Any]", value)
    return len(rows) > 0 and all(isinstance(row, Mapping) for row in rows)


def _table_block(head: str, table: Mapping[str, Any]) -> str:
    """Write a table; a map of tables in it that is too long for a line has a head of its own."""
    long = {
        key: cast("Mapping[str, Any]", value)
        for key, value in table.items()
        if head[1] != "[" and _is_long_map(value)
    }
    short = {key: value for key, value in table.items() if key not in long and value is not None}
    lines = [f"{_toml_key(k)} = {_toml_value(v)}" for k, v in short.items()]
    inner = [_table_block(f"{head[:-1]}.{_toml_key(k)}]", v) for k, v in long.items()]
    return "\n\n".join(["\n".join([head, *lines]), *inner])


def _is_long_map(value: Any) -> bool:
    if not isinstance(value, Mapping):
        return False
    parts = cast("Mapping[str, Any]", value).values()
    return all(isinstance(part, Mapping) for part in parts) and len(_toml_value(value)) > WIDEST


def _toml_value(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            # A basic string of TOML is one of JSON, but for DEL.
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case Mapping():
            table = cast("Mapping[str, Any]", value)
            pairs = [
                f"{_toml_key(k)} = {_toml_value(v)}" for k, v in table.items() if v is not None
            ]
            return "{ " + ", ".join(pairs) + " }"
        case list() | tuple():
            return _toml_list([_toml_value(one) for one in cast("Sequence[Any]", value)])
        case _:
            return repr(value)


def _toml_list(values: Sequence[str]) -> str:
    line = f"[{', '.join(values)}]"
    if len(line) <= WIDEST:
        return line
    return "\n".join(["[", *(f"  {value}," for value in values), "]"])


def _toml_key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _toml_value(name)


def table_of_options(options: ReadOptions) -> dict[str, Any]:
    """Write the columns and axes of a reader's options as a ``[table]``, without its defaults."""
    columns = {
        name: {
            "name": spec.name,
            "unit": spec.unit,
            "scale": None if spec.scale == 1 else spec.scale,
            "offset": None if spec.offset == 0 else spec.offset,
            "range": None if spec.range is None else list(spec.range),
        }
        for name, spec in (options.columns or {}).items()
    }
    known = {k: {n: v for n, v in one.items() if v is not None} for k, one in columns.items()}
    return {"axes": options.axes, "columns": known}
