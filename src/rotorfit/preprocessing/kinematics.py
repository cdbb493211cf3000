r"""Attitudes, and from motion capture to what a strapped-down IMU would measure.

Six et al. 2020, eq. 3-7. With the position :math:`\zeta` of the body origin, R from body to world
and gravity g along -z: the specific force is :math:`R^{-1}(\ddot\zeta - g)`; angular velocity and
acceleration follow from the attitude's first and second derivative. Quaternions (scalar first) have
no gimbal lock and are used throughout; the paper's Bryant angles serve for comparison.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.signals import spline_derivatives

Vectors = Float[np.ndarray, "*m 3"]
Quaternions = Float[np.ndarray, "*m 4"]


def small_turns(angles: Vectors) -> Quaternions:
    """Return the quaternions of small rotation vectors [rad]."""
    half = 0.5 * np.linalg.norm(angles, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * angles * np.sinc(half / np.pi)], axis=-1)


def running_product(q: Quaternions) -> Quaternions:
    """Return q_1, q_1 q_2, q_1 q_2 q_3, ... in as many steps as the length has digits."""
    step = 1
    while step < len(q):
        q = np.concatenate([q[:step], _product(q[:-step], q[step:])])
        step *= 2
    return q


def rotated(q: Quaternions, v: Vectors) -> Vectors:
    """Return vectors of the body in the axes that q turns it from."""
    across = _cross(q[..., 1:], v)
    return v + 2.0 * (q[..., :1] * across + _cross(q[..., 1:], across))


def rotated_back(q: Quaternions, v: Vectors) -> Vectors:
    """Return vectors of those axes in the axes of the body."""
    return rotated(q * [1.0, -1.0, -1.0, -1.0], v)


def _product(p: Quaternions, q: Quaternions) -> Quaternions:
    a, b = p[..., 1:], q[..., 1:]
    scalar = p[..., :1] * q[..., :1] - (a * b).sum(axis=-1, keepdims=True)
    vector = p[..., :1] * b + q[..., :1] * a + _cross(a, b)
    return np.concatenate([scalar, vector], axis=-1)


def _cross(a: Vectors, b: Vectors) -> Vectors:
    """Return a x b; NumPy's own takes four times as long."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


STEEPEST = np.radians(85.0)
"""Where Bryant angles are given up: at a pitch of 90 degrees psi and phi are one angle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyMotion:
    """What a pose tells of the motion, body axes, every column at the instant of its sample.

    Attributes
    ----------
    specific_force
        Acceleration minus gravity at the body origin [m/s^2].
    angular_velocity, angular_acceleration
        Of the body relative to the world [rad/s], [rad/s^2].
    velocity
        Of the body origin [m/s].
    """

    specific_force: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]


def continuous_quaternions(attitude_wxyz: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Return unit quaternions of the sign that makes each nearest to the one before it.

    q and -q are the same attitude, and motion capture changes between them at will; a difference
    over such a change would be a turn at enormous speed.
    """
    q = attitude_wxyz / np.linalg.norm(attitude_wxyz, axis=1, keepdims=True)
    turned = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0
    signs = np.concatenate([[1.0], np.where(turned, -1.0, 1.0)]).cumprod()
    return q * signs[:, None]


def motion_from_quaternions(
    position: Float[np.ndarray, "n 3"],
    attitude_wxyz: Float[np.ndarray, "n 4"],
    sample_rate: float,
) -> BodyMotion:
    r"""Return the motion of a body from its position and its attitude as quaternions.

    :math:`\omega = 2\,\mathrm{vec}(q^* \dot q)`, and since :math:`\dot q^* \dot q` has no vector
    part, :math:`\dot\omega = 2\,\mathrm{vec}(q^* \ddot q)`, both for quaternions of unit length.

    Parameters
    ----------
    position
        Of the body origin, world axes with z up [m].
    attitude_wxyz
        Body to world, unit length, without jumps of sign.
    sample_rate
        Of the samples [Hz].
    """
    q = attitude_wxyz
    dq, ddq = spline_derivatives(q, sample_rate)
    size: Float[np.ndarray, "n 1"] = (q * q).sum(axis=1, keepdims=True)
    return _body_motion(
        Rotation.from_quat(np.roll(q, -1, axis=1)),
        spline_derivatives(position, sample_rate),
        2.0 * _conjugate_times(q, dq) / size,
        2.0 * _conjugate_times(q, ddq) / size,
    )


