"""Axes, units and the order of elements that other tools ask for: converted here, nowhere else."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rotorfit.model.parameters import INERTIA_PLACES

RPM: float = 2.0 * math.pi / 60.0
"""One revolution per minute [rad/s]."""


def per_squared_rpm(coefficient: float) -> float:
    """Return a coefficient per squared speed, from s^2/rad^2 to 1/RPM^2."""
    return coefficient * RPM**2


def frd(vector_flu: Float[np.ndarray, "*rows 3"]) -> Float[np.ndarray, "*rows 3"]:
    """Return vectors in FRD axes (x forward, y right, z down)."""
    return vector_flu * np.array([1.0, -1.0, -1.0])


def inertia_frd(tensor_flu: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Return an inertia tensor in FRD axes: Ixy and Ixz change sign."""
    turn = np.diag([1.0, -1.0, -1.0])
    return turn @ tensor_flu @ turn


def elements(tensor: Float[np.ndarray, "3 3"]) -> tuple[float, ...]:
    """Return Ixx, Iyy, Izz, Ixy, Ixz, Iyz, the order of rotorfit and of MuJoCo's fullinertia."""
    return tuple(float(tensor[place]) for place in INERTIA_PLACES)


def text(value: float) -> str:
    """Return a number as it stands in a file: 12 digits, read back to 1e-12 of itself.

    Raises
    ------
    ValueError
        If it is not finite: what is not known is never written.
    """
    if not math.isfinite(value):
        raise ValueError("a number that is not known was to be written")
    return f"{value + 0.0:.12g}"


def texts(values: Float[np.ndarray, " n"] | tuple[float, ...]) -> str:
    """Return numbers with blanks between them."""
    return " ".join(text(float(value)) for value in values)


def listed(values: Sequence[float]) -> str:
    """Return numbers in brackets, as Python and JSON write a list."""
    return f"[{', '.join(text(value) for value in values)}]"


def quaternion_wxyz(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 4"]:
    """Return the shortest rotation that takes z to a unit vector, scalar first."""
    if axis[2] <= -1.0 + 1e-12:
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return q / np.linalg.norm(q)


def roll_pitch_yaw(axis: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    """Return angles of Rz(yaw) Ry(pitch) Rx(roll), yaw 0, that take z to a unit vector [rad]."""
    roll = math.asin(max(-1.0, min(1.0, -float(axis[1]))))
    return roll, math.atan2(float(axis[0]), float(axis[2])), 0.0
