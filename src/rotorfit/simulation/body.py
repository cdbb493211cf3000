"""One rigid body in six degrees of freedom, its centre of mass off the body origin O.

Vectors, matrices and unit quaternions are tuples of floats: on three floats, plain Python is
several times faster than NumPy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, sin
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from rotorfit.simulation.truth import GRAVITY, Truth

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
    """Compute the cross product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@no_type_check
def times(A: Matrix, b: Vector) -> Vector:
    """Multiply a matrix (a tuple of rows) and a vector."""
    x, y, z = b
    return (
        A[0][0] * x + A[0][1] * y + A[0][2] * z,
        A[1][0] * x + A[1][1] * y + A[1][2] * z,
        A[2][0] * x + A[2][1] * y + A[2][2] * z,
    )


@no_type_check
def clip(value: float, limit: float) -> float:
    """Limit the value to plus and minus the limit."""
    return max(-limit, min(limit, value))


@no_type_check
def rotation(quaternion: Quaternion) -> Matrix:
    """Convert a unit quaternion (w, x, y, z) to a rotation matrix."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@no_type_check
def yaw_of(R: Matrix) -> float:
    """Compute the heading of R = Rz(yaw) Ry(pitch) Rx(roll) [rad]."""
    return atan2(R[1][0], R[0][0])


@no_type_check
def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Convert R = Rz(yaw) Ry(pitch) Rx(roll) to a unit quaternion (w, x, y, z)."""
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
    """Compute 2 sin(angle/2) times the axis of the rotation from start to end, in start's axes."""
    w, x, y, z = start
    a, b, c, d = end
    scale = 2.0 if w * a + x * b + y * c + z * d >= 0 else -2.0  # of q and -q, the shorter way
    return (
        scale * (w * b - x * a - y * d + z * c),
        scale * (w * c - y * a - z * b + x * d),
        scale * (w * d - z * a - x * c + y * b),
    )


State = tuple[float, ...]
"""Thirteen floats: angular velocity (3), attitude quaternion wxyz body to world (4), velocity
of the origin in body axes (3), position of the origin in world axes (3)."""


class Wrench(NamedTuple):
    """What acts on the body from outside, gravity left out, body axes, about the origin.

    Attributes
    ----------
    force, torque
        Applied force [N] and torque about the body origin [N m].
    spin
        Angular momentum of the rotors relative to the body, Jr H [N m s].
    yaw_damping
        Torque against a turn about z per rate [N m s/rad].
    """

    force: Vector
    torque: Vector
    spin: Vector = (0.0, 0.0, 0.0)
    yaw_damping: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidBody:
    """The inertial parameters, in the form that the inner loop reads.

    Attributes
    ----------
    mass, first_moments, inertia
        Mass, mass times centre of mass, and inertia about the origin.
    inverse_com_inertia
        Inverse of the inertia about the centre of mass [1/(kg m^2)].
    drag
        Force per velocity along each body axis [N s/m].
    drag_position
        Where it acts, from the origin [m].
    """

    mass: float
    first_moments: Vector
    inertia: Matrix
    inverse_com_inertia: Matrix
    drag: Vector = (0.0, 0.0, 0.0)
    drag_position: Vector = (0.0, 0.0, 0.0)


def rigid_body(truth: Truth) -> RigidBody:
    """Build the body of a vehicle."""
    return RigidBody(
        mass=truth.mass,
        first_moments=truth.first_moments,
        inertia=_rows(truth.inertia_tensor),
        inverse_com_inertia=_rows(np.linalg.inv(truth.com_inertia)),
        drag=truth.drag,
        drag_position=truth.drag_position,
    )


