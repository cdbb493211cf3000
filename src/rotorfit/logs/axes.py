"""Axes and attitudes as files have them, to FLU body axes and a world with z up."""

from typing import Literal

import numpy as np
from jaxtyping import Float

Axes = Literal["FLU", "FRD"]

_HALF_TURN_ABOUT_X = np.array([1.0, -1.0, -1.0])
_OFF_LENGTH = 0.05
"""A quaternion this far from length 1 is no rotation, such as zeros where a body is not seen."""


def vectors_to_flu(vectors: Float[np.ndarray, "n 3"], axes: Axes) -> Float[np.ndarray, "n 3"]:
    """Turn body vectors into FLU axes; FRD is FLU turned by half a turn about x.

    The same turn takes world vectors from north-east-down to north-west-up.
    """
    return vectors if axes == "FLU" else vectors * _HALF_TURN_ABOUT_X


def attitude_to_flu(
    attitude_wxyz: Float[np.ndarray, "n 4"], axes: Axes
) -> Float[np.ndarray, "n 4"]:
    """Turn body-to-world quaternions to FLU axes and z up.

    With D the half turn about x on both ends, R' = D R D: the same angle about the turned axis.
    """
    turn = np.concatenate([[1.0], _HALF_TURN_ABOUT_X])
    return attitude_wxyz if axes == "FLU" else attitude_wxyz * turn


def attitude_from_euler(angles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Return the quaternion w, x, y, z of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles / 2).T, np.sin(angles / 2).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def world_to_body(
    world: Float[np.ndarray, "n 3"], attitude_wxyz: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 3"]:
    """Turn world vectors into body axes, by the quaternion from body to world."""
    w, u = attitude_wxyz[:, :1], -attitude_wxyz[:, 1:]
    turn = 2.0 * np.cross(u, world)
    return world + w * turn + np.cross(u, turn)


def unit_or_nan(attitude: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Bring quaternions to length 1; those far from it are no rotation, and become NaN."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(attitude, axis=1)
        good = np.abs(length - 1.0) < _OFF_LENGTH
    return attitude / np.where(good, length, np.nan)[:, None]
