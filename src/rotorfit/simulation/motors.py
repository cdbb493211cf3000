"""The rotors: speed after speed command, and the wrench that they put on the body."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation.body import Wrench, no_type_check
from rotorfit.simulation.truth import Truth


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotors:
    """The rotors of one vehicle, as constant matrices.

    Attributes
    ----------
    wrench_per_square
        Force and torque about the body origin per squared speed [N s^2/rad^2, N m s^2/rad^2].
    spin_per_speed
        Angular momentum relative to the body per speed, Jr s_i n_i [kg m^2].
    yaw_damping_per_speed
        Torque against a turn about z per rate and rotor speed, c (x_i^2 + y_i^2) [N m s^2/rad^2].
    torque_per_speed
        Torque against the spin per speed, -k_l s_i n_i [N m s/rad].
    lag
        Time constant of the speed towards its command [s].
    lag_down
        The same while it falls [s].
    """

    wrench_per_square: Float[np.ndarray, "6 N"]
    spin_per_speed: Float[np.ndarray, "3 N"]
    yaw_damping_per_speed: Float[np.ndarray, " N"]
    torque_per_speed: Float[np.ndarray, "3 N"]
    lag: float
    lag_down: float


def rotors_of(truth: Truth, vehicle: Vehicle) -> Rotors:
    """Collect the rotors of a vehicle."""
    return Rotors(
        wrench_per_square=allocation(vehicle, kt=truth.rotor_kt(len(vehicle.rotors)), kd=truth.kd),
        spin_per_speed=truth.Jr * (vehicle.spins[:, None] * vehicle.axes).T,
        yaw_damping_per_speed=truth.rotor_drag * vehicle.squared_arms,
        torque_per_speed=-truth.kd_linear * (vehicle.spins[:, None] * vehicle.axes).T,
        lag=truth.motor_lag,
        lag_down=truth.falling_lag,
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
    decay: Float[np.ndarray, "2 k"],
) -> Float[np.ndarray, "k N"]:
    """Compute the rotor speeds after a constant command has acted for some times.

    The step response of a first-order lag is exact: O(t) = u + (O(0) - u) exp(-t/lag).
    """
    rising = (command >= speed).astype(float)
    left = decay[1][:, None] + rising * (decay[0] - decay[1])[:, None]
    return command + left * (speed - command)


def decay_over(truth: Truth, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "2 k"]:
    """Compute exp(-t/lag) of rising and falling speed, zeros for motors without lag."""
    lags = (truth.motor_lag, truth.falling_lag)
    return np.array([np.exp(-times / lag) if lag > 0 else np.zeros_like(times) for lag in lags])


@no_type_check
def speed_slopes(
    rotors: Rotors, speeds: Float[np.ndarray, "k N"], command: Float[np.ndarray, "#k N"]
) -> Float[np.ndarray, "k N"]:
    """Compute dO/dt = (u - O)/lag [rad/s^2]; zeros for a motor without lag."""
    if rotors.lag == 0:
        return np.zeros_like(speeds)
    away = command - speeds
    return away / np.where(away >= 0, rotors.lag, rotors.lag_down)


@no_type_check
def wrenches(
    rotors: Rotors,
    speeds: Float[np.ndarray, "k N"],
    slopes: Float[np.ndarray, "k N"],
    external: Float[np.ndarray, "k 6"],
) -> list[Wrench]:
    """Compute the wrench on the body at k instants.

    Aerodynamic forces and torques, the reaction -Jr dH/dt, the angular momentum Jr H for the
    gyroscopic torque -w x Jr H, the drag of rotors that a turn about z carries through the air,
    and an external wrench about the origin added.
    """
    applied = speeds * speeds @ rotors.wrench_per_square.T + external
    applied[:, 3:] += speeds @ rotors.torque_per_speed.T
    applied[:, 3:] -= slopes @ rotors.spin_per_speed.T
    spins: list[list[float]] = (speeds @ rotors.spin_per_speed.T).tolist()
    damping: list[float] = (speeds @ rotors.yaw_damping_per_speed).tolist()
    rows: list[list[float]] = applied.tolist()
    return [
        Wrench((fx, fy, fz), (tx, ty, tz), (hx, hy, hz), d)
        for (fx, fy, fz, tx, ty, tz), (hx, hy, hz), d in zip(rows, spins, damping, strict=True)
    ]
