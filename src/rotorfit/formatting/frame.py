"""Columns as a pandas frame, where pandas is installed."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from rotorfit.errors import OutputError

DataFrame = Any
"""Of pandas, which need not be installed."""


def frame(columns: Mapping[str, Sequence[Any]]) -> DataFrame:
    """Return columns of one length as a pandas DataFrame.

    Raises
    ------
    OutputError
        If pandas is not installed.
    """
    return pandas().DataFrame(dict(columns))


def pandas() -> Any:
    """Return the module pandas.

    Raises
    ------
    OutputError
        If it is not installed.
    """
    try:
        return import_module("pandas")
    except ImportError as error:
        raise OutputError(
            f"a frame needs pandas ({error}): pip install pandas, then call this again"
        ) from error
