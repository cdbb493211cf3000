"""Qualisys Track Manager, exported 6DOF data (.tsv): z up, mm, rotation matrices by columns.

See the QTM user manual, "Motion data (.tsv)" and "6DOF data": a header of names and values between
tabs, a row of column names, then a row a frame; X Y Z [mm], roll pitch yaw [degrees], residual and
Rot[0] to Rot[8] for each body, with Rot[0] Rot[3] Rot[6] the first row of the matrix.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.mocap.take import Body, Take, finite, log_of_file, numbers

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.logs.columns import ColumnSpec
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.logs.units import Axes

_PER_BODY: Final = 16
_HEADER_LINES: Final = 64
_MOST_BODIES: Final = 1000
_OFF_ORTHOGONAL: Final = 1e-3
"""Difference of R R^T from the identity; exported with five decimals, it is 3e-5."""


def read_qualisys(
    path: Path, *, columns: Mapping[str, ColumnSpec] | None = None, axes: Axes = "FLU"
) -> FlightLog:
    """Read the pose of a rigid body from QTM's 6DOF export."""
    return log_of_file(path, _read_take, columns=columns, axes=axes)


def _read_take(text: bytes) -> Take:
    header, start, line = _read_header(text)
    kind = "".join(header.get("DATA_INCLUDED", [])[:1])
    if kind != "6D":
        raise LogError(
            f"the file holds {kind or 'unknown'} data, expected 6D: export the 6DOF data of the "
            "rigid body, not its markers"
        )
    names = [name for name in header.get("BODY_NAMES", []) if name]
    if not names or len(set(names)) < len(names) or len(names) > _MOST_BODIES:
        raise LogError(
            f"BODY_NAMES has {len(names)} names, expected each rigid body once: export again"
        )
    first_row = text[start:].partition(b"\n")[0].rstrip(b"\t")
    columns = first_row.count(b"\t") + 1
    lead = columns - _PER_BODY * len(names)
    if lead not in (0, 1, 2):
        raise LogError(
            f"line {line} has {columns} columns, expected {_PER_BODY} for each of {len(names)} "
            "bodies (position, angles, residual, rotation matrix) after frame and time: export "
            "with all of them"
        )
    values = numbers(
        _without_end_tabs(text, start), start, columns=columns, delimiter="\t", first_line=line
    )
    return Take(
        format="qualisys",
        time=_frame_times(values, lead, header),
        bodies={
            name: _body_of_block(values[:, lead + _PER_BODY * k : lead + _PER_BODY * (k + 1)])
            for k, name in enumerate(names)
        },
        source="position in mm, rotation matrix, z up (Qualisys)",
        metadata={key: " ".join(cells) for key, cells in header.items()},
    )


def _read_header(text: bytes) -> tuple[dict[str, list[str]], int, int]:
    """Read the header by name, and where the rows of numbers begin: offset and line number."""
    header: dict[str, list[str]] = {}
    start = 0
    for number in range(1, _HEADER_LINES):
        end = text.find(b"\n", start)
        if end < 0:
            break
        cells = text[start:end].decode("utf-8", "replace").rstrip().split("\t")
        start = end + 1
        if any(cell.strip().endswith("Rot[0]") for cell in cells):
            return header, start, number + 1
        header[cells[0]] = cells[1:]
        # Without 6DOF data no such row comes; the caller says what the file holds instead.
        if cells[0] == "DATA_INCLUDED" and cells[1:] != ["6D"]:
            return header, start, number + 1
    raise LogError(
        "the header has no row of columns with Rot[0]: export 6DOF data with header and rotation "
        "matrix"
    )


def _without_end_tabs(text: bytes, start: int) -> bytes:
    """Return the text without tabs at the end of its rows, which some versions write."""
    if text[start:].partition(b"\n")[0].endswith(b"\t"):
        return text[:start] + text[start:].replace(b"\t\n", b"\n").removesuffix(b"\t")
    return text


def _frame_times(
    values: Float[np.ndarray, "n k"], lead: int, header: dict[str, list[str]]
) -> Float[np.ndarray, " n"]:
    """Return the time of the frames: as exported, else from their number and the frequency."""
    if lead == 2:
        return values[:, 1]
    frame = values[:, 0] - values[0, 0] if lead else np.arange(len(values), dtype=float)
    text = "".join(header.get("FREQUENCY", [])[:1]) or "not given"
    try:
        frequency = float(text)
    except ValueError:
        frequency = float("nan")
    if not 0.1 < frequency < 1e5:
        raise LogError(
            f"the file has no column of times and its FREQUENCY is {text}: export with times"
        )
    return frame / frequency


def _body_of_block(block: Float[np.ndarray, "n 16"]) -> Body:
    """Return a body; frames whose matrix is no rotation (all zeros when it is lost) become NaN."""
    from scipy.spatial.transform import Rotation

    matrix = block[:, 7:].reshape(-1, 3, 3).transpose(0, 2, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(matrix @ matrix.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        good = (off < _OFF_ORTHOGONAL) & (np.linalg.det(np.nan_to_num(matrix)) > 0)
    attitude = np.full((len(block), 4), np.nan)
    if good.any():
        xyzw = Rotation.from_matrix(matrix[good]).as_quat()
        attitude[good] = np.roll(xyzw, 1, axis=1)
    position = np.where(good[:, None], 1e-3 * finite(block[:, :3]), np.nan)
    return Body(position=position, attitude_wxyz=attitude)
