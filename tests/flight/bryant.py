"""Bryant angles as Six et al. 2020 use them, to compare with quaternions."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.kinematics import BodyMotion
from rotorfit.flight.signals import spline_derivatives

STEEPEST = np.radians(85.0)
"""Where Bryant angles are given up: at a pitch of 90 degrees psi and phi are one angle."""


def motion_from_bryant(
    position: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 3"],
    sample_rate: float,
) -> BodyMotion:
    r"""Differentiate position and Bryant angles (psi, theta, phi), R = Rz(psi) Ry(theta) Rx(phi).

    :math:`\omega = T \dot\eta`, :math:`\dot\omega = \dot T \dot\eta + T \ddot\eta` (Six et al.
    2020, eq. 5-7). Raises near gimbal lock.
    """
    steepest = float(np.abs(angles[:, 1]).max())
    if steepest > STEEPEST:
        raise FlightError(
            f"the pitch reaches {np.degrees(steepest):.0f} degrees, where Bryant angles have no "
            "rates (gimbal lock); use quaternions"
        )
    rate, second = spline_derivatives(angles, sample_rate)
    T, dT = bryant_matrix(angles), bryant_matrix_rate(angles, rate)
    velocity, acceleration = spline_derivatives(position, sample_rate)
    to_body = Rotation.from_euler("ZYX", angles).inv()
    return BodyMotion(
        specific_force=to_body.apply(acceleration + np.array([0.0, 0.0, GRAVITY])),
        angular_velocity=np.einsum("nij,nj->ni", T, rate),
        angular_acceleration=np.einsum("nij,nj->ni", dT, rate) + np.einsum("nij,nj->ni", T, second),
        velocity=to_body.apply(velocity),
    )


def bryant_angles(attitude_wxyz: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """Compute psi, theta, phi of body-to-world quaternions, without jumps by whole turns [rad]."""
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
