"""One rigid body in six degrees of freedom, its centre of mass off the body origin O.

Vectors, matrices and unit quaternions are tuples of floats: on three floats, plain Python is
several times faster than NumPy.

The air: drag of the frame, and what it does to rotors that move through it (`with_rotor_air`). What
rotors at rest in it put on the body is in `rotors.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, cos, pi, sin, sqrt
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.truth import GRAVITY, Truth, tensor_elements

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle

    Number = TypeVar("Number", float, Float[np.ndarray, " n"])
    """A float in the inner loop, or a column of them for the samples of a whole flight."""

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Tensor = tuple[float, float, float, float, float, float]
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
def rotation(
    quaternion: tuple[Number, Number, Number, Number],
) -> tuple[
    tuple[Number, Number, Number], tuple[Number, Number, Number], tuple[Number, Number, Number]
]:
    """Convert a unit quaternion (w, x, y, z) to a rotation matrix."""
    w, x, y, z = quaternion
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
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


NO_DRAG: Final = (0.0, 0.0, 0.0)
NO_WIND: Final = (0.0, 0.0, 0.0)
AIR_DENSITY: Final = 1.2
"""Density of the air [kg/m^3]."""
LEAST_LOAD: Final = 0.01
"""Thrust over weight below which the induced velocity falls no further."""
INFLOW_STEPS: Final = 7
"""Newton steps for the induced velocity: to 1e-6 of that in hover, at any velocity."""

Wrench = Sequence[float]
"""Nine floats: what acts on the body, gravity left out, body axes, about the origin. Force (3) [N],
torque (3) [N m], angular momentum Jr H of the rotors relative to the body (3) [N m s]. Behind them,
where the air acts on moving rotors, the speed of each [rad/s]."""


@frozen_dataclass
class RotorAir:
    """What the air does to rotors that move through it.

    - `places`, `axes`: of the rotors, from the origin [m].
    - `drag`, `inflow`, `wake`: see `Truth.rotor_drag`, `Truth.inflow` and `Truth.wake_moment`.
    - `hover`: velocity that the rotors induce in hover [m/s].
    - `hover_square`: mean squared speed of the rotors in hover [rad^2/s^2].
    """

    places: tuple[Vector, ...]
    axes: tuple[Vector, ...]
    drag: float
    inflow: float
    wake: tuple[float, float]
    hover: float
    hover_square: float


@frozen_dataclass
class RigidBody:
    """The inertial parameters, in the form that the inner loop reads.

    - `mass`, `first_moments`, `inertia`: mass, mass times centre of mass, and inertia Ixx, Iyy,
      Izz, Ixy, Ixz, Iyz about the origin.
    - `inverse_com_inertia`: the same elements of the inverse inertia about the CoM [1/(kg m^2)].
    - `drag`: force per velocity along each body axis [N s/m].
    - `drag_position`: where it acts, from the origin [m].
    - `wind`: velocity of the air, world axes [m/s].
    - `rotors`: what the air does to moving rotors; None: nothing.
    """

    mass: float
    first_moments: Vector
    inertia: Tensor
    inverse_com_inertia: Tensor
    drag: Vector = NO_DRAG
    drag_position: Vector = (0.0, 0.0, 0.0)
    wind: Vector = NO_WIND
    rotors: RotorAir | None = None


def rigid_body(truth: Truth, vehicle: Vehicle | None = None) -> RigidBody:
    """Build the body of a vehicle; without its rotors' places, the air does nothing to them."""
    return RigidBody(
        mass=truth.mass,
        first_moments=truth.first_moments,
        inertia=truth.inertia,
        inverse_com_inertia=tensor_elements(np.linalg.inv(truth.com_inertia)),
        drag=truth.drag,
        drag_position=truth.drag_position,
        wind=truth.wind,
        rotors=None if vehicle is None else rotor_air(truth, vehicle),
    )


