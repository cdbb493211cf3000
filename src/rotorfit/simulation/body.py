"""One rigid body in six degrees of freedom, its centre of mass off the body origin O."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rotorfit.simulation.truth import GRAVITY, Truth
from rotorfit.simulation.vectors import Matrix, Vector, cross, no_type_check, rotation, times

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
    """Return the body of a vehicle."""
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

    Returns
    -------
    a, dw
        Specific force at the origin [m/s^2] and angular acceleration [rad/s^2], body axes.
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
    """Return the wrench with the drag added.

    The origin moves with `velocity` in body axes [m/s], and the body turns with `w` [rad/s].
    """
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
    """Return the time derivative of the state under a wrench."""
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
    """Take one classical Runge-Kutta step of fourth order.

    Parameters
    ----------
    body
        The rigid body.
    wrenches
        At the beginning, the middle and the end of the step.
    state
        At the beginning.
    h
        Length of the step [s].

    Returns
    -------
    state
        At the end, its quaternion of unit length.
    """
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
    """Return the state with its quaternion brought back to unit length."""
    a, b, c, d = state[3:7]
    length = (a * a + b * b + c * c + d * d) ** 0.5
    return (*state[:3], a / length, b / length, c / length, d / length, *state[7:])


def _rows(tensor: Float[np.ndarray, "3 3"]) -> Matrix:
    """Return a matrix as a tuple of rows."""
    a, b, c = (tuple(row) for row in tensor.tolist())
    return a, b, c
