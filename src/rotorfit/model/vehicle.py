"""The vehicle: where its rotors are, how they spin, and where its IMU sits."""

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from jaxtyping import Float

from rotorfit.errors import ExperimentError

Spin = Literal["ccw", "cw"]
UNIT: Final = 1e-3
"""By which the length of an axis may differ from 1: it was rounded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotor:
    """One rotor of a vehicle.

    Attributes
    ----------
    position
        From the body origin, body axes FLU [m].
    spin
        Sense of rotation seen from above (from the tip of its axis).
    axis
        Unit vector of the thrust, body axes FLU.
    group
        Rotors of equal group share one thrust coefficient where those are estimated apart.

    Raises
    ------
    ExperimentError
        If it is no rotor.
    """

    position: tuple[float, float, float]
    spin: Spin
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    group: str | None = None

    def __post_init__(self) -> None:
        for name, vector in (("position", self.position), ("axis", self.axis)):
            if np.shape(vector) != (3,) or not np.isfinite(vector).all():
                raise ExperimentError(
                    f"a rotor's {name} is {vector!r}, expected three numbers (x, y, z)"
                )
        if self.spin not in get_args(Spin):
            raise ExperimentError(
                f'a rotor\'s spin is {self.spin!r}, expected "ccw" or "cw", seen from above'
            )
        if abs(float(np.linalg.norm(self.axis)) - 1.0) > UNIT:
            raise ExperimentError(
                f"a rotor's axis is {self.axis!r}, expected a unit vector: divide it by its length"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """The geometry that is known before the flight, body axes FLU.

    Attributes
    ----------
    rotors
        In the order of the log's motors.
    imu_position
        Of the accelerometer from the body origin [m]; None where unknown, and then the
        accelerometer is the origin.
    imu_position_std
        Standard deviation of each of its components [m].
    arm_std
        Standard deviation of the length of the arms, all measured with one tape [m].
    """

    rotors: tuple[Rotor, ...]
    imu_position: tuple[float, float, float] | None = None
    imu_position_std: float = 0.0
    arm_std: float = 0.0

    @property
    def positions(self) -> Float[np.ndarray, "N 3"]:
        """Rotor positions from the body origin [m]."""
        return np.array([rotor.position for rotor in self.rotors], dtype=float)

    @property
    def axes(self) -> Float[np.ndarray, "N 3"]:
        """Unit thrust directions."""
        return np.array([rotor.axis for rotor in self.rotors], dtype=float)

    @property
    def spins(self) -> Float[np.ndarray, " N"]:
        """+1 for a rotor that turns counter-clockwise seen from above, -1 for clockwise."""
        return np.array([1.0 if rotor.spin == "ccw" else -1.0 for rotor in self.rotors])

    @property
    def squared_arms(self) -> Float[np.ndarray, " N"]:
        """Squared distance of each rotor from the body's z axis [m^2]."""
        return (self.positions[:, :2] ** 2).sum(axis=1)

    @property
    def arm(self) -> float:
        """Mean distance of the rotors from the thrust line through their centre [m]."""
        offsets = self.positions[:, :2] - self.positions[:, :2].mean(axis=0)
        return float(np.hypot(offsets[:, 0], offsets[:, 1]).mean())
