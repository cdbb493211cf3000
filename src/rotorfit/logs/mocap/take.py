"""A motion-capture take: rigid bodies with a pose in each frame.

The simplest are read here: trajectories in the form of the TUM RGB-D benchmark, t x y z qx qy qz
qw, one pose a line, also as CSV under a row of names ``t,x,y,z,qx,qy,qz,qw``. Seconds, metres, body
to world with z up.
"""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import field
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.delimited import DelimitedText, with_line_feeds
from rotorfit.logs.files import read_bytes
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.logs.table import resolution_of
from rotorfit.logs.units import Axes, attitude_to_flu, unit_or_nan, vectors_to_flu

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from jaxtyping import Bool, Float

    from rotorfit.logs.columns import ColumnSpec

LENGTHS: Final[Mapping[str, float]] = {
    "meters": 1.0,
    "centimeters": 1e-2,
    "millimeters": 1e-3,
    "inches": 0.0254,
    "feet": 0.3048,
}
"""Metres in the units of length that motion-capture programs export."""

_NAMES_SHOWN: Final = 12


@frozen_dataclass
class Body:
    """One rigid body: position of its tracked point, world with z up [m], attitude to that world.

    NaN where it was not seen.
    """

    position: Float[np.ndarray, "n 3"]
    attitude_wxyz: Float[np.ndarray, "n 4"]


@frozen_dataclass
class Take:
    """One recording: bodies by name (empty if the file has no names), times of the frames [s].

    `format` is the name of the reader, `source` says units and axes of the file.
    """

    format: str
    time: Float[np.ndarray, " n"]
    bodies: Mapping[str, Body]
    source: str
    metadata: Mapping[str, str] = field(default_factory=dict[str, str])
    notes: tuple[str, ...] = ()


def log_of_file(
    path: Path,
    take_of: Callable[[bytes], Take],
    *,
    columns: Mapping[str, ColumnSpec] | None = None,
    axes: Axes = "FLU",
) -> FlightLog:
    """Return the pose of one rigid body of a file as a log."""
    data = read_bytes(path)
    try:
        body = chosen_body(columns, axes)
        return _log_of_take(path, data, take_of(with_line_feeds(data)), body=body)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error.__cause__


def _log_of_take(path: Path, data: bytes, take: Take, *, body: str | None) -> FlightLog:
    name = _choose_body(take, body)
    chosen = take.bodies[name]
    _refuse_wrong_clock(take.time)
    pose = np.concatenate([chosen.position, chosen.attitude_wxyz], axis=1)
    seen: Bool[np.ndarray, " n"] = ~np.any(np.isnan(pose), axis=1)
    label = f"body {name!r}" if name else "body"
    if np.count_nonzero(seen) < 2:
        raise LogError(
            f"the {label} is seen in {np.count_nonzero(seen)} of {len(seen)} frames: check "
            "that it was tracked, and export it again"
        )
    lost = len(seen) - np.count_nonzero(seen)
    notes = list(take.notes)
    if lost:
        notes.append(f"The {label} is not seen in {lost} of {len(seen)} frames.")
    if len(take.bodies) > 1:
        others = ", ".join(repr(other) for other in take.bodies if other != name)
        notes.append(f"Read the body {name!r}; the file also has {_shorten_names(others)}.")
    source = f"{label}, {take.source}" if name else take.source
    values = {"position": chosen.position, "attitude": chosen.attitude_wxyz}
    return FlightLog(
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        format=take.format,
        channels={
            channel: Channel(
                time=take.time[seen],
                values=columns[seen],
                source=source,
                resolution=resolution_of(columns[seen]) if channel == "position" else None,
            )
            for channel, columns in values.items()
        },
        seconds=float(take.time[-1] - take.time[0]),
        metadata=take.metadata,
        notes=tuple(notes),
    )


def chosen_body(columns: Mapping[str, ColumnSpec] | None, axes: Axes) -> str | None:
    """Choose the rigid body that a columns map names; refuse axes and other entries."""
    if axes != "FLU":
        raise LogError("the file says its own axes, turned to z up: leave out axes")
    chosen = dict(columns or {})
    spec = chosen.pop("position", None)
    if chosen:
        raise LogError(
            "the file names its own columns; a columns map only chooses the rigid body, as "
            'columns = { position = "NAME" }'
        )
    return None if spec is None else spec.name


def numbers(
    text: bytes, start: int, *, columns: int, delimiter: str | None, first_line: int
) -> Float[np.ndarray, "n k"]:
    """Read the rows of numbers that begin at `start` of a text; NaN for empty cells."""
    names = tuple(str(column) for column in range(columns))
    table = DelimitedText(
        text=text, start=start, names=names, delimiter=delimiter, first_line=first_line
    )
    values = table.numbers(names)
    if len(values) < 2:
        raise LogError(f"{len(values)} frames below the header: nothing was recorded")
    return values


def number_or_nan(word: str) -> float:
    """Parse a number; NaN for what is none."""
    try:
        return float(word)
    except ValueError:
        return float("nan")


