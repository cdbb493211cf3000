"""The vehicle that every target writes: SI units, body axes FLU."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.export.result_numbers import Number
from rotorfit.logs.speed_law import SpeedLaw
from rotorfit.model.parameters import (
    COM,
    INERTIA_COM,
    INERTIA_PLACES,
    inertia_about,
    inertia_matrix,
)
from rotorfit.preprocessing.airborne import GRAVITY

BODY: Final = ("mass", *COM, *INERTIA_COM)
ROTORS: Final = ("kt", "kd", "Izz_com")
"""The scale of kd hangs on that of Izz, its partner in the yaw equation: both or neither."""
Speed = Literal["rad/s", "full-command"]
LAG: Final = ("motor_lag",)
SPEED: Final = ("max_speed",)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedRotor:
    """One rotor, in the order of the log's motors.

    Attributes
    ----------
    position
        From the origin, FLU [m].
    axis
        Unit vector of the thrust, FLU.
    spin
        +1 for counter-clockwise seen from above, -1 for clockwise.
    kt
        Thrust over speed squared, its own where it is known [N s^2/rad^2].
    """

    position: Float[np.ndarray, " 3"]
    axis: Float[np.ndarray, " 3"]
    spin: float
    kt: float


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleModel:
    """One configuration, ready to be written.

    Attributes
    ----------
    name, configuration
        Of the result.
    mass
        [kg]
    com
        From the origin, FLU [m].
    inertia_com
        About the CoM, FLU [kg m^2].
    rotors
        With positions from the same origin.
    kd
        Drag torque over speed squared [N m s^2/rad^2].
    Jr
        Spin inertia of a rotor [kg m^2]; None where it is not known.
    lag_up, lag_down
        Time constants of the motors [s]; NaN where not asked for and not known.
    max_speed
        Of a rotor [rad/s]; NaN where not asked for and not known. 1 with `in_commands`.
    in_commands
        Whether kt, kd and Jr are per (squared) command, so that kt is the thrust at full command.
    law
        From command to speed; None where there is none.
    imu
        Of the accelerometer from the origin, FLU [m].
    numbers
        All of the above as they are known, for the head of the file.
    notes
        What a reader of the file has to know beyond them.
    air
        What the air does besides thrust and drag torque, by the names of the parameters, where the
        flights tell it.
    """

    name: str
    configuration: str
    mass: float
    com: Float[np.ndarray, " 3"]
    inertia_com: Float[np.ndarray, "3 3"]
    rotors: tuple[ExportedRotor, ...]
    kd: float
    Jr: float | None
    lag_up: float
    lag_down: float
    max_speed: float
    in_commands: bool
    law: SpeedLaw | None
    imu: Float[np.ndarray, " 3"]
    numbers: tuple[Number, ...]
    notes: tuple[str, ...]
    air: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def kt(self) -> float:
        """Mean of the rotors' thrust coefficients [N s^2/rad^2]."""
        return float(np.mean([rotor.kt for rotor in self.rotors]))

    @property
    def mean_lag(self) -> float:
        """Of rising and falling speed [s]; NaN where it is not known."""
        return 0.5 * (self.lag_up + self.lag_down)

    @property
    def arms(self) -> Float[np.ndarray, "N 3"]:
        """Rotor positions from the CoM, FLU [m]."""
        return np.array([rotor.position - self.com for rotor in self.rotors])

    @property
    def vertical(self) -> bool:
        """Whether all thrust is along z."""
        return all(float(rotor.axis[2]) == 1.0 for rotor in self.rotors)

    @property
    def hover_speed(self) -> float:
        """Rotor speed, equal for all, whose thrust along z is the weight [rad/s]."""
        lift = sum(rotor.kt * float(rotor.axis[2]) for rotor in self.rotors)
        return float(np.sqrt(self.mass * GRAVITY / lift))


def inertia_at_origin(model: VehicleModel) -> Float[np.ndarray, "3 3"]:
    """Return the inertia at the origin (parallel axes), FLU [kg m^2]."""
    elements = np.array([model.inertia_com[i, j] for i, j in INERTIA_PLACES])
    return inertia_matrix(inertia_about(elements, model.mass, model.com))


def refuse_no_upright_quad(model: VehicleModel, target: str) -> None:
    """Raise if a target that flies four upright rotors is given others."""
    if len(model.rotors) != 4 or not model.vertical:
        raise OutputError(
            f"{target} flies four rotors with upright thrust; these are others: export to mujoco "
            "or gazebo instead"
        )


def refuse_no_lag(model: VehicleModel, target: str) -> None:
    """Raise if the motors have no lag in a target that divides by it."""
    if model.lag_up <= 0.0 or model.lag_down <= 0.0:
        raise OutputError(
            f"the motors' lag is 0, and {target} divides by it; pass --assume motor_lag=VALUE (s)"
        )
