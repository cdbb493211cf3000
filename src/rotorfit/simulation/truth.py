"""The truth of a simulated vehicle: the numbers that identification should find."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""


@frozen_dataclass
class Truth:
    """The physical parameters of a simulated multirotor, body axes FLU, SI units.

    - `mass`: of the whole vehicle [kg].
    - `first_moments`: mass times the position of the centre of mass from the body origin [kg m].
    - `inertia`: tensor elements Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the body origin, rotors (as if
      they stood still) included; Ixy = -int x y dm [kg m^2].
    - `kt`, `kd`: thrust and drag torque of a rotor per squared speed [N s^2/rad^2, N m s^2/rad^2].
    - `Jr`: inertia of one rotor about its axis [kg m^2].
    - `kt_spread`: factor of each rotor's own thrust coefficient to kt; empty for all ones.
    - `motor_lag`: time constant of the rotor speed towards its command [s]; 0: at once.
    - `motor_lag_down`: the same while the speed falls [s]; None: as it rises.
    - `motor_delay`: time that a command takes before the motor sees it [s].
    - `drag`: force per velocity along each body axis [N s/m].
    - `drag_position`: where it acts, by the velocity there, from the body origin [m].
    - `rotor_drag`: force against the velocity of a rotor across its axis through the air, per speed
      and per velocity [N s^2/(m rad)].
    - `inflow`: thrust that a rotor loses per speed and per velocity of the air through its disk
      above that in still air [N s^2/(m rad)].
    - `wake_moment`: torque about x and y per velocity along the other axis and per induced velocity
      of the rotors [N s^2/m]; it lifts the side towards which the vehicle moves.
    - `propeller`: diameter, by which thrust induces a velocity of the air [m]; 0: not needed.
    - `wind`: velocity of the air, world axes [m/s].
    - `kd_linear`: drag torque of a rotor per speed [N m s/rad].
    - `disturbance_force_std`, `disturbance_torque_std`: of each component of the disturbing wrench
      about the body origin [N, N m].
    - `disturbance_bandwidth`: corner frequency of the disturbance, a first-order Gauss-Markov
      process [Hz].
    """

    mass: float
    first_moments: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    kt: float
    kd: float
    Jr: float = 0.0
    kt_spread: tuple[float, ...] = ()
    motor_lag: float = 0.04
    motor_lag_down: float | None = None
    motor_delay: float = 0.0
    drag: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drag_position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotor_drag: float = 0.0
    inflow: float = 0.0
    wake_moment: tuple[float, float] = (0.0, 0.0)
    propeller: float = 0.0
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    kd_linear: float = 0.0
    disturbance_force_std: tuple[float, float, float] = (0.0, 0.0, 0.0)
    disturbance_torque_std: tuple[float, float, float] = (0.0, 0.0, 0.0)
    disturbance_bandwidth: float = 3.0

    def __post_init__(self) -> None:
        if self.mass <= 0 or self.kt <= 0 or self.kd < 0:
            raise ExperimentError("a simulated vehicle needs mass > 0, kt > 0 and kd >= 0")
        if np.linalg.eigvalsh(self.com_inertia)[0] <= 0:
            raise ExperimentError(
                "inertia about the centre of mass is not positive definite: check the signs and "
                "that the inertia is given about the body origin"
            )
        if self.propeller <= 0 and (self.inflow or any(self.wake_moment)):
            raise ExperimentError("inflow and wake moments need the diameter of the propellers")
        if self.motor_lag < 0 or self.motor_delay < 0:
            raise ExperimentError("motor lag and delay cannot be negative")
        if self.Jr != 0 and self.motor_lag == 0:
            raise ExperimentError("rotors with inertia cannot jump in speed: give a motor lag > 0")
        if self.motor_lag_down is not None and min(self.motor_lag, self.motor_lag_down) <= 0:
            raise ExperimentError("with a lag of falling speed, both motor lags must be > 0")

    @property
    def falling_lag(self) -> float:
        """Time constant of falling rotor speed [s]."""
        return self.motor_lag if self.motor_lag_down is None else self.motor_lag_down

    @property
    def inertia_tensor(self) -> Float[np.ndarray, "3 3"]:
        """Inertia about the body origin [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def center_of_mass(self) -> Float[np.ndarray, " 3"]:
        """Position of the centre of mass from the body origin [m]."""
        return np.array(self.first_moments) / self.mass

    @property
    def com_inertia(self) -> Float[np.ndarray, "3 3"]:
        """Inertia about the centre of mass [kg m^2]."""
        return self.inertia_tensor - self.mass * steiner(self.center_of_mass)

    def rotor_kt(self, rotors: int) -> Float[np.ndarray, " N"]:
        """Thrust coefficient of each rotor [N s^2/rad^2]."""
        spread = self.kt_spread or (1.0,) * rotors
        if len(spread) != rotors:
            raise ExperimentError(f"kt_spread has {len(spread)} factors for {rotors} rotors")
        return self.kt * np.array(spread, dtype=float)

    def parameters(self) -> dict[str, float]:
        """Collect the parameters by their names in results, with the inertia about the CoM too."""
        names = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
        values = {"kt": self.kt, "kd": self.kd, "Jr": self.Jr, "mass": self.mass}
        values |= zip(("msx", "msy", "msz"), self.first_moments, strict=True)
        values |= zip(names, self.inertia, strict=True)
        values |= {"motor_lag": self.motor_lag, "motor_delay": self.motor_delay}
        values |= {"rotor_drag": self.rotor_drag}
        if self.kd_linear:
            values["kd_linear"] = self.kd_linear
        if self.inflow:
            values["inflow"] = self.inflow
        if any(self.wake_moment):
            values |= zip(("wake_moment_x", "wake_moment_y"), self.wake_moment, strict=True)
        at_com = tensor_elements(self.com_inertia)
        return values | {f"{name}_com": value for name, value in zip(names, at_com, strict=True)}


def with_payload(truth: Truth, *, mass: float, position: tuple[float, float, float]) -> Truth:
    """Attach a point mass [kg] at a position from the body origin [m] to the vehicle."""
    r = np.array(position)
    x, y, z = (np.array(truth.first_moments) + mass * r).tolist()
    return replace(
        truth,
        mass=truth.mass + mass,
        first_moments=(x, y, z),
        inertia=tensor_elements(truth.inertia_tensor + mass * steiner(r)),
    )


def steiner(position: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Compute the inertia about the origin of a unit point mass at a position [m^2]."""
    r = position
    return r @ r * np.eye(3) - np.outer(r, r)


def tensor_elements(
    tensor: Float[np.ndarray, "3 3"],
) -> tuple[float, float, float, float, float, float]:
    """Return Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a symmetric tensor."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor.tolist()
    return xx, yy, zz, xy, xz, yz
