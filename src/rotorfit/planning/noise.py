"""The noise that a plan assumes: sensors, gusts, and how exactly the motors are known to turn.

Gusts are those under which the estimators were measured (0.1 N and 6, 6, 1.5 mN m at 3 Hz on a
quadrotor of 1.285 kg with arms of 0.2 m), in parts of the weight and of weight times arm, so that
they fit any size. Real flights: a 3-inch quadrotor in a hall 0.13 to 0.33 % of weight times arm in
roll and pitch, 0.06 to 0.15 % in yaw; a Crazyflie by its commands 2 %, as much as motors that
deviate by 3 % from their commands.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.bound import Linearised
from rotorfit.estimation.factors import Factors
from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation import GRAVITY, Truth
from rotorfit.simulation.motors import allocation

REFERENCE_RATE: Final = 200.0
"""The rate at which noise of a sample is given [Hz]: it is white, and only its density counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Levels of noise and disturbance.

    Attributes
    ----------
    gyro_std, accel_std
        Of a sample at 200 Hz, vibration included [rad/s, m/s^2].
    speed_noise
        Of a measured rotor speed at 200 Hz, as a share of the hover speed.
    speed_error
        Of a commanded rotor speed: the motor's deviation from its command, a first-order
        Gauss-Markov process of the gusts' corner, as a share of the hover speed.
    force, torque
        Gusts: each force [weights]; torques about x, y, z [weights times arm].
    corner
        Of gusts and speed errors [Hz].
    mass_step
        The scale's [kg]: mass is known to half of it.
    log_rate
        Samples per second of the log; motor data are timed to a fraction of a sample [Hz].
    """

    gyro_std: float = 0.02
    accel_std: float = 0.4
    speed_noise: float = 0.005
    speed_error: float = 0.01
    force: float = 0.008
    torque: tuple[float, float, float] = (0.0024, 0.0024, 0.0006)
    corner: float = 3.0
    mass_step: float = 1e-3
    log_rate: float = 200.0


def assumptions_for(mass: float, *, log_rate: float = REFERENCE_RATE) -> Assumptions:
    """Return the assumptions for a vehicle; a light one is weighed on a finer scale."""
    return Assumptions(mass_step=1e-4 if mass < 0.2 else 1e-3, log_rate=log_rate)


def hover_speed(truth: Truth, vehicle: Vehicle) -> float:
    """Return the rotor speed that carries the weight [rad/s]."""
    lift = truth.kt * float(vehicle.axes[:, 2].sum())
    return float(np.sqrt(truth.mass * GRAVITY / lift))


def disturbance_std(
    assumed: Assumptions, truth: Truth, vehicle: Vehicle, *, commanded: bool
) -> Float[np.ndarray, " 6"]:
    """Return the deviation of the disturbing force [N] and torque [N m]; body axes.

    With commands the motors' errors come in, independent for each rotor.
    """
    weight = truth.mass * GRAVITY
    gusts = weight * np.array([*[assumed.force] * 3, *(vehicle.arm * np.array(assumed.torque))])
    if not commanded:
        return gusts
    per_square = allocation(vehicle, kt=truth.rotor_kt(len(vehicle.rotors)), kd=truth.kd)
    rotors = per_square * (2.0 * assumed.speed_error * hover_speed(truth, vehicle) ** 2)
    return np.hypot(gusts, np.linalg.norm(rotors, axis=1))


def row_variances(
    assumed: Assumptions,
    model: Linearised,
    factors: Factors,
    *,
    disturbance: Float[np.ndarray, " 6"],
    sample_rate: float,
) -> Float[np.ndarray, "b 6"]:
    """Return the variance of the six accelerations' errors per row of each band.

    A row is the real or the imaginary part of a line scaled to unit window energy: of a process
    with the one-sided density S it has the variance S times the sample rate over four.

    Parameters
    ----------
    assumed
        Levels of noise.
    model
        How residuals of the equations and noise of the rotors' signals become acceleration.
    factors
        Of the flight, their `noise` that of the measured rotor speeds.
    disturbance
        Deviation of force and torque [N, N m].
    sample_rate
        Of the flight [Hz].
    """
    f = factors.band.mean(axis=1)[:, None]
    white = 0.5 * sample_rate / REFERENCE_RATE
    turn = 2.0 * np.pi * f / REFERENCE_RATE
    average, difference = (4.0 + 2.0 * np.cos(turn)) / 6.0, np.sin(turn) * REFERENCE_RATE
    accel = white * (assumed.accel_std * average) ** 2 * np.ones(3)
    gyro = white * (assumed.gyro_std * difference) ** 2 * np.ones(3)
    spectrum = 0.25 * sample_rate * 2.0 / (np.pi * assumed.corner) / (1 + (f / assumed.corner) ** 2)
    gusts = spectrum * ((model.of_residual * disturbance) ** 2).sum(axis=1)
    return np.hstack([accel, gyro]) + gusts + factors.known_noise @ (model.error**2).T