def motion_from_bryant(
    position: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 3"],
    sample_rate: float,
) -> BodyMotion:
    r"""Return the motion of a body from its position and its Bryant angles.

    :math:`\omega = T \dot\eta`, :math:`\dot\omega = \dot T \dot\eta + T \ddot\eta` (Six et al.
    2020, eq. 5-7).

    Parameters
    ----------
    position
        Of the body origin, world axes with z up [m].
    angles
        eta = (psi, theta, phi) with R = Rz(psi) Ry(theta) Rx(phi), without jumps [rad].
    sample_rate
        Of the samples [Hz].

    Raises
    ------
    FlightError
        If the attitude comes near gimbal lock.
    """
    steepest = float(np.abs(angles[:, 1]).max())
    if steepest > STEEPEST:
        raise FlightError(
            f"the pitch reaches {np.degrees(steepest):.0f} degrees, where Bryant angles have no "
            "rates (gimbal lock); use quaternions"
        )
    rate, second = spline_derivatives(angles, sample_rate)
    T, dT = bryant_matrix(angles), bryant_matrix_rate(angles, rate)
    return _body_motion(
        Rotation.from_euler("ZYX", angles),
        spline_derivatives(position, sample_rate),
        np.einsum("nij,nj->ni", T, rate),
        np.einsum("nij,nj->ni", dT, rate) + np.einsum("nij,nj->ni", T, second),
    )


def bryant_angles(attitude_wxyz: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """Return psi, theta, phi of body-to-world quaternions, without jumps by whole turns [rad]."""
    R = Rotation.from_quat(np.roll(attitude_wxyz, -1, axis=1)).as_matrix()
    psi = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    theta = -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
    phi = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return np.unwrap(np.stack([psi, theta, phi], axis=1), axis=0)


def bryant_matrix(angles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Return T of omega = T eta', omega in body axes (Six et al. 2020, eq. 6).

    The columns are the axes of psi, theta and phi, seen from the body.
    """
    _, theta, phi = angles.T
    T = np.zeros((len(angles), 3, 3))
    T[:, 0, 0] = -np.sin(theta)
    T[:, 1, 0] = np.cos(theta) * np.sin(phi)
    T[:, 2, 0] = np.cos(theta) * np.cos(phi)
    T[:, 1, 1] = np.cos(phi)
    T[:, 2, 1] = -np.sin(phi)
    T[:, 0, 2] = 1.0
    return T


def bryant_matrix_rate(
    angles: Float[np.ndarray, "n 3"], rates: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """Return the time derivative of T (Six et al. 2020, eq. 7), from angles and their rates."""
    _, theta, phi = angles.T
    _, dtheta, dphi = rates.T
    dT = np.zeros((len(angles), 3, 3))
    dT[:, 0, 0] = -np.cos(theta) * dtheta
    dT[:, 1, 0] = np.cos(theta) * np.cos(phi) * dphi - np.sin(theta) * np.sin(phi) * dtheta
    dT[:, 2, 0] = -np.cos(theta) * np.sin(phi) * dphi - np.sin(theta) * np.cos(phi) * dtheta
    dT[:, 1, 1] = -np.sin(phi) * dphi
    dT[:, 2, 1] = -np.cos(phi) * dphi
    return dT


def _body_motion(
    attitude: Rotation,
    place: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]],
    angular_velocity: Float[np.ndarray, "n 3"],
    angular_acceleration: Float[np.ndarray, "n 3"],
) -> BodyMotion:
    """Return the motion, with velocity and acceleration of the origin turned into body axes."""
    velocity, acceleration = place
    to_body = attitude.inv()
    return BodyMotion(
        specific_force=to_body.apply(acceleration + np.array([0.0, 0.0, GRAVITY])),
        angular_velocity=angular_velocity,
        angular_acceleration=angular_acceleration,
        velocity=to_body.apply(velocity),
    )


def _conjugate_times(
    q: Float[np.ndarray, "n 4"], p: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 3"]:
    """Return the vector part of q* p."""
    return q[:, :1] * p[:, 1:] - p[:, :1] * q[:, 1:] - np.cross(q[:, 1:], p[:, 1:])
