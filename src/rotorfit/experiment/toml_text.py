"""Plain tables to the text of an experiment file: what `toml_files` reads."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
WIDEST: Final = 88
"""Of a list on one line [characters]."""


def experiment_text(tables: Mapping[str, Any]) -> str:
    """Return the text of an experiment or airframe file; what is None is left out.

    Parameters
    ----------
    tables
        As `read_toml` returns them: text, numbers, lists and tables.
    """
    plain = [f"{_key(k)} = {_value(v)}" for k, v in tables.items() if not _is_table(v)]
    blocks = ["\n".join(plain)] if plain else []
    for key, value in tables.items():
        if isinstance(value, Mapping):
            blocks.append(_block(f"[{_key(key)}]", cast("Mapping[str, Any]", value)))
        elif _is_table(value):
            blocks += [_block(f"[[{_key(key)}]]", one) for one in value]
    return "\n\n".join(blocks) + "\n"


def _is_table(value: Any) -> bool:
    """Return whether a value has a head of its own, or is nothing at all."""
    if not isinstance(value, list):
        return value is None or isinstance(value, Mapping)
    rows = cast("list[Any]", value)
    return len(rows) > 0 and all(isinstance(row, Mapping) for row in rows)


def _block(head: str, table: Mapping[str, Any]) -> str:
    lines = [f"{_key(k)} = {_value(v)}" for k, v in table.items() if v is not None]
    return "\n".join([head, *lines])


def _value(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            # A basic string of TOML is one of JSON, but for DEL.
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case Mapping():
            table = cast("Mapping[str, Any]", value)
            pairs = [f"{_key(k)} = {_value(v)}" for k, v in table.items() if v is not None]
            return "{ " + ", ".join(pairs) + " }"
        case list() | tuple():
            return _list([_value(one) for one in cast("Sequence[Any]", value)])
        case _:
            return repr(value)


def _list(words: Sequence[str]) -> str:
    line = f"[{', '.join(words)}]"
    if len(line) <= WIDEST:
        return line
    return "\n".join(["[", *(f"  {word}," for word in words), "]"])


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)
