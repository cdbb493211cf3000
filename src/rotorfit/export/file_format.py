"""Conventions of other tools' files: axes, units, numbers, names and comments as text."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorfit.model.parameters import INERTIA_PLACES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

RPM: float = 2.0 * math.pi / 60.0
"""One revolution per minute [rad/s]."""


def per_squared_rpm(coefficient: float) -> float:
    """Convert a coefficient per squared speed from s^2/rad^2 to 1/RPM^2."""
    return coefficient * RPM**2


def frd(vector_flu: Float[np.ndarray, "*rows 3"]) -> Float[np.ndarray, "*rows 3"]:
    """Turn vectors from FLU into FRD axes (x forward, y right, z down)."""
    return vector_flu * np.array([1.0, -1.0, -1.0])


def inertia_frd(tensor_flu: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Turn an inertia tensor from FLU into FRD axes: Ixy and Ixz change sign."""
    turn = np.diag([1.0, -1.0, -1.0])
    return turn @ tensor_flu @ turn


def elements(tensor: Float[np.ndarray, "3 3"]) -> tuple[float, ...]:
    """Return Ixx, Iyy, Izz, Ixy, Ixz, Iyz, the order of rotorfit and of MuJoCo's fullinertia."""
    return tuple(float(tensor[place]) for place in INERTIA_PLACES)


def quaternion_wxyz(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 4"]:
    """Compute the shortest rotation that takes z to a unit vector, scalar first."""
    if axis[2] <= -1.0 + 1e-12:
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return q / np.linalg.norm(q)


def roll_pitch_yaw(axis: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    """Compute roll and pitch [rad] of Ry(pitch) Rx(roll), which takes z to a unit vector; yaw 0."""
    roll = math.asin(max(-1.0, min(1.0, -float(axis[1]))))
    return roll, math.atan2(float(axis[0]), float(axis[2])), 0.0


def text(value: float) -> str:
    """Write a number with 12 digits; ValueError if it is not finite: unknown is never written."""
    if not math.isfinite(value):
        raise ValueError("a number that is not known was to be written")
    return f"{value + 0.0:.12g}"


def texts(values: Float[np.ndarray, " n"] | tuple[float, ...]) -> str:
    """Write numbers with blanks between them."""
    return " ".join(text(float(value)) for value in values)


def listed(values: Sequence[float]) -> str:
    """Write numbers in brackets, as Python and JSON have a list."""
    return f"[{', '.join(text(value) for value in values)}]"


def xml_elements(values: Float[np.ndarray, "3 3"]) -> dict[str, str]:
    """Write the elements of an inertia tensor by their names in SDF and URDF."""
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    return dict(zip(names, map(text, elements(values)), strict=True))


def npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Write arrays as the bytes of a NumPy .npz file, under their names and no others."""
    room = io.BytesIO()
    # NumPy before 2.2 has no option allow_pickle and would write it as one more array.
    given: dict[str, Any] = dict(arrays)
    np.savez(room, **given)
    return room.getvalue()


def identifier(name: str) -> str:
    """Make a name that every target takes for a model: letters, digits and underscores."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_")
    return plain if plain and not plain[0].isdigit() else f"vehicle_{plain}".rstrip("_")


def template_text(name: str) -> str:
    """Read the part of a file that is the same for every vehicle."""
    return (Path(__file__).parent / "templates" / name).read_text(encoding="utf-8")


def with_notes(head: Sequence[str], *remarks: str) -> list[str]:
    """Add notes on the target to the head of a file."""
    return [*head, *(f"Note: {remark}" for remark in remarks)]


def hash_comment(lines: Sequence[str]) -> str:
    """Write lines as comments that begin with ``#``."""
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def xml_comment(lines: Sequence[str]) -> str:
    """Write lines as one XML comment, in which there may be no two hyphens in a row."""
    safe = [line.replace("--", "- -").replace("--", "- -") for line in lines]
    safe = [f"{line} " if line.endswith("-") else line for line in safe]
    return "<!--\n" + "".join(f"  {line}\n" for line in safe) + "-->\n"
