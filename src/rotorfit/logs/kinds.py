"""What a file is that stands in the wrong place: named, so that the right one is found."""

import json
import tomllib
from pathlib import Path
from typing import Any, Final, cast

LARGEST: Final = 4_000_000
"""Bytes of a file that is looked into."""
TRUTH_FILE: Final = "the truth of a simulated flight"
_TABLES: Final = (
    ("configuration", "an experiment file"),
    ("airframe", "an airframe file"),
    ("motors", "an airframe file"),
)
_FIELDS: Final = (
    ({"parameters", "covariance"}, "a result of rotorfit identify"),
    ({"shared", "configurations"}, TRUTH_FILE),
    ({"candidates"}, "a plan of rotorfit plan"),
    ({"rate_errors"}, "what rotorfit fly found"),
    ({"schema", "values", "units"}, "a file of drawn vehicles (rotorfit export)"),
)


def own_kind(path: Path) -> str | None:
    """Return which of rotorfit's own files a file is, in words; None where it is none.

    Never raises: it is asked when something else is wrong already.
    """
    try:
        if path.stat().st_size > LARGEST:
            return None
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError):
        return None
    return _of_json(text) if text.lstrip()[:1] == "{" else _of_toml(text)


def _of_toml(text: str) -> str | None:
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError):
        return None
    return next((words for key, words in _TABLES if key in tables), None)


def _of_json(text: str) -> str | None:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return None
    keys = set(cast("dict[str, Any]", data)) if isinstance(data, dict) else set[str]()
    return next((words for fields, words in _FIELDS if fields <= keys), None)