@no_type_check
def accelerations(body: RigidBody, wrench: Wrench, w: Vector) -> tuple[Vector, Vector]:
    """Solve Newton-Euler about the body origin for a and dw.

        m a + dw x ms + w x (w x ms) = f
        I dw + w x (I w + Jr H) + ms x a = tau - (0, 0, damping w_z)

    With a from the first put into the second, the inertia about the centre of mass is left in
    front of dw (the Schur complement of the mass).
    """
    m, ms = body.mass, body.first_moments
    Lx, Ly, Lz = times(body.inertia, w)
    hx, hy, hz = wrench.spin
    cx, cy, cz = cross(w, cross(w, ms))
    fx, fy, fz = wrench.force
    F = (fx - cx, fy - cy, fz - cz)
    gx, gy, gz = cross(w, (Lx + hx, Ly + hy, Lz + hz))
    tx, ty, tz = wrench.torque
    tz -= wrench.yaw_damping * w[2]
    bx, by, bz = cross(ms, F)
    dw = times(body.inverse_com_inertia, (tx - gx - bx / m, ty - gy - by / m, tz - gz - bz / m))
    ex, ey, ez = cross(dw, ms)
    return ((F[0] - ex) / m, (F[1] - ey) / m, (F[2] - ez) / m), dw


@no_type_check
def with_drag(body: RigidBody, wrench: Wrench, velocity: Vector, w: Vector) -> Wrench:
    """Add the drag on an origin that moves with `velocity` [m/s] while turning with `w` [rad/s]."""
    cx, cy, cz = body.drag
    if not (cx or cy or cz):
        return wrench
    fx, fy, fz = wrench.force
    vx, vy, vz = velocity
    ux, uy, uz = cross(w, body.drag_position)
    dx, dy, dz = cx * (vx + ux), cy * (vy + uy), cz * (vz + uz)
    tx, ty, tz = wrench.torque
    qx, qy, qz = cross(body.drag_position, (dx, dy, dz))
    slowed, turned = (fx - dx, fy - dy, fz - dz), (tx - qx, ty - qy, tz - qz)
    return Wrench(slowed, turned, wrench.spin, wrench.yaw_damping)


@no_type_check
def derivative(body: RigidBody, wrench: Wrench, state: State) -> State:
    """Differentiate the state by time under a wrench."""
    x, y, z, qw, qx, qy, qz, vx, vy, vz, _, _, _ = state
    w, v = (x, y, z), (vx, vy, vz)
    (ax, ay, az), (dx, dy, dz) = accelerations(body, with_drag(body, wrench, v, w), w)
    R = rotation((qw, qx, qy, qz))
    gx, gy, gz = R[2]  # the world's vertical in body axes
    cx, cy, cz = cross(w, v)
    return (
        *(dx, dy, dz),
        -0.5 * (qx * x + qy * y + qz * z),
        0.5 * (qw * x + qy * z - qz * y),
        0.5 * (qw * y + qz * x - qx * z),
        0.5 * (qw * z + qx * y - qy * x),
        *(ax - GRAVITY * gx - cx, ay - GRAVITY * gy - cy, az - GRAVITY * gz - cz),
        *times(R, v),
    )


@no_type_check
def step(body: RigidBody, wrenches: list[Wrench], state: State, h: float) -> State:
    """Take a classical Runge-Kutta step of length `h` [s]; wrenches at begin, middle and end."""
    begin, middle, end = wrenches
    half, sixth = h / 2, h / 6
    k1 = derivative(body, begin, state)
    k2 = derivative(body, middle, tuple([x + half * k for x, k in zip(state, k1, strict=True)]))
    k3 = derivative(body, middle, tuple([x + half * k for x, k in zip(state, k2, strict=True)]))
    k4 = derivative(body, end, tuple([x + h * k for x, k in zip(state, k3, strict=True)]))
    slopes = zip(state, k1, k2, k3, k4, strict=True)
    return _normalised([x + sixth * (a + 2 * (b + c) + d) for x, a, b, c, d in slopes])


@no_type_check
def _normalised(state: list[float]) -> State:
    """Normalise the state's quaternion."""
    a, b, c, d = state[3:7]
    length = (a * a + b * b + c * c + d * d) ** 0.5
    return (*state[:3], a / length, b / length, c / length, d / length, *state[7:])


def _rows(tensor: Float[np.ndarray, "3 3"]) -> Matrix:
    """Convert a matrix to a tuple of rows."""
    a, b, c = (tuple(row) for row in tensor.tolist())
    return a, b, c