def rotor_air(truth: Truth, vehicle: Vehicle) -> RotorAir | None:
    """Collect what the air does to moving rotors; None if it does nothing."""
    if not (truth.rotor_drag or truth.inflow or any(truth.wake_moment)):
        return None
    hover = 0.0
    if truth.propeller > 0.0:
        disks = len(vehicle.rotors) * pi * (truth.propeller / 2.0) ** 2
        # In hover each rotor carries its share of the weight: m g / N = 2 rho pi (D/2)^2 v_h^2.
        hover = sqrt(truth.mass * GRAVITY / (2.0 * AIR_DENSITY * disks))
    return RotorAir(
        places=tuple(rotor.position for rotor in vehicle.rotors),
        axes=tuple(rotor.axis for rotor in vehicle.rotors),
        drag=truth.rotor_drag,
        inflow=truth.inflow,
        wake=truth.wake_moment,
        hover=hover,
        hover_square=truth.mass * GRAVITY / (len(vehicle.rotors) * truth.kt),
    )


@no_type_check
def accelerations(
    body: RigidBody, wrench: Sequence[Number], w: tuple[Number, Number, Number]
) -> tuple[tuple[Number, Number, Number], tuple[Number, Number, Number]]:
    """Solve Newton-Euler about the body origin for a and dw.

        m a + dw x ms + w x (w x ms) = f
        I dw + w x (I w + Jr H) + ms x a = tau

    With a from the first put into the second, the inertia about the centre of mass is left in
    front of dw (the Schur complement of the mass).
    """
    m, (mx, my, mz) = body.mass, body.first_moments
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = body.inertia
    Jxx, Jyy, Jzz, Jxy, Jxz, Jyz = body.inverse_com_inertia
    fx, fy, fz, tx, ty, tz, hx, hy, hz = wrench[:9]
    x, y, z = w
    # w x ms, and f - w x (w x ms)
    ux, uy, uz = y * mz - z * my, z * mx - x * mz, x * my - y * mx
    fx, fy, fz = fx - (y * uz - z * uy), fy - (z * ux - x * uz), fz - (x * uy - y * ux)
    # I w + Jr H, and tau - w x (I w + Jr H) - ms x a for dw = 0
    Lx = Ixx * x + Ixy * y + Ixz * z + hx
    Ly = Ixy * x + Iyy * y + Iyz * z + hy
    Lz = Ixz * x + Iyz * y + Izz * z + hz
    tx = tx - (y * Lz - z * Ly) - (my * fz - mz * fy) / m
    ty = ty - (z * Lx - x * Lz) - (mz * fx - mx * fz) / m
    tz = tz - (x * Ly - y * Lx) - (mx * fy - my * fx) / m
    dx = Jxx * tx + Jxy * ty + Jxz * tz
    dy = Jxy * tx + Jyy * ty + Jyz * tz
    dz = Jxz * tx + Jyz * ty + Jzz * tz
    ax = (fx - (dy * mz - dz * my)) / m
    ay = (fy - (dz * mx - dx * mz)) / m
    az = (fz - (dx * my - dy * mx)) / m
    return (ax, ay, az), (dx, dy, dz)


@no_type_check
def with_drag(
    body: RigidBody,
    wrench: Sequence[Number],
    velocity: tuple[Number, Number, Number],
    w: tuple[Number, Number, Number],
) -> tuple[Number, ...]:
    """Add the frame's drag; the origin moves with `velocity` through the air [m/s], turns with `w`.

    Forces -c v at `drag_position`.
    """
    cx, cy, cz = body.drag
    px, py, pz = body.drag_position
    fx, fy, fz, tx, ty, tz, *rest = wrench
    (vx, vy, vz), (x, y, z) = velocity, w
    dx = cx * (vx + y * pz - z * py)
    dy = cy * (vy + z * px - x * pz)
    dz = cz * (vz + x * py - y * px)
    fx, fy, fz = fx - dx, fy - dy, fz - dz
    tx, ty, tz = tx - (py * dz - pz * dy), ty - (pz * dx - px * dz), tz - (px * dy - py * dx)
    return fx, fy, fz, tx, ty, tz, *rest


