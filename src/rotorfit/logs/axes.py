"""Axes and attitudes as files have them, to FLU body axes and a world with z up."""

from typing import Literal

import numpy as np
from jaxtyping import Float

Axes = Literal["FLU", "FRD"]

_HALF_TURN_ABOUT_X = np.array([1.0, -1.0, -1.0])


def vectors_to_flu(vectors: Float[np.ndarray, "n 3"], axes: Axes) -> Float[np.ndarray, "n 3"]:
    """Return body vectors in FLU axes; FRD is FLU turned by half a turn about x.

    The same turn takes world vectors from north-east-down to north-west-up.
    """
    return vectors if axes == "FLU" else vectors * _HALF_TURN_ABOUT_X


def attitude_to_flu(
    attitude_wxyz: Float[np.ndarray, "n 4"], axes: Axes
) -> Float[np.ndarray, "n 4"]:
    """Return body-to-world quaternions for FLU axes and z up.

    With D the half turn about x on both ends, R' = D R D: the same angle about the turned axis.
    """
    turn = np.concatenate([[1.0], _HALF_TURN_ABOUT_X])
    return attitude_wxyz if axes == "FLU" else attitude_wxyz * turn


def attitude_from_euler(angles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Return the quaternion w, x, y, z of R = Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    angles
        Roll, pitch and yaw [rad].
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles / 2).T, np.sin(angles / 2).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
