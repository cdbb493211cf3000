"""The autopilot: a cascade from position to attitude to rates to rotor speeds, as in PX4.

It sees the true state: sensor noise does not come back through the motors, so that one flight can
be measured with any number of noises.
"""

from __future__ import annotations

from math import atan, atan2, cos, sin, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.body import (
    Matrix,
    State,
    Vector,
    clip,
    no_type_check,
    quaternion_from_euler,
    rotation,
    rotation_vector_between,
    times,
    yaw_of,
)
from rotorfit.simulation.rotors import allocation
from rotorfit.simulation.truth import GRAVITY, Truth

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.pilot import Reference


@frozen_dataclass
class Gains:
    """Gains of the loops, from the outermost to the innermost.

    - `position`, `velocity`: horizontal acceleration per error [1/s^2, 1/s].
    - `height`, `climb`: vertical acceleration per error [1/s^2, 1/s].
    - `hold_tilt`: largest tilt that the position hold may add to a stick [rad].
    - `attitude`: rate per angle about each body axis [1/s].
    - `rate`: angular acceleration per rate error about each body axis [1/s].
    - `damping`: fraction of the angular acceleration that is fed back; 1 halves the motor lag. None
      about yaw, where the reaction of rotors with inertia acts at once and would ring.
    - `integral`: growth of the torque trim about each body axis, as angular acceleration per angle
      [1/s^2].
    """

    position: float = 0.5
    velocity: float = 0.8
    height: float = 0.6
    climb: float = 0.8
    hold_tilt: float = 0.2
    attitude: Vector = (5.8, 5.8, 0.3)
    rate: Vector = (25.0, 25.0, 3.0)
    damping: Vector = (1.0, 1.0, 0.0)
    integral: Vector = (4.0, 4.0, 0.2)


@frozen_dataclass
class Autopilot:
    """The autopilot of one vehicle.

    - `mass`, `inertia`: what it believes: mass [kg] and diagonal of the inertia [kg m^2].
    - `mixer`: squared speeds per vertical force and torque, the pseudo-inverse of the allocation; a
      row for each rotor.
    - `speed_limits`: lowest speed of a running motor and highest speed [rad/s].
    - `period`: time between two commands [s].
    """

    mass: float
    inertia: Vector
    mixer: list[list[float]]
    speed_limits: tuple[float, float]
    period: float
    gains: Gains


class Memory(NamedTuple):
    """What the autopilot remembers from one sample to the next.

    - `yaw`: heading asked for [rad].
    - `trim`: integrated torque [N m].
    - `angular_velocity`: of the last sample [rad/s].
    - `asked`: body rates that the attitude loop asked for [rad/s].
    """

    yaw: float
    trim: Vector
    angular_velocity: Vector
    asked: Vector


def autopilot_of(
    truth: Truth, vehicle: Vehicle, *, thrust_to_weight: float, period: float, gains: Gains
) -> Autopilot:
    """Tune an autopilot for a vehicle, ignoring the differences between its rotors.

    The largest speed follows from thrust over weight; the lowest gives 2 % of the weight.
    """
    nominal = allocation(vehicle, kt=np.full(len(vehicle.rotors), truth.kt), kd=truth.kd)
    lift = float(nominal[2].sum())
    highest = (thrust_to_weight * truth.mass * GRAVITY / lift) ** 0.5
    lowest = (0.02 * truth.mass * GRAVITY / lift) ** 0.5
    return Autopilot(
        mass=truth.mass,
        inertia=truth.inertia[:3],
        mixer=np.linalg.pinv(nominal[2:]).tolist(),
        speed_limits=(lowest, highest),
        period=period,
        gains=gains,
    )