@no_type_check
def with_rotor_air(
    air: RotorAir,
    wrench: Sequence[Number],
    velocity: tuple[Number, Number, Number],
    w: tuple[Number, Number, Number],
) -> tuple[Number, ...]:
    """Add what the air does to rotors that move through it.

    Rotor i at r_i has the velocity v_i = v + w x r_i, of which u_i goes along its axis n_i. On it
    acts -c O_i (v_i - u_i n_i) - k_u O_i (u_i + nu_i - v_h) n_i, nu_i being its induced velocity,
    v_h that in still air: the square of it is in proportion to the thrust of all rotors.
    The wakes turn the body with (k_x v_y, -k_y v_x) times the mean of nu_i.
    """
    fx, fy, fz, tx, ty, tz, hx, hy, hz, *speeds = wrench
    (vx, vy, vz), (x, y, z) = velocity, w
    induced = 0.0 * vx
    still = still_inflow(air, speeds)
    for (px, py, pz), (nx, ny, nz), O in zip(air.places, air.axes, speeds, strict=True):
        ax, ay, az = vx + y * pz - z * py, vy + z * px - x * pz, vz + x * py - y * px
        u = ax * nx + ay * ny + az * nz
        ax, ay, az = ax - u * nx, ay - u * ny, az - u * nz
        lost = 0.0
        if air.hover > 0.0:
            nu = solve_inflow(ax * ax + ay * ay + az * az, u, still)
            induced = induced + nu
            lost = air.inflow * O * (u + nu - still)
        held = air.drag * O
        dx, dy, dz = held * ax + lost * nx, held * ay + lost * ny, held * az + lost * nz
        fx, fy, fz = fx - dx, fy - dy, fz - dz
        tx, ty, tz = tx - (py * dz - pz * dy), ty - (pz * dx - px * dz), tz - (px * dy - py * dx)
    kx, ky = air.wake
    nu = induced / len(air.places)
    return fx, fy, fz, tx + kx * nu * vy, ty - ky * nu * vx, tz, hx, hy, hz, *speeds


@no_type_check
def still_inflow(air: RotorAir, speeds: Sequence[Number]) -> Number:
    """Compute the velocity that rotors at these speeds induce in still air [m/s].

    Momentum theory: T = 2 rho A v_h^2, with the thrust T of all rotors over that of hover.
    """
    load: Any = sum(O * O for O in speeds) / (len(air.places) * air.hover_square)
    load = 0.5 * (load + LEAST_LOAD + abs(load - LEAST_LOAD))  # the larger of the two
    still: Any = air.hover * load**0.5
    return still


@no_type_check
def solve_inflow(squared_across: Number, along: Number, hover: Number) -> Number:
    """Solve Glauert's nu^2 (v_perp^2 + (u + nu)^2) = v_h^4 for a rotor's induced velocity [m/s].

    `squared_across`, `along`: v_perp^2 and u, of its velocity through the air across its axis and
    along it. `hover`: v_h, the induced velocity in still air. By Newton steps of the logarithms.
    There are three roots where it falls so fast and so steeply that it meets its own wake
    (u^2 > 8 v_perp^2), and none of them is right: there, past half of v_h, it counts as falling
    with the larger of v_h / 2 and 2 v_perp.
    """
    across: Any = squared_across**0.5
    slow = 0.5 * hover
    steepest = across + 0.5 * slow + abs(across - 0.5 * slow)  # the larger of slow and 2 across
    u = 0.5 * (along - steepest + abs(along + steepest))  # the larger of along and -steepest
    nu: Any = hover + 0.0 * u
    for _ in range(INFLOW_STEPS):
        through = u + nu
        squared = squared_across + through * through
        nu = nu * (hover**4 / (nu * nu * squared)) ** (0.5 / (1.0 + nu * through / squared))
    return nu


