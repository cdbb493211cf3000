"""Vicon Nexus and Tracker, exported CSV of segments or objects: z up, a row a frame.

Blocks stand below each other, a blank line between them: what the block holds, frames per second,
names of the bodies, names of the columns, units, then the frames. A rotation is a quaternion RX RY
RZ RW, or a rotation vector RX RY RZ (axis times angle, "helical"), from body axes to the world.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.mocap.take import Body, Take, finite, log_of_file, number_or_nan, numbers
from rotorfit.logs.units import Axes, unit_or_nan

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.logs.columns import ColumnSpec
    from rotorfit.logs.flight_log import FlightLog

_PROGRAMS: Final = {"segments": "Nexus", "objects": "Tracker"}
"""Blocks that hold rigid bodies, and which program writes them."""
_OTHER_BLOCKS: Final = frozenset({"devices", "events", "joints", "model outputs", "trajectories"})
_POSITION: Final = ("TX", "TY", "TZ")
_ANGLES: Final = ("RX", "RY", "RZ")
_QUATERNION: Final = ("RX", "RY", "RZ", "RW")
_LENGTHS: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_TURNS: Final = {"deg": np.pi / 180.0, "rad": 1.0}
_PREFIX: Final = "Global Angle "
_BLANK: Final = b" \t,;"
_HEADER_LINES: Final = 5
_MOST_BODIES: Final = 1000
_MOST_TURN: Final = 1e3
"""A longer rotation vector [rad] is a damaged one; Nexus counts whole turns on."""


@frozen_dataclass
class _Block:
    """A block of rigid bodies: the cells of its header, and the text that ends with the block.

    `start` and `first_line` are where its frames begin.
    """

    kind: str
    rate: str
    header: tuple[list[str], list[str], list[str]]
    text: bytes
    start: int
    first_line: int
    delimiter: str


def is_vicon(head: bytes) -> bool:
    """Return whether bytes from the beginning of a file are a CSV export of Nexus or Tracker."""
    first, _, rest = head.removeprefix(b"\xef\xbb\xbf").partition(b"\n")
    if _strip_word(first[:200]).lower() not in _OTHER_BLOCKS | _PROGRAMS.keys():
        return False
    return math.isfinite(number_or_nan(_strip_word(rest[:200].partition(b"\n")[0])))


def read_vicon(
    path: Path, *, columns: Mapping[str, ColumnSpec] | None = None, axes: Axes = "FLU"
) -> FlightLog:
    """Read the pose of a rigid body from the CSV export of Nexus or Tracker."""
    bodies = dict(columns or {})
    attitude = bodies.pop("attitude", None)
    rotation = None if attitude is None else attitude.name
    return log_of_file(
        path, lambda text: _take_of_block(_find_block(text), rotation), columns=bodies, axes=axes
    )


def _find_block(text: bytes) -> _Block:
    """Find the first block of rigid bodies."""
    start, number, met = 0, 1, list[str]()
    while start < len(text):
        kind = _strip_word(text[start : start + 200].partition(b"\n")[0]).lower()
        if kind in _PROGRAMS:
            return _block_of_bodies(kind, text, start, number)
        if kind:
            met.append(kind[:40])
        below = text.find(b"\n", _blank_line(text, start)) + 1 or len(text)
        number += text.count(b"\n", start, below)
        start = below
    holds = ", ".join(repr(kind) for kind in met[:4])
    raise LogError(
        f"the file has no block Segments or Objects, but {holds or 'nothing'}: export the rigid "
        "bodies (Nexus: segments, Tracker: objects), not only their markers"
    )


def _block_of_bodies(kind: str, text: bytes, start: int, number: int) -> _Block:
    """Return the block that begins at `start`, in the line of that number."""
    lines = list[bytes]()
    while len(lines) < _HEADER_LINES and (end := text.find(b"\n", start)) >= 0:
        lines.append(text[start:end])
        start = end + 1
    if len(lines) < _HEADER_LINES:
        raise LogError(f"the block {kind.title()} at line {number} has no frames: export again")
    columns = lines[3].decode("utf-8", "replace")
    delimiter = max(",;\t", key=columns.count)
    names, labels, units = (_split_cells(line, delimiter) for line in lines[2:_HEADER_LINES])
    while labels and not labels[-1]:
        labels.pop()
    if labels[:2] != ["Frame", "Sub Frame"] or units[0]:
        raise LogError(
            f"line {number + 3} begins with {columns[:20]!r}, expected Frame, Sub Frame and a row "
            "of units below: export again with header"
        )
    return _Block(
        kind=kind,
        rate=_strip_word(lines[1][:200]),
        header=(names, labels, units),
        text=text[: _blank_line(text, start)],
        start=start,
        first_line=number + _HEADER_LINES,
        delimiter=delimiter,
    )


def _take_of_block(block: _Block, rotation: str | None) -> Take:
    names, labels, units = block.header
    places = _columns_of_bodies(names, labels)
    _refuse_unknown_rotation(block.kind, places, rotation)
    text, empty = _without_empty_frames(block)
    width = _width_of_frames(text, block)
    if width < len(labels):
        raise LogError(
            f"the frames have {width} cells, their names {len(labels)}: export the file again"
        )
    values = numbers(
        text, block.start, columns=width, delimiter=block.delimiter, first_line=block.first_line
    )
    program = _PROGRAMS[block.kind]
    return Take(
        format="vicon",
        time=_frame_times(values, block.rate),
        bodies={name: _body_of_columns(values, columns, units) for name, columns in places.items()},
        source=f"position, {_kind_of_rotation(places)}, z up (Vicon {program})",
        metadata={"block": block.kind, "frame rate": block.rate[:40]},
        notes=(f"{empty} frames are empty: nothing was seen.",) if empty else (),
    )


def _columns_of_bodies(names: list[str], labels: list[str]) -> dict[str, dict[str, int]]:
    """Find the columns of each body; its name stands above the first of them."""
    found: dict[str, dict[str, int]] = {}
    current: dict[str, int] = {}
    for column in range(2, len(labels)):
        if column < len(names) and names[column]:
            name = _body_name(names[column])
            if name in found:
                raise LogError(f"two rigid bodies are named {name[:40]!r}: rename one")
            current = found[name] = {}
        if labels[column] in (*_QUATERNION, *_POSITION):
            current.setdefault(labels[column], column)
    if len(found) > _MOST_BODIES:
        raise LogError(f"the file has {len(found)} rigid bodies: export those that flew")
    for name, columns in found.items():
        lacking = [label for label in (*_ANGLES, *_POSITION) if label not in columns]
        if lacking:
            raise LogError(
                f"the rigid body {name[:40]!r} has no {', '.join(lacking)}: export rotation and "
                "translation"
            )
    return found


def _body_name(cell: str) -> str:
    """Shorten the name of a body; Tracker writes ``Global Angle Quad:Quad`` for Quad."""
    name = cell.removeprefix(_PREFIX)
    subject, _, segment = name.partition(":")
    return subject if subject == segment else name


def _kind_of_rotation(places: dict[str, dict[str, int]]) -> str:
    return "quaternion" if all("RW" in c for c in places.values()) else "rotation vector"


def _refuse_unknown_rotation(
    kind: str, places: dict[str, dict[str, int]], rotation: str | None
) -> None:
    """Raise an error if three numbers of a rotation may be a vector or Euler angles."""
    if rotation not in (None, "helical"):
        raise LogError(
            f"attitude = {rotation[:40]!r}: expected 'helical', the only three angles that are "
            "read; the order of Euler angles is not in the file: export quaternions"
        )
    if kind == "objects" and rotation is None and _kind_of_rotation(places) != "quaternion":
        raise LogError(
            "rotations are RX RY RZ, under which Tracker writes rotation vectors and Euler angles "
            "alike: export quaternions, or, if Helical was set, say so by "
            'columns = { attitude = "helical" }'
        )


def _without_empty_frames(block: _Block) -> tuple[bytes, int]:
    """Return the text with frames that have a number only made comments, and how many they are."""
    rows = block.text[block.start :].split(b"\n")
    delimiter = block.delimiter.encode()
    empty = [k for k, row in enumerate(rows) if row and not _has_seen_body(row, delimiter)]
    for k in empty:
        rows[k] = b"#"
    text = block.text[: block.start] + b"\n".join(rows) if empty else block.text
    return text, len(empty)


def _has_seen_body(row: bytes, delimiter: bytes) -> bool:
    """Return whether anything stands behind the number of a frame and its part."""
    cells = row.split(delimiter, 2)
    return len(cells) > 2 and bool(cells[2].strip(_BLANK))


def _width_of_frames(text: bytes, block: _Block) -> int:
    """Return the number of cells of the first frame that was seen; of the header if none was."""
    for row in text[block.start :].split(b"\n"):
        if row and not row.startswith(b"#"):
            return row.count(block.delimiter.encode()) + 1
    return len(block.header[1])


def _frame_times(values: Float[np.ndarray, "n k"], rate: str) -> Float[np.ndarray, " n"]:
    frequency = number_or_nan(rate)
    if not 0.1 < frequency < 1e5:
        raise LogError(f"{rate[:40]!r} frames per second in the second line: export again")
    if np.any(values[:, 1] != 0):
        raise LogError("frames have parts (Sub Frame is not 0): export poses once a frame")
    with np.errstate(over="ignore", invalid="ignore"):
        return (values[:, 0] - values[0, 0]) / frequency


def _body_of_columns(
    values: Float[np.ndarray, "n k"], columns: dict[str, int], units: list[str]
) -> Body:
    """Return a body in SI; NaN if its cells are empty."""
    position = values[:, [columns[label] for label in _POSITION]]
    rotation = values[
        :, [columns[label] for label in (_QUATERNION if "RW" in columns else _ANGLES)]
    ]
    metre = _unit_factor(units, columns["TX"], _LENGTHS)
    if "RW" in columns:
        attitude = unit_or_nan(np.roll(rotation, 1, axis=1))
    else:
        attitude = _turn_by_vectors(_unit_factor(units, columns["RX"], _TURNS) * finite(rotation))
    return Body(position=metre * finite(position), attitude_wxyz=attitude)


def _turn_by_vectors(vector: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Compute the quaternions of rotation vectors [rad]; NaN for what is none."""
    from scipy.spatial.transform import Rotation

    attitude = np.full((len(vector), 4), np.nan)
    good = np.all(np.abs(vector) < _MOST_TURN, axis=1)  # false for NaN, too
    if good.any():
        attitude[good] = np.roll(Rotation.from_rotvec(vector[good]).as_quat(), 1, axis=1)
    return attitude


def _unit_factor(units: list[str], column: int, known: dict[str, float]) -> float:
    unit = units[column].lower() if column < len(units) else ""
    if unit not in known:
        raise LogError(
            f"column {column + 1} has the unit {unit[:20]!r}, expected {', '.join(known)}: export "
            "again"
        )
    return known[unit]


def _blank_line(text: bytes, start: int) -> int:
    """Find where the first blank line from `start` on begins, or the end of the text."""
    while start < len(text):
        end = text.find(b"\n", start)
        end = len(text) if end < 0 else end
        if not text[start:end].strip(_BLANK):
            return start
        start = end + 1
    return len(text)


def _split_cells(line: bytes, delimiter: str) -> list[str]:
    words = line.decode("utf-8", "replace").split(delimiter)
    return [word.strip().strip('"').strip() for word in words]


def _strip_word(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip(' \t\r,;"')
