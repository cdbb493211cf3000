"""A file to a FlightLog; one module per format.

A name is imported when it is first used: `rotorfit.logs.files` alone refuses a missing file.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorfit.logs.columns import ColumnSpec as ColumnSpec
    from rotorfit.logs.formats import ReadOptions as ReadOptions
    from rotorfit.logs.read import read_log as read_log

_MODULES = {"ColumnSpec": "columns", "ReadOptions": "formats", "read_log": "read"}


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
