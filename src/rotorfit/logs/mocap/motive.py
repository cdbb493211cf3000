"""OptiTrack Motive, exported CSV of rigid bodies (format versions 1.2x): y up, quaternions.

See OptiTrack's documentation, "Data Export: CSV": a line of names and values, rows that say of each
column its type, name, ID and whether it is position or rotation, then a row a frame.
"""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.mocap.take import LENGTHS, Body, Take, finite, log_of_file, numbers
from rotorfit.logs.units import Axes, unit_or_nan

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.logs.columns import ColumnSpec
    from rotorfit.logs.flight_log import FlightLog

_HEADER_LINES: Final = 16
_AXES: Final = {
    ("Rotation", "W"): 0,
    ("Rotation", "X"): 1,
    ("Rotation", "Y"): 2,
    ("Rotation", "Z"): 3,
    ("Position", "X"): 4,
    ("Position", "Y"): 5,
    ("Position", "Z"): 6,
}
_KEPT: Final = ("Format Version", "Take Name", "Capture Frame Rate", "Capture Start Time")


def read_motive(
    path: Path, *, columns: Mapping[str, ColumnSpec] | None = None, axes: Axes = "FLU"
) -> FlightLog:
    """Read the pose of a rigid body from Motive's CSV export.

    The world is turned from y up to z up, x staying as it is, and the body's axes with it: a rigid
    body that was defined with the vehicle's nose along x has x forward, y left, z up.
    """
    return log_of_file(path, _read_take, columns=columns, axes=axes)


def _read_take(text: bytes) -> Take:
    rows, start = _read_header(text)
    settings = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    unit = settings.get("Length Units", "Meters")
    _refuse_other_settings(settings, unit)
    places = _columns_of_bodies(rows)
    values = numbers(
        text, start, columns=len(rows[-1]), delimiter=",", first_line=text[:start].count(b"\n") + 1
    )
    return Take(
        format="motive",
        time=values[:, 1],
        bodies={
            name: _upright_body(values[:, columns], LENGTHS[unit.lower()])
            for name, columns in places.items()
        },
        source=f"position in {unit.lower()}, quaternion, turned from y up to z up (Motive)",
        metadata={key: settings[key] for key in _KEPT if key in settings},
    )


def _read_header(text: bytes) -> tuple[list[list[str]], int]:
    """Read the cells of the header's lines, and where the rows of numbers begin."""
    rows: list[list[str]] = []
    start = 0
    while len(rows) < _HEADER_LINES and (end := text.find(b"\n", start)) >= 0:
        line = text[start:end].decode("utf-8", "replace")
        start = end + 1
        try:
            cells = next(csv.reader([line]), list[str]())
        except csv.Error as error:
            raise LogError(f"the header cannot be read ({error}): export again") from error
        if not any(cells):
            continue
        rows.append([cell.strip() for cell in cells])
        if cells[0].strip() == "Frame" and len(cells) > 1 and len(rows) >= 4:
            return rows, start
    raise LogError(
        "the header has no row that begins with Frame, Time: export the take as CSV with header"
    )


def _refuse_other_settings(settings: dict[str, str], unit: str) -> None:
    if unit.lower() not in LENGTHS:
        raise LogError(f"Length Units are {unit!r}, expected {', '.join(LENGTHS)}: export again")
    turned = settings.get("Rotation Type", "Quaternion")
    if turned.lower() != "quaternion":
        raise LogError(f"Rotation Type is {turned!r}: export again with quaternions")
    space = settings.get("Coordinate Space", "Global")
    if space.lower() != "global":
        raise LogError(f"Coordinate Space is {space!r}: export again in global coordinates")


def _columns_of_bodies(rows: list[list[str]]) -> dict[str, list[int]]:
    """Find the columns W X Y Z and X Y Z of each rigid body."""
    kinds = next((row for row in rows[1:-1] if "Rigid Body" in row), None)
    if kinds is None:
        return {}
    names, what, axes = rows[rows.index(kinds) + 1], rows[-2], rows[-1]
    found: dict[str, dict[int, int]] = {}
    width = min(len(kinds), len(names), len(what), len(axes))
    for column in range(2, width):
        place = _AXES.get((what[column], axes[column]))
        # Columns whose type is another one, such as the markers of a body, are passed over.
        if kinds[column] == "Rigid Body" and place is not None:
            if place in found.setdefault(names[column], {}):
                raise LogError(f"two rigid bodies are named {names[column]!r}: rename one")
            found[names[column]][place] = column
    for name, columns in found.items():
        if len(columns) < len(_AXES):
            raise LogError(
                f"the rigid body {name!r} has {len(columns)} of 7 columns (rotation X Y Z W, "
                "position X Y Z): export both"
            )
    return {name: [columns[k] for k in range(len(_AXES))] for name, columns in found.items()}


def _upright_body(pose: Float[np.ndarray, "n 7"], metre: float) -> Body:
    """Return a body in a world with z up: a quarter turn about x on both ends."""
    with np.errstate(over="ignore"):
        # With C the turn, positions become C p and rotations C R C^T: the same angle, the axis
        # turned.
        position = finite(metre * _y_up_to_z_up(pose[:, 4:]))
    attitude = np.concatenate([pose[:, :1], _y_up_to_z_up(pose[:, 1:4])], axis=1)
    return Body(position=position, attitude_wxyz=unit_or_nan(attitude))


def _y_up_to_z_up(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    x, y, z = vectors.T
    return np.stack([x, -z, y], axis=1)
