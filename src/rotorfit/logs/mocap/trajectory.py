"""Trajectories in the form of the TUM RGB-D benchmark: t x y z qx qy qz qw, one pose a line.

Also the same eight columns under a row of names, as CSV ``t,x,y,z,qx,qy,qz,qw``. Seconds, metres,
body to world with z up.
"""

import math
import re
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.axes import Axes, attitude_to_flu, unit_or_nan, vectors_to_flu
from rotorfit.logs.delimited import with_line_feeds
from rotorfit.logs.flight_log import FlightLog
from rotorfit.logs.mocap.take import (
    Body,
    Take,
    finite,
    log_of_file,
    number_or_nan,
    numbers,
)

_COLUMNS: Final = 8
_OFF_LENGTH: Final = 0.02
_TIMES: Final = frozenset({"t", "time", "timestamp", "timestamps", "stamp"})
_UNIT: Final = re.compile(r"\s*[\[(]\s*(?:s|sec|m)?\s*[\])]$")
_PLACES: Final = ("xyz", ("tx", "ty", "tz"), ("px", "py", "pz"))
_DELIMITERS: Final = (",", ";", "\t")


def is_trajectory(head: bytes) -> bool:
    """Tell whether bytes from the beginning of a file are poses, eight numbers a line."""
    text = with_line_feeds(head) if not head.startswith((b"\xff\xfe", b"\xfe\xff")) else b""
    if b"\0" in text:
        return False
    try:
        start, _, delimiter, _ = _beginning(text)
    except LogError:
        return False
    cells = _cells(text[start:].partition(b"\n")[0], delimiter)
    pose = [number_or_nan(cell) for cell in cells]
    return (
        len(pose) == _COLUMNS
        and bool(np.isfinite(pose).all())
        and abs(math.hypot(*pose[4:]) - 1.0) < _OFF_LENGTH
    )


def read_trajectory(path: Path, *, axes: Axes = "FLU") -> FlightLog:
    """Read a trajectory in TUM's form."""
    return log_of_file(path, lambda text: _take(text, axes))


def _take(text: bytes, axes: Axes) -> Take:
    start, line, delimiter, header = _beginning(text)
    values = numbers(text, start, columns=_COLUMNS, delimiter=delimiter, first_line=line)
    attitude = attitude_to_flu(unit_or_nan(values[:, [7, 4, 5, 6]]), axes)
    position = vectors_to_flu(finite(values[:, 1:4]), axes)
    return Take(
        format="trajectory",
        time=values[:, 0],
        bodies={"": Body(position=position, attitude_wxyz=attitude)},
        source=f"columns t x y z qx qy qz qw [s, m], axes {axes}",
        metadata={"columns": header} if header else {},
    )


def _beginning(text: bytes) -> tuple[int, int, str | None, str]:
    """Find where the poses begin: offset, line number, delimiter; and the row of names."""
    start, line, header = 0, 1, ""
    while start < len(text):
        end = text.find(b"\n", start)
        row = text[start : end if end >= 0 else len(text)]
        words = row.decode("utf-8", "replace").strip()
        if words and not words.startswith(("#", "%")):
            delimiter = next((mark for mark in _DELIMITERS if words.count(mark) == 7), None)
            cells = _cells(row, delimiter)
            if all(np.isfinite(number_or_nan(cell)) for cell in cells):
                return start, line, delimiter, header
            if header or not _are_names(cells):
                break
            header = words
        start, line = start + len(row) + 1, line + 1
    raise LogError("no poses: expected lines of t x y z qx qy qz qw")


def _cells(row: bytes, delimiter: str | None) -> list[str]:
    words = row.decode("utf-8", "replace").strip()
    return [cell.strip().strip('"') for cell in words.split(delimiter)]


def _are_names(cells: list[str]) -> bool:
    """Tell whether a row names time, position and quaternion in TUM's order."""
    names = [_UNIT.sub("", cell.strip().lower()) for cell in cells]
    return (
        len(names) == _COLUMNS
        and names[0] in _TIMES
        and any(names[1:4] == list(place) for place in _PLACES)
        and names[4:] == ["qx", "qy", "qz", "qw"]
    )
