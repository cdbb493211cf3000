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
    m, (mx, my, mz) = body.mass, body.first_moments
    (Ixx, Ixy, Ixz), (Iyx, Iyy, Iyz), (Izx, Izy, Izz) = body.inertia
    (Jxx, Jxy, Jxz), (Jyx, Jyy, Jyz), (Jzx, Jzy, Jzz) = body.inverse_com_inertia
    (fx, fy, fz), (tx, ty, tz), (hx, hy, hz), damping = wrench
    x, y, z = w
    # w x ms, and f - w x (w x ms)
    ux, uy, uz = y * mz - z * my, z * mx - x * mz, x * my - y * mx
    fx, fy, fz = fx - (y * uz - z * uy), fy - (z * ux - x * uz), fz - (x * uy - y * ux)
    # I w + Jr H, and tau - (0, 0, damping w_z) - w x (I w + Jr H) - ms x a for dw = 0
    Lx = Ixx * x + Ixy * y + Ixz * z + hx
    Ly = Iyx * x + Iyy * y + Iyz * z + hy
    Lz = Izx * x + Izy * y + Izz * z + hz
    tx = tx - (y * Lz - z * Ly) - (my * fz - mz * fy) / m
    ty = ty - (z * Lx - x * Lz) - (mz * fx - mx * fz) / m
    tz = tz - damping * z - (x * Ly - y * Lx) - (mx * fy - my * fx) / m
    dx = Jxx * tx + Jxy * ty + Jxz * tz
    dy = Jyx * tx + Jyy * ty + Jyz * tz
    dz = Jzx * tx + Jzy * ty + Jzz * tz
    ax = (fx - (dy * mz - dz * my)) / m
    ay = (fy - (dz * mx - dx * mz)) / m
    az = (fz - (dx * my - dy * mx)) / m
    return (ax, ay, az), (dx, dy, dz)


@no_type_check
def with_drag(body: RigidBody, wrench: Wrench, velocity: Vector, w: Vector) -> Wrench:
    """Add the drag on an origin that moves with `velocity` [m/s] while turning with `w` [rad/s]."""
    cx, cy, cz = body.drag
    if not (cx or cy or cz):
        return wrench
    px, py, pz = body.drag_position
    (fx, fy, fz), (tx, ty, tz), spin, damping = wrench
    (vx, vy, vz), (x, y, z) = velocity, w
    dx, dy, dz = cx * (vx + y * pz - z * py), cy * (vy + z * px - x * pz), cz * (vz + x * py - y * px)
    tx, ty, tz = tx - (py * dz - pz * dy), ty - (pz * dx - px * dz), tz - (px * dy - py * dx)
    return Wrench((fx - dx, fy - dy, fz - dz), (tx, ty, tz), spin, damping)


@no_type_check
def derivative(body: RigidBody, wrench: Wrench, state: State) -> State:
    """Differentiate the state by time under a wrench."""
    x, y, z, qw, qx, qy, qz, vx, vy, vz, _, _, _ = state
    w = (x, y, z)
    (ax, ay, az), dw = accelerations(body, with_drag(body, wrench, (vx, vy, vz), w), w)
    (Rxx, Rxy, Rxz), (Ryx, Ryy, Ryz), (Rzx, Rzy, Rzz) = rotation((qw, qx, qy, qz))
    return (
        *dw,
        -0.5 * (qx * x + qy * y + qz * z),
        0.5 * (qw * x + qy * z - qz * y),
        0.5 * (qw * y + qz * x - qx * z),
        0.5 * (qw * z + qx * y - qy * x),
        ax - GRAVITY * Rzx - (y * vz - z * vy),
        ay - GRAVITY * Rzy - (z * vx - x * vz),
        az - GRAVITY * Rzz - (x * vy - y * vx),
        Rxx * vx + Rxy * vy + Rxz * vz,
        Ryx * vx + Ryy * vy + Ryz * vz,
        Rzx * vx + Rzy * vy + Rzz * vz,
    )


@no_type_check
def step(body: RigidBody, wrenches: list[Wrench], state: State, h: float) -> State:
    """Take a classical Runge-Kutta step of length `h` [s]; wrenches at begin, middle and end."""
    begin, middle, end = wrenches
    k1 = derivative(body, begin, state)
    k2 = derivative(body, middle, _ahead(state, k1, h / 2))
    k3 = derivative(body, middle, _ahead(state, k2, h / 2))
    k4 = derivative(body, end, _ahead(state, k3, h))
    return _normalised(_ahead(state, _weighted(k1, k2, k3, k4), h / 6))


@no_type_check
def _ahead(state: State, slope: State, h: float) -> State:
    """Follow a slope from a state for `h` [s]."""
    x, y, z, qw, qx, qy, qz, vx, vy, vz, px, py, pz = state
    dx, dy, dz, dqw, dqx, dqy, dqz, dvx, dvy, dvz, dpx, dpy, dpz = slope
    return (
        *(x + h * dx, y + h * dy, z + h * dz),
        *(qw + h * dqw, qx + h * dqx, qy + h * dqy, qz + h * dqz),
        *(vx + h * dvx, vy + h * dvy, vz + h * dvz),
        *(px + h * dpx, py + h * dpy, pz + h * dpz),
    )


@no_type_check
def _weighted(k1: State, k2: State, k3: State, k4: State) -> State:
    """Add the slopes of a Runge-Kutta step with their weights 1, 2, 2, 1."""
    return tuple([a + 2 * (b + c) + d for a, b, c, d in zip(k1, k2, k3, k4)])  # noqa: B905


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
