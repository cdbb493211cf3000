"""Vectors, 3 x 3 matrices and unit quaternions as tuples of floats, for the inner loop.

On three floats, plain Python is several times faster than NumPy.
"""

from collections.abc import Callable
from math import atan2, cos, sin
from typing import TypeVar

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Quaternion = tuple[float, float, float, float]

_Function = TypeVar("_Function", bound=Callable[..., object])


def no_type_check(function: _Function) -> _Function:
    """Mark a function of the inner loop, and return it as it is.

    The run-time shape checks of the tests go by this name and leave such a function alone: they
    cost thirty times what it does. Unlike its namesake in `typing` it keeps the annotations.
    """
    return function


@no_type_check
def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@no_type_check
def times(A: Matrix, b: Vector) -> Vector:
    """Return the product of a matrix (a tuple of rows) and a vector."""
    x, y, z = b
    return (
        A[0][0] * x + A[0][1] * y + A[0][2] * z,
        A[1][0] * x + A[1][1] * y + A[1][2] * z,
        A[2][0] * x + A[2][1] * y + A[2][2] * z,
    )


@no_type_check
def clip(value: float, limit: float) -> float:
    """Return the value, held within plus and minus the limit."""
    return max(-limit, min(limit, value))


@no_type_check
def rotation(quaternion: Quaternion) -> Matrix:
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@no_type_check
def yaw_of(R: Matrix) -> float:
    """Return the heading of R = Rz(yaw) Ry(pitch) Rx(roll) [rad]."""
    return atan2(R[1][0], R[0][0])


@no_type_check
def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the unit quaternion (w, x, y, z) of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = cos(roll / 2), sin(roll / 2)
    cp, sp = cos(pitch / 2), sin(pitch / 2)
    cy, sy = cos(yaw / 2), sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@no_type_check
def rotation_vector_between(start: Quaternion, end: Quaternion) -> Vector:
    """Return 2 sin(angle/2) times the axis of the rotation from start to end, in start's axes."""
    w, x, y, z = start
    a, b, c, d = end
    scale = 2.0 if w * a + x * b + y * c + z * d >= 0 else -2.0  # of q and -q, the shorter way
    return (
        scale * (w * b - x * a - y * d + z * c),
        scale * (w * c - y * a - z * b + x * d),
        scale * (w * d - z * a - x * c + y * b),
    )
