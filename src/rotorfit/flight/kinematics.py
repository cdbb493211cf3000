r"""Attitudes, and from motion capture to what a strapped-down IMU would measure.

Six et al. 2020, eq. 3-7. With the position :math:`\zeta` of the body origin, R from body to world
and gravity g along -z: the specific force is :math:`R^{-1}(\ddot\zeta - g)`; angular velocity and
acceleration follow from the attitude's first and second derivative. Quaternions (scalar first) have
no gimbal lock and are used throughout; the paper's Bryant angles stand in the tests, and agree.

Where no log has a velocity, accelerometer and gyro feel the one along the thrust. Air holds a climb
back, and the rotors lose thrust in it: at w rad/s a drag of a times the mass per second makes a
change of thrust look 1 / (1 + (a / w)^2) as strong as it is, so that k_t comes out too small where
the velocity is not in the model. Specific force, turned by the gyro into axes that
do not rotate, is acceleration but for gravity and slow errors, and its integral velocity but for
slow parts, which are taken out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.filters import without_line
from rotorfit.flight.signals import spline_derivatives
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData

    Vectors = Float[np.ndarray, "*m 3"]
    Quaternions = Float[np.ndarray, "*m 4"]


def small_turns(angles: Vectors) -> Quaternions:
    """Convert small rotation vectors [rad] to quaternions."""
    half = 0.5 * np.linalg.norm(angles, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * angles * np.sinc(half / np.pi)], axis=-1)


def running_product(q: Quaternions) -> Quaternions:
    """Compute q_1, q_1 q_2, q_1 q_2 q_3, ... in log2(length) steps."""
    step = 1
    while step < len(q):
        q = np.concatenate([q[:step], product(q[:-step], q[step:])])
        step *= 2
    return q


def rotated(q: Quaternions, v: Vectors) -> Vectors:
    """Rotate vectors from body axes to the axes that q refers to."""
    across = _cross_product(q[..., 1:], v)
    return v + 2.0 * (q[..., :1] * across + _cross_product(q[..., 1:], across))


def rotated_back(q: Quaternions, v: Vectors) -> Vectors:
    """Rotate vectors from those axes to body axes."""
    return rotated(q * [1.0, -1.0, -1.0, -1.0], v)


def rotation_matrices(q: Quaternions) -> Float[np.ndarray, "*n 3 3"]:
    """Return the matrices that rotate vectors as the unit quaternions do."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    matrix = np.empty((*w.shape, 3, 3))
    matrix[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    for i, j, sum_part, turn_part in (
        (1, 0, x * y, w * z),
        (0, 2, x * z, w * y),
        (2, 1, y * z, w * x),
    ):
        matrix[..., i, j] = 2.0 * (sum_part + turn_part)
        matrix[..., j, i] = 2.0 * (sum_part - turn_part)
    return matrix


def product(p: Quaternions, q: Quaternions) -> Quaternions:
    """Return the turn q followed by p."""
    a, b = p[..., 1:], q[..., 1:]
    scalar = p[..., :1] * q[..., :1] - (a * b).sum(axis=-1, keepdims=True)
    vector = p[..., :1] * b + q[..., :1] * a + _cross_product(a, b)
    return np.concatenate([scalar, vector], axis=-1)


def _cross_product(a: Vectors, b: Vectors) -> Vectors:
    """Return a x b; NumPy's own takes four times as long."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


@frozen_dataclass
class BodyMotion:
    """The motion by a pose, body axes, every column at the instant of its sample.

    - `specific_force`: acceleration minus gravity at the body origin [m/s^2].
    - `angular_velocity`, `angular_acceleration`: of the body relative to the world [rad/s],
      [rad/s^2].
    - `velocity`: of the body origin [m/s].
    """

    specific_force: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]


def continuous_quaternions(attitude_wxyz: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Normalise quaternions, and choose each sign nearest to the one before."""
    q = attitude_wxyz / np.linalg.norm(attitude_wxyz, axis=1, keepdims=True)
    # q and -q are the same attitude, and motion capture changes between them at will; a difference
    # over such a change would be a turn at enormous speed.
    turned = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0
    signs = np.concatenate([[1.0], np.where(turned, -1.0, 1.0)]).cumprod()
    return q * signs[:, None]


def motion_from_quaternions(
    position: Float[np.ndarray, "n 3"],
    attitude_wxyz: Float[np.ndarray, "n 4"],
    sample_rate: float,
) -> BodyMotion:
    r"""Differentiate position (world, z up [m]) and attitude (body to world, no jumps of sign).

    :math:`\omega = 2\,\mathrm{vec}(q^* \dot q)`, and since :math:`\dot q^* \dot q` has no vector
    part, :math:`\dot\omega = 2\,\mathrm{vec}(q^* \ddot q)`, both for quaternions of unit length.
    """
    q = attitude_wxyz
    dq, ddq = spline_derivatives(q, sample_rate)
    size: Float[np.ndarray, "n 1"] = (q * q).sum(axis=1, keepdims=True)
    velocity, acceleration = spline_derivatives(position, sample_rate)
    attitude = q / np.sqrt(size)
    return BodyMotion(
        specific_force=rotated_back(attitude, acceleration + np.array([0.0, 0.0, GRAVITY])),
        angular_velocity=2.0 * _conjugate_times(q, dq) / size,
        angular_acceleration=2.0 * _conjugate_times(q, ddq) / size,
        velocity=rotated_back(attitude, velocity),
    )


def _conjugate_times(
    q: Float[np.ndarray, "n 4"], p: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 3"]:
    """Return the vector part of q* p."""
    return q[:, :1] * p[:, 1:] - p[:, :1] * q[:, 1:] - np.cross(q[:, 1:], p[:, 1:])


SLOWEST: Final = 0.1
"""What changes more slowly is left out [Hz]: there the errors of the gyro and of the accelerometer,
integrated, are the larger part."""
STEPS_PER_SECOND: Final = 100.0
"""Rate at which axes are carried by the gyro [Hz]."""


def carried_group(sample_rate: float) -> int:
    """Return how many samples are averaged before axes are carried."""
    return max(round(sample_rate / STEPS_PER_SECOND), 1)


def climb_velocity(data: FlightData) -> Float[np.ndarray, " n"]:
    """Integrate the velocity along body z [m/s]; zero outside the segments' rows and neighbours."""
    climb = np.zeros(len(data.time))
    for segment in data.segments:
        rows = slice(max(segment.start - 1, 0), segment.stop + 1)
        climb[rows] = _along_z(
            data.specific_force[rows], data.angular_velocity[rows], data.sample_rate
        )
    return climb


def _along_z(
    force: Float[np.ndarray, "n 3"], rates: Float[np.ndarray, "n 3"], sample_rate: float
) -> Float[np.ndarray, " n"]:
    """Integrate the velocity of one segment along z, without slow changes."""
    group = carried_group(sample_rate)
    count = len(force) // group
    if count < 2:
        return np.zeros(len(force))
    step = group / sample_rate
    f, w = (x[: count * group].reshape(count, group, 3).mean(axis=1) for x in (force, rates))
    # From the middle of one group to that of the next.
    between = np.concatenate([np.zeros((1, 3)), 0.5 * (w[:-1] + w[1:]) * step])
    attitude = running_product(small_turns(between))
    a = rotated(attitude, f)
    a -= a.mean(axis=0)
    v: Float[np.ndarray, "m 3"] = (np.cumsum(a, axis=0) - 0.5 * a) * step
    v = without_line(v)
    # Cosines, as of a record that goes on backwards: its ends do not jump.
    lines = np.fft.rfft(np.concatenate([v, v[::-1]]), axis=0)
    lines[: int(2.0 * SLOWEST * count * step) + 1] = 0.0
    velocity = np.fft.irfft(lines, 2 * count, axis=0)[:count]
    along = rotated_back(attitude, velocity)[:, 2]
    middle = (np.arange(count) + 0.5) * group - 0.5
    return np.interp(np.arange(len(force)), middle, along)