@no_type_check
def through_air(
    wind: Vector,
    R: tuple[tuple[Number, Number, Number], ...],
    velocity: tuple[Number, Number, Number],
) -> tuple[Number, Number, Number]:
    """Subtract a wind in world axes from a velocity in body axes, R body to world."""
    if wind == NO_WIND:
        return velocity
    (Rxx, Rxy, Rxz), (Ryx, Ryy, Ryz), (Rzx, Rzy, Rzz) = R
    (x, y, z), (vx, vy, vz) = wind, velocity
    return (
        vx - (Rxx * x + Ryx * y + Rzx * z),
        vy - (Rxy * x + Ryy * y + Rzy * z),
        vz - (Rxz * x + Ryz * y + Rzz * z),
    )


@no_type_check
def derivative(body: RigidBody, wrench: Wrench, state: State) -> State:
    """Differentiate the state by time under a wrench.

    dw and a as in `accelerations`; q' = q (0, w) / 2; v' = a + R^T g - w x v; p' = R v.
    """
    x, y, z, qw, qx, qy, qz, vx, vy, vz, _, _, _ = state
    w = (x, y, z)
    R = rotation((qw, qx, qy, qz))
    moving = through_air(body.wind, R, (vx, vy, vz))
    if body.drag != NO_DRAG:
        wrench = with_drag(body, wrench, moving, w)
    if body.rotors is not None:
        wrench = with_rotor_air(body.rotors, wrench, moving, w)
    (ax, ay, az), (dx, dy, dz) = accelerations(body, wrench, w)
    (Rxx, Rxy, Rxz), (Ryx, Ryy, Ryz), (Rzx, Rzy, Rzz) = R
    dqw = -0.5 * (qx * x + qy * y + qz * z)
    dqx = 0.5 * (qw * x + qy * z - qz * y)
    dqy = 0.5 * (qw * y + qz * x - qx * z)
    dqz = 0.5 * (qw * z + qx * y - qy * x)
    dvx = ax - GRAVITY * Rzx - (y * vz - z * vy)
    dvy = ay - GRAVITY * Rzy - (z * vx - x * vz)
    dvz = az - GRAVITY * Rzz - (x * vy - y * vx)
    dpx = Rxx * vx + Rxy * vy + Rxz * vz
    dpy = Ryx * vx + Ryy * vy + Ryz * vz
    dpz = Rzx * vx + Rzy * vy + Rzz * vz
    return dx, dy, dz, dqw, dqx, dqy, dqz, dvx, dvy, dvz, dpx, dpy, dpz


@no_type_check
def step(body: RigidBody, wrenches: Sequence[Wrench], state: State, h: float) -> State:
    """Take a classical Runge-Kutta step of length `h` [s]; wrenches at begin, middle and end."""
    begin, middle, end = wrenches
    k1 = derivative(body, begin, state)
    k2 = derivative(body, middle, _follow_slope(state, k1, h / 2))
    k3 = derivative(body, middle, _follow_slope(state, k2, h / 2))
    k4 = derivative(body, end, _follow_slope(state, k3, h))
    weighted = [a + 2.0 * (b + c) + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
    x, y, z, qw, qx, qy, qz, vx, vy, vz, px, py, pz = _follow_slope(state, weighted, h / 6)
    length = (qw * qw + qx * qx + qy * qy + qz * qz) ** 0.5
    qw, qx, qy, qz = qw / length, qx / length, qy / length, qz / length
    return (x, y, z, qw, qx, qy, qz, vx, vy, vz, px, py, pz)


@no_type_check
def _follow_slope(state: State, slope: Sequence[float], h: float) -> State:
    """Follow a slope from a state for `h` [s]."""
    x, y, z, qw, qx, qy, qz, vx, vy, vz, px, py, pz = state
    dx, dy, dz, dqw, dqx, dqy, dqz, dvx, dvy, dvz, dpx, dpy, dpz = slope
    x, y, z = x + h * dx, y + h * dy, z + h * dz
    qw, qx, qy, qz = qw + h * dqw, qx + h * dqx, qy + h * dqy, qz + h * dqz
    vx, vy, vz = vx + h * dvx, vy + h * dvy, vz + h * dvz
    px, py, pz = px + h * dpx, py + h * dpy, pz + h * dpz
    return x, y, z, qw, qx, qy, qz, vx, vy, vz, px, py, pz
