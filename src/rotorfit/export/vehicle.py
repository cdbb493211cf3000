"""The vehicle that every target writes (SI, body axes FLU), and whether nature has such a one.

Its effectiveness is what each rotor does to the body, per squared speed and per acceleration. With
thrust kt w^2 along n at r from the CoM, drag torque -s kd w^2 n and the counter-torque
-s Jr dw/dt n of a rotor that is spun up (s = +1: ccw), specific force is F / m, and angular
acceleration I^-1 tau. These are G1 and G2 of incremental nonlinear dynamic inversion (Smeur, Chu
and de Croon, J. of Guidance, Control, and Dynamics 39(3), 2016), before a firmware's own units.
"""

from __future__ import annotations

from dataclasses import field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.impossible_inertia import second_moments
from rotorfit.errors import EstimationError, OutputError
from rotorfit.export.file_format import frd
from rotorfit.export.result_numbers import Number, unit_of
from rotorfit.export.targets import BODY
from rotorfit.flight.airborne import GRAVITY
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import (
    COM,
    FIRST_MOMENTS,
    INERTIA,
    INERTIA_COM,
    INERTIA_PLACES,
    inertia_about,
    inertia_matrix,
)
from rotorfit.results.physical_inertia import project_to_physical

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.logs.motor_law import MotorLaw
    from rotorfit.results.result import IdentificationResult

NOT_MEASURED: Final = ("assumed", "from-ratio", "removed")


@frozen_dataclass
class ExportedRotor:
    """One rotor, in the order of the log's motors.

    - `position`: from the origin, FLU [m].
    - `axis`: unit vector of the thrust, FLU.
    - `spin`: +1 for counter-clockwise seen from above, -1 for clockwise.
    - `kt`: thrust over speed squared, its own where it is known [N s^2/rad^2].
    """

    position: Float[np.ndarray, " 3"]
    axis: Float[np.ndarray, " 3"]
    spin: float
    kt: float


@frozen_dataclass
class VehicleModel:
    """One configuration, ready to be written; positions from the origin, FLU [m].

    - `inertia_com`: about the CoM, FLU [kg m^2].
    - `kd`: drag torque over speed squared [N m s^2/rad^2].
    - `Jr`: spin inertia of a rotor [kg m^2]; None if it is not known.
    - `lag_up`, `lag_down`: time constants of the motors [s]; NaN if not asked for and not known.
    - `max_speed`: of a rotor [rad/s]; NaN if not asked for and not known. 1 with `in_commands`.
    - `in_commands`: whether kt, kd and Jr are per (squared) command: kt is thrust at full command.
    - `law`: from command to speed; None if there is none.
    - `imu`: of the accelerometer.
    - `numbers`: all of the above as they are known, for the head of the file.
    - `notes`: what a reader of the file has to know beyond them.
    - `air`: coefficients of the air besides thrust and drag torque, by the names of the parameters,
      where the flights show them.
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
    law: MotorLaw | None
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
        """Of rising and falling speed [s]; NaN if it is not known."""
        return 0.5 * (self.lag_up + self.lag_down)

    @property
    def arms(self) -> Float[np.ndarray, "N 3"]:
        """Rotor positions from the CoM, FLU [m]."""
        return np.array([rotor.position - self.com for rotor in self.rotors])

    @property
    def mean_arm(self) -> float:
        """Mean distance of the rotors from the CoM, seen from above [m]."""
        return float(np.hypot(self.arms[:, 0], self.arms[:, 1]).mean())

    @property
    def arms_from_middle(self) -> Float[np.ndarray, "N 3"]:
        """Rotor positions from their mean, FLU [m]."""
        places = np.array([rotor.position for rotor in self.rotors])
        return places - places.mean(axis=0)

    @property
    def vertical(self) -> bool:
        """Whether all thrust is along z."""
        return all(float(rotor.axis[2]) == 1.0 for rotor in self.rotors)

    @property
    def lift(self) -> float:
        """Thrust of all rotors along z over speed squared [N s^2/rad^2]."""
        return sum(rotor.kt * float(rotor.axis[2]) for rotor in self.rotors)

    @property
    def hover_speed(self) -> float:
        """Rotor speed, equal for all, whose thrust along z is the weight [rad/s]."""
        return float(np.sqrt(self.mass * GRAVITY / self.lift))

    @property
    def hover_thrust(self) -> float:
        """Thrust in hover as a fraction of full; NaN if full speed is not known."""
        return self.mass * GRAVITY / (self.lift * self.max_speed**2)


def inertia_at_origin(model: VehicleModel) -> Float[np.ndarray, "3 3"]:
    """Compute the inertia at the origin (parallel axes), FLU [kg m^2]."""
    elements = np.array([model.inertia_com[i, j] for i, j in INERTIA_PLACES])
    return inertia_matrix(inertia_about(elements, model.mass, model.com))


def required_law(model: VehicleModel, target: str) -> MotorLaw:
    """Find the law of the motors; OutputError where there is none."""
    if model.law is None:
        raise OutputError(
            f"no law from command to rotor speed is known, and {target} is written from it: "
            "identify a log with commands and measured rotor speeds, or give law under [motors]"
        )
    return model.law


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


THINNEST: Final = 1e-7
"""Smallest second moment over the largest element of the inertia, as `--project` leaves [1].