def finite(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Return values with NaN for what overflowed."""
    return np.where(np.isfinite(values), values, np.nan)


def _choose_body(take: Take, body: str | None) -> str:
    names = list(take.bodies)
    listed = _shorten_names(", ".join(repr(name) for name in names))
    if not names:
        raise LogError(
            "the file has no rigid body, only markers: define a rigid body on the vehicle and "
            "export its position and rotation"
        )
    if body is None and len(names) > 1:
        raise LogError(
            f"the file has {len(names)} rigid bodies ({listed}): say which one flew, as "
            f'columns = {{ position = "{names[0]}" }}'
        )
    if body is not None and body not in names:
        raise LogError(f"no rigid body {body!r}; the file has {listed}")
    return names[0] if body is None else body


def _shorten_names(names: str) -> str:
    parts = names.split(", ")
    more = len(parts) - _NAMES_SHOWN
    clean = ", ".join(part[:40] for part in parts[:_NAMES_SHOWN])
    return f"{clean} and {more} more" if more > 0 else clean


def _refuse_wrong_clock(time: Float[np.ndarray, " n"]) -> None:
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise LogError(f"frame {row + 1} has no time: export the recording again")
    steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0))
        raise LogError(
            f"time goes back after frame {row + 1}, from {time[row]:.9g} to {time[row + 1]:.9g} s: "
            "keep one recording a file"
        )
    if not (steps > 0).any():
        raise LogError(f"all {len(time)} frames have the time {time[0]:.9g} s: the clock stands")


_COLUMNS: Final = 8
_OFF_LENGTH: Final = 0.02
_TIMES: Final = frozenset({"t", "time", "timestamp", "timestamps", "stamp"})
_UNIT: Final = re.compile(r"\s*[\[(]\s*(?:s|sec|m)?\s*[\])]$")
_PLACES: Final = ("xyz", ("tx", "ty", "tz"), ("px", "py", "pz"))
_DELIMITERS: Final = (",", ";", "\t")


def is_trajectory(head: bytes) -> bool:
    """Return whether bytes from the beginning of a file are poses, eight numbers a line."""
    text = with_line_feeds(head) if not head.startswith((b"\xff\xfe", b"\xfe\xff")) else b""
    if b"\0" in text:
        return False
    try:
        start, _, delimiter, _ = _find_beginning(text)
    except LogError:
        return False
    # A row without a pose, NaN or a zero quaternion, says nothing: the first pose decides.
    for row in text[start:].split(b"\n"):
        if not row.strip() or row.lstrip().startswith((b"#", b"%")):
            continue
        pose = [number_or_nan(cell) for cell in _split_cells(row, delimiter)]
        if len(pose) != _COLUMNS or not math.isfinite(pose[0]):
            return False
        if _is_pose(pose):
            return abs(math.hypot(*pose[4:]) - 1.0) < _OFF_LENGTH
    return False


def _is_pose(row: Sequence[float]) -> bool:
    """Return whether a row has numbers, and a quaternion that is not all zeros."""
    return all(map(math.isfinite, row)) and any(row[4:])


def read_trajectory(path: Path, *, axes: Axes = "FLU") -> FlightLog:
    """Read a trajectory in TUM's form."""
    return log_of_file(path, lambda text: _read_poses(text, axes))


def _read_poses(text: bytes, axes: Axes) -> Take:
    start, line, delimiter, header = _find_beginning(text)
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


def _find_beginning(text: bytes) -> tuple[int, int, str | None, str]:
    """Find where the poses begin: offset, line number, delimiter; and the row of names."""
    start, line, header = 0, 1, ""
    while start < len(text):
        end = text.find(b"\n", start)
        row = text[start : end if end >= 0 else len(text)]
        words = row.decode("utf-8", "replace").strip()
        if words and not words.startswith(("#", "%")):
            delimiter = next((mark for mark in _DELIMITERS if words.count(mark) == 7), None)
            cells = _split_cells(row, delimiter)
            if math.isfinite(number_or_nan(cells[0])) and all(map(_is_number, cells)):
                return start, line, delimiter, header
            if header or not _are_names(cells):
                break
            header = words
        start, line = start + len(row) + 1, line + 1
    raise LogError("no poses: expected lines of t x y z qx qy qz qw")


def _split_cells(row: bytes, delimiter: str | None) -> list[str]:
    words = row.decode("utf-8", "replace").strip()
    return [cell.strip().strip('"') for cell in words.split(delimiter)]


def _is_number(cell: str) -> bool:
    """Return whether a cell is empty or a number, finite or not."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True


def _are_names(cells: list[str]) -> bool:
    """Return whether a row names time, position and quaternion in TUM's order."""
    names = [_UNIT.sub("", cell.strip().lower()) for cell in cells]
    return (
        len(names) == _COLUMNS
        and names[0] in _TIMES
        and any(names[1:4] == list(place) for place in _PLACES)
        and names[4:] == ["qx", "qy", "qz", "qw"]
    )