def trimmed(truth: Truth) -> Memory:
    """Start the memory of an autopilot that has flown this vehicle before: ms x a at hover."""
    x, y, _ = truth.first_moments
    return Memory(0.0, (y * GRAVITY, -x * GRAVITY, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@no_type_check
def mix(autopilot: Autopilot, lift: float, torque: Vector) -> Float[np.ndarray, " N"]:
    """Allocate a force along body z and a torque to speeds within their limits."""
    x, y, z = torque
    lowest, highest = (limit * limit for limit in autopilot.speed_limits)
    squares = [a * lift + b * x + c * y + d * z for a, b, c, d in autopilot.mixer]
    return np.array([sqrt(min(max(square, lowest), highest)) for square in squares])


@no_type_check
def control(
    autopilot: Autopilot, memory: Memory, state: State, reference: Reference, *, grounded: bool
) -> tuple[Float[np.ndarray, " N"], Memory]:
    """Compute the commanded rotor speeds [rad/s] at one sample, and the new memory."""
    w = (state[0], state[1], state[2])
    R = rotation((state[3], state[4], state[5], state[6]))
    roll, pitch, lift = _outer_loops(autopilot, state, R, reference)
    yaw = yaw_of(R) if grounded else memory.yaw + reference.yaw_rate * autopilot.period
    asked = _rates_asked(autopilot, state, R, (roll, pitch, yaw), reference.yaw_rate)
    torque, trim = _rate_loop(autopilot, memory, w, asked)
    # On the ground the integrators rest, and the motors stand still unless the pilot spools them
    # up.
    remembered = Memory(yaw, memory.trim if grounded else trim, w, asked)
    if grounded and (reference.landing or reference.throttle == 0.0):
        return np.zeros(len(autopilot.mixer)), remembered
    if grounded:  # wide gear: hold the trim that will be needed at lift-off, and no more
        torque = memory.trim
    speeds = mix(autopilot, lift, torque)
    return sqrt(reference.throttle) * speeds, remembered


@no_type_check
def _outer_loops(
    autopilot: Autopilot, state: State, R: Matrix, reference: Reference
) -> tuple[float, float, float]:
    """Compute roll and pitch asked for [rad], and the force along body z [N]."""
    gains = autopilot.gains
    vx, vy, vz = times(R, (state[7], state[8], state[9]))
    px, py, pz = state[10:13]
    ax = gains.position * (reference.x - px) + gains.velocity * (reference.velocity_x - vx)
    ay = gains.position * (reference.y - py) + gains.velocity * (reference.velocity_y - vy)
    yaw = atan2(R[1][0], R[0][0])
    forward = cos(yaw) * ax + sin(yaw) * ay
    left = -sin(yaw) * ax + cos(yaw) * ay
    ahead = cos(yaw) * reference.push_x + sin(yaw) * reference.push_y
    aside = -sin(yaw) * reference.push_x + cos(yaw) * reference.push_y
    roll = reference.roll - atan(aside / GRAVITY) - clip(left / GRAVITY, gains.hold_tilt)
    pitch = reference.pitch + atan(ahead / GRAVITY) + clip(forward / GRAVITY, gains.hold_tilt)
    rise = gains.height * (reference.height - pz) + gains.climb * (reference.height_rate - vz)
    upright = max(R[2][2], 0.5)  # past 60 degrees the height is given up
    return roll, pitch, autopilot.mass * (GRAVITY + reference.climb + rise) / upright


@no_type_check
def _rates_asked(
    autopilot: Autopilot, state: State, R: Matrix, euler: Vector, yaw_rate: float
) -> Vector:
    """Compute the body rates [rad/s] that bring the attitude to the roll, pitch and yaw asked."""
    asked = quaternion_from_euler(*euler)
    error = rotation_vector_between((state[3], state[4], state[5], state[6]), asked)
    px, py, pz = autopilot.gains.attitude
    ux, uy, uz = R[2]
    return (
        px * error[0] + ux * yaw_rate,
        py * error[1] + uy * yaw_rate,
        pz * error[2] + uz * yaw_rate,
    )


@no_type_check
def _rate_loop(
    autopilot: Autopilot, memory: Memory, w: Vector, asked: Vector
) -> tuple[Vector, Vector]:
    """Compute the torque asked for and the new trim [N m]."""
    (Ix, Iy, Iz), gains, period = autopilot.inertia, autopilot.gains, autopilot.period
    (x, y, z), (last_x, last_y, last_z) = w, memory.angular_velocity
    (kx, ky, kz), (dx, dy, dz), (ix, iy, iz) = gains.rate, gains.damping, gains.integral
    ex, ey, ez = asked[0] - x, asked[1] - y, asked[2] - z
    tx = memory.trim[0] + Ix * ix * ex * period
    ty = memory.trim[1] + Iy * iy * ey * period
    tz = memory.trim[2] + Iz * iz * ez * period
    torque = (
        tx + Ix * (kx * ex - dx * (x - last_x) / period),
        ty + Iy * (ky * ey - dy * (y - last_y) / period),
        tz + Iz * (kz * ez - dz * (z - last_z) / period),
    )
    return torque, (tx, ty, tz)