MuJoCo demands that no principal moment exceeds the sum of the others, without any tolerance, of the
12 digits that a file has; a flat body is on that border.
"""


def thickened(model: VehicleModel) -> VehicleModel:
    """Return a possible vehicle whose inertia stays possible when it is rounded for a file."""
    inertia = model.inertia_com
    if not np.isfinite(inertia).all() or not is_possible(model):
        return model
    moments, axes = np.linalg.eigh(second_moments(inertia))
    least = THINNEST * float(np.abs(inertia).max())
    if moments[0] >= least:
        return model
    second = (axes * np.maximum(moments, least)) @ axes.T
    return replace(model, inertia_com=np.trace(second) * np.eye(3) - second)


def is_possible(model: VehicleModel) -> bool:
    """Test whether a body can have the inertia; NaN passes, as it is never written."""
    if not np.isfinite(np.diag(model.inertia_com)).all():
        return True
    inertia = np.nan_to_num(model.inertia_com)  # of a target that takes no products
    size = float(np.abs(inertia).max())
    return float(np.linalg.eigvalsh(second_moments(inertia))[0]) >= -1e-9 * size


def impossible_message(model: VehicleModel) -> str:
    """Explain why an inertia is refused, and what to do."""
    principal = np.linalg.eigvalsh(np.nan_to_num(model.inertia_com))
    moments = ", ".join(f"{m:.4g}" for m in principal)
    return (
        f"no body has this inertia about its CoM: the principal moments {moments} kg m^2 break the "
        "triangle inequality (each is at most the sum of the others); fly what the report advises, "
        "pass --assume Izz_com=VALUE, or --project to export the nearest inertia that a body can "
        "have"
    )


def refuse_signs(model: VehicleModel) -> None:
    """Raise if a coefficient that is above zero in nature is not."""
    for name, value in (("motor_lag_up", model.lag_up), ("motor_lag_down", model.lag_down)):
        if value < 0.0:
            raise OutputError(
                f"{name} is {value:.3g} s, and no motor responds before its command; pass --assume "
                "motor_lag=VALUE"
            )
    for name, value in (
        ("mass", model.mass),
        ("kt", model.kt),
        ("kd", model.kd),
        ("max_speed", model.max_speed),
        *((f"kt_{i}", rotor.kt) for i, rotor in enumerate(model.rotors, 1)),
        ("Jr", 1.0 if model.Jr is None else model.Jr),
    ):
        if value <= 0.0:
            raise OutputError(
                f"{name} is {value:.3g} {unit_of(name)}, which cannot be below 0; check spins "
                f"and axes, fly what the report advises, or pass --assume {name}=VALUE"
            )


def projected(model: VehicleModel, result: IdentificationResult) -> VehicleModel:
    """Replace CoM and inertia by those of the nearest body that can exist; note its distance."""
    assumed = [n.name for n in model.numbers if n.name in BODY and n.origin in NOT_MEASURED]
    if assumed:
        raise OutputError(
            f"--project moves what the flights measured by their covariance, but {assumed[0]} is "
            "not from them; change the assumed values until the triangle inequality holds"
        )
    try:
        nearest = project_to_physical(result, model.configuration)
    except EstimationError as error:
        raise OutputError(f"no nearest inertia was found: {error}") from error
    com = np.array([nearest.values[name] for name in FIRST_MOMENTS]) / model.mass
    origin = np.array([nearest.values[name] for name in INERTIA])
    about = dict(zip(INERTIA_COM, inertia_about(origin, -model.mass, com).tolist(), strict=True))
    moved = dict(zip(COM, com.tolist(), strict=True)) | about
    return replace(
        model,
        com=com,
        inertia_com=inertia_matrix(np.array(list(about.values()))),
        numbers=tuple(_move_number(n, moved) for n in model.numbers),
        notes=(
            *model.notes,
            "inertia and CoM PROJECTED to the nearest that a body can have, "
            f"{nearest.distance:.2g} standard deviations from the estimate",
        ),
    )


def _move_number(number: Number, moved: Mapping[str, float]) -> Number:
    """Put a number where the projection has it."""
    if number.name not in moved:
        return number
    remark = f"projected from {number.value:.6g}"
    return replace(number, value=moved[number.name], interval=None, origin="weak", remark=remark)


LEVELS: Final = (2.5, 97.5)
"""Percentiles of drawn vehicles: the ends of a 95 % interval."""


@frozen_dataclass
class Effectiveness:
    """Body axes FRD, one column a rotor.

    - `force`: specific force over squared speed [m/s^2 per (rad/s)^2].
    - `turn`: angular acceleration over squared speed [rad/s^2 per (rad/s)^2].
    - `spin_up`: angular acceleration over that of the rotor [1]; None if Jr is not known.
    """

    force: Float[np.ndarray, "3 N"]
    turn: Float[np.ndarray, "3 N"]
    spin_up: Float[np.ndarray, "3 N"] | None


def effectiveness(model: VehicleModel) -> Effectiveness:
    """Compute the effect of the rotors on their vehicle."""
    kt = np.array([rotor.kt for rotor in model.rotors])[:, None]
    axes = np.array([rotor.axis for rotor in model.rotors])
    along = np.array([rotor.spin for rotor in model.rotors])[:, None] * axes
    inverse = np.linalg.inv(model.inertia_com)
    torques = kt * np.cross(model.arms, axes) - model.kd * along
    return Effectiveness(
        force=frd(kt * axes / model.mass).T,
        turn=frd(torques @ inverse).T,
        spin_up=None if model.Jr is None else frd(-model.Jr * along @ inverse).T,
    )


@frozen_dataclass
class Spread:
    """Numbers of the estimated vehicle, with the ends of 95 % intervals from drawn ones."""

    value: Float[np.ndarray, "r c"]
    low: Float[np.ndarray, "r c"] | None = None
    high: Float[np.ndarray, "r c"] | None = None

    def row_text(self, row: int) -> str:
        """Write the numbers of a row one after the other, each with its interval."""
        values = self.value[row].tolist()
        if self.low is None or self.high is None:
            return ", ".join(f"{value:.4g}" for value in values)
        rows = zip(values, self.low[row].tolist(), self.high[row].tolist(), strict=True)
        return ", ".join(f"{value:.4g} ({low:.4g} to {high:.4g})" for value, low, high in rows)


def spread(
    of: Callable[[VehicleModel], Float[np.ndarray, "r c"]],
    model: VehicleModel,
    drawn: Sequence[VehicleModel],
) -> Spread:
    """Evaluate numbers of a vehicle, with intervals from vehicles drawn around it."""
    if not drawn:
        return Spread(value=of(model) + 0.0)
    # + 0.0: no minus before a zero.
    low, high = np.percentile([of(one) for one in drawn], LEVELS, axis=0) + 0.0
    return Spread(value=of(model) + 0.0, low=low, high=high)
