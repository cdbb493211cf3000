"""The rotors of a simulated vehicle: speed after speed command, and the wrench on the body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.body import no_type_check

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.truth import Truth

    Decay = tuple[Float[np.ndarray, "k 1"], Float[np.ndarray, "k 1"]]
    """exp(-t/lag) at times t, of rising and of falling speed; one array if the lags are equal."""


@frozen_dataclass
class Rotors:
    """The rotors of one vehicle, as constant matrices.

    - `wrench_matrix`: columns: force [N] and torque about the body origin [N m], angular momentum
      relative to the body [N m s]. Rows: per squared speed, per speed, and per slope of the speed
      of each rotor.
    - `lag`: time constant of the speed towards its command [s].
    - `lag_down`: the same while it falls [s].
    """

    wrench_matrix: Float[np.ndarray, "three_N 9"]
    lag: float
    lag_down: float

    @property
    def wrench_per_square(self) -> Float[np.ndarray, "6 N"]:
        """Force and torque about the body origin per squared speed [N s^2/rad^2, N m s^2/rad^2]."""
        return self.wrench_matrix[: len(self.wrench_matrix) // 3, :6].T


def rotors_of(truth: Truth, vehicle: Vehicle) -> Rotors:
    """Collect the rotors of a vehicle: s_i spins, n_i axes, (x_i, y_i) places.

    Per squared speed their `allocation`; per speed the torque -k_l s_i n_i and the angular momentum
    Jr s_i n_i; per slope the torque -Jr s_i n_i.
    """
    N = len(vehicle.rotors)
    spins = vehicle.spins[:, None] * vehicle.axes
    matrix = np.zeros((3, N, 9))
    matrix[0, :, :6] = allocation(vehicle, kt=truth.rotor_kt(N), kd=truth.kd).T
    matrix[1, :, 3:6] = -truth.kd_linear * spins
    matrix[1, :, 6:9] = truth.Jr * spins
    matrix[2, :, 3:6] = -truth.Jr * spins
    return Rotors(
        wrench_matrix=matrix.reshape(-1, 9), lag=truth.motor_lag, lag_down=truth.falling_lag
    )


def allocation(
    vehicle: Vehicle, *, kt: Float[np.ndarray, " N"], kd: float
) -> Float[np.ndarray, "6 N"]:
    """Compute the wrench about the body origin per squared rotor speed.

    Thrust kt_i O^2 along the axis n_i at the position P_i, and the air's torque
    -s_i kd O^2 n_i against the spin s_i (+1 for counter-clockwise seen from above).
    """
    n, s = vehicle.axes, vehicle.spins[:, None]
    thrust = kt[:, None] * n
    return np.vstack([thrust.T, (np.cross(vehicle.positions, thrust) - s * kd * n).T])


@no_type_check
def lagged(
    speed: Float[np.ndarray, " N"],
    command: Float[np.ndarray, " N"],
    decay: Decay,
) -> Float[np.ndarray, "k N"]:
    """Compute the rotor speeds after a constant command has acted for some times."""
    away = speed - command
    rising, falling = decay
    left = rising if rising is falling else np.where(away <= 0, rising, falling)
    # The step response of a first-order lag is exact: O(t) = u + (O(0) - u) exp(-t/lag).
    return command + left * away


def decay_over(truth: Truth, times: Float[np.ndarray, " k"]) -> Decay:
    """Compute exp(-t/lag) of rising and falling speed, zeros for motors without lag."""
    rising, falling = (
        np.exp(-times[:, None] / lag) if lag > 0 else np.zeros((times.size, 1))
        for lag in (truth.motor_lag, truth.falling_lag)
    )
    return (rising, rising) if truth.motor_lag == truth.falling_lag else (rising, falling)


@no_type_check
def speed_slopes(
    rotors: Rotors, speeds: Float[np.ndarray, "k N"], command: Float[np.ndarray, "#k N"]
) -> Float[np.ndarray, "k N"]:
    """Compute dO/dt = (u - O)/lag [rad/s^2]; zeros for a motor without lag."""
    if rotors.lag == 0:
        return np.zeros_like(speeds)
    away = command - speeds
    if rotors.lag == rotors.lag_down:
        return away / rotors.lag
    return away / np.where(away >= 0, rotors.lag, rotors.lag_down)


@no_type_check
def wrenches(
    rotors: Rotors, speeds: Float[np.ndarray, "k N"], slopes: Float[np.ndarray, "k N"]
) -> Float[np.ndarray, "k 9"]:
    """Compute the wrench of rotors at rest in the air at k instants, in rows as `body.Wrench`.

    Aerodynamic forces and torques, the reaction -Jr dH/dt, and the angular momentum Jr H for the
    gyroscopic torque -w x Jr H.
    """
    return np.concatenate([speeds * speeds, speeds, slopes], axis=1) @ rotors.wrench_matrix
