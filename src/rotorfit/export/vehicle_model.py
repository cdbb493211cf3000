"""The vehicle that every target writes: checked once, SI units, body axes FLU.

A number that the flights do not give is refused, or taken from the user and marked so; inertia that
no body has is refused. What no target asked for and is not known is NaN, which `units.text` never
writes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.export.assumptions import unit_of
from rotorfit.export.motor_law import full_speed_of
from rotorfit.export.numbers import (
    COM,
    FULL_COMMAND,
    INERTIA_COM,
    ROTOR_KT,
    Missing,
    Number,
    numbers_of,
)
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.speed_law import SpeedLaw
from rotorfit.identification.experiment import Experiment, experiment_of_settings, vehicle_of
from rotorfit.identification.law_entry import speed_law_of
from rotorfit.identification.result import IdentificationResult
from rotorfit.model.parameters import inertia_about, inertia_matrix
from rotorfit.model.vehicle import Vehicle

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

    @property
    def kt(self) -> float:
        """Mean of the rotors' thrust coefficients [N s^2/rad^2]."""
        return float(np.mean([rotor.kt for rotor in self.rotors]))

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


def vehicle_model(
    result: IdentificationResult,
    *,
    configuration: str | None = None,
    needs: Sequence[str] = (*BODY, *ROTORS),
    assumed: Mapping[str, float] | None = None,
    speed: Speed = "rad/s",
    project: bool = False,
) -> VehicleModel:
    """Return the vehicle of a result, checked.

    Parameters
    ----------
    result
        With the settings of its experiment, from which the rotors are.
    configuration
        Which of its configurations; may be left out where there is one.
    needs
        Numbers without which the target cannot be written.
    assumed
        From `parse_assumptions`; they replace what the result has.
    speed
        What the target wants of rotor speed: rad/s, or ``full-command`` where only what a rotor
        does at full command matters.
    project
        Replace inertia that no body has by the nearest that one can have.

    Raises
    ------
    OutputError
        If a needed number is not known and not assumed, the inertia is not physical, or the result
        does not describe a vehicle.
    """
    owner = owner_of(result, configuration)
    experiment = _experiment(result)
    law = None if experiment.motors.law is None else speed_law_of(experiment.motors.law)
    given = dict(assumed or {})
    _refuse_other_mass(result, owner, given)
    full = _full_speed(experiment, law, speed)
    numbers = numbers_of(result, owner, assumed=given, full_speed=full)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    _refuse_missing(numbers, _needed(needs, numbers, vehicle))
    model = _assembled(result, owner, numbers=numbers, vehicle=vehicle, law=law)
    return _physical(model, project=project)


def _full_speed(experiment: Experiment, law: SpeedLaw | None, speed: Speed) -> Number | None:
    """Return the speed at full command, as far as the motors' law gives it."""
    if law is not None:
        value, unit, remark = full_speed_of(law), "rad/s", "the law of [motors] at full command"
    elif speed == "full-command" and experiment.motors.speed == "commanded":
        value, unit = 1.0, FULL_COMMAND
        remark = "taken in proportion to the command, no law being known"
    else:
        return None
    return Number(name="max_speed", value=value, unit=unit, origin="law", remark=remark)


def owner_of(result: IdentificationResult, configuration: str | None) -> str:
    """Return the configuration that is meant.

    Raises
    ------
    OutputError
        If it is not in the result, or not said where there are several.
    """
    names = list(dict.fromkeys(p.configuration for p in result.parameters if p.configuration))
    if configuration is None and len(names) == 1:
        return names[0]
    if configuration in names:
        return str(configuration)
    raise OutputError(
        f"the result has the configurations {', '.join(names)}; say which to export "
        "(--configuration NAME)"
    )


def _experiment(result: IdentificationResult) -> Experiment:
    try:
        return experiment_of_settings(result.settings)
    except ExperimentError as error:
        raise OutputError(
            f"the result's settings do not describe its vehicle ({error}); identify again"
        ) from error


def _refuse_other_mass(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float]
) -> None:
    """Raise if another mass is assumed than the one that everything was scaled with."""
    mass = result.parameter("mass", owner)
    if "mass" in assumed and mass.value is not None:
        raise OutputError(
            f"mass={assumed['mass']:g} was assumed, but the result was made with {mass.value:g} kg "
            "and every force and inertia with it; identify again with the right mass"
        )


def _needed(
    needs: Sequence[str], numbers: Mapping[str, Number | Missing], vehicle: Vehicle
) -> list[str]:
    """Return the needs of a target, with those that the geometry of this result adds."""
    needed = list(dict.fromkeys(needs))
    if vehicle.imu_position is None and set(COM) & set(needed):
        needed += [name for name in ("rotor_center_x", "rotor_center_y") if name in numbers]
    if "motor_lag" in needed and {"motor_lag_up", "motor_lag_down"} <= numbers.keys():
        needed.remove("motor_lag")
    return needed


def _refuse_missing(numbers: Mapping[str, Number | Missing], needed: Sequence[str]) -> None:
    """Raise if something needed is not known: what, why, and what would allow the export."""
    missing = [name for name in needed if not isinstance(numbers.get(name), Number)]
    if not missing:
        return
    told: list[str] = []
    for name in missing:
        gap = numbers.get(name)
        if isinstance(gap, Missing):
            told.append(f"{name} is {gap.verdict} ({gap.reason})")
        else:
            told.append(f"{name} is not in the result{_WHY_ABSENT.get(name, '')}")
    flags = " ".join(f"--assume {name}=VALUE" for name in missing)
    units = ", ".join(f"{name} in {unit_of(name)}" for name in missing)
    raise OutputError(
        f"{'; '.join(told)}: not exported as if it were known; fly what the report advises, or "
        f"stand for it yourself: {flags} ({units})"
    )


_WHY_ABSENT: Final = {
    "motor_lag": " (measured rotor speed already has it in itself)",
    "max_speed": " (no law from command to rotor speed is given)",
}


def _assembled(
    result: IdentificationResult,
    owner: str,
    *,
    numbers: Mapping[str, Number | Missing],
    vehicle: Vehicle,
    law: SpeedLaw | None,
) -> VehicleModel:
    def value(name: str, otherwise: float = float("nan")) -> float:
        number = numbers.get(name)
        return number.value if isinstance(number, Number) else otherwise

    lag, notes = value("motor_lag"), _notes(numbers, vehicle, law)
    com = np.array([value(name) for name in COM])
    Jr = numbers.get("Jr")
    return VehicleModel(
        name=result.name,
        configuration=owner,
        mass=value("mass"),
        com=com,
        inertia_com=inertia_matrix(np.array([value(name) for name in INERTIA_COM])),
        rotors=_rotors(vehicle, numbers),
        kd=value("kd"),
        Jr=Jr.value if isinstance(Jr, Number) and Jr.origin != "removed" else None,
        lag_up=value("motor_lag_up", lag),
        lag_down=value("motor_lag_down", lag),
        max_speed=value("max_speed"),
        in_commands=isinstance(full := numbers.get("max_speed"), Number)
        and full.unit == FULL_COMMAND,
        law=law,
        imu=np.array(vehicle.imu_position or (0.0, 0.0, 0.0)),
        numbers=tuple(n for name in _SHOWN if isinstance(n := numbers.get(name), Number)),
        notes=notes,
    )


_SHOWN: Final = (
    *("mass", *COM, *INERTIA_COM, "kt", *ROTOR_KT, "kd", "Jr", "motor_lag"),
    *("motor_lag_up", "motor_lag_down", "motor_delay", "max_speed"),
    *("rotor_center_x", "rotor_center_y"),
)


def _rotors(vehicle: Vehicle, numbers: Mapping[str, Number | Missing]) -> tuple[ExportedRotor, ...]:
    """Return the rotors; where the origin is the IMU, moved together to the centre found.

    A rotor declared at p sits at p + rotor_center from the IMU (`model.regressor.rotor_center`:
    torque (p + t) x thrust). Along z the place has no effect on upright thrust, and is taken as
    declared.
    """
    kt = numbers.get("kt")
    mean = kt.value if isinstance(kt, Number) else float("nan")
    shift = np.zeros(3)
    if vehicle.imu_position is None:
        for i, name in enumerate(("rotor_center_x", "rotor_center_y")):
            center = numbers.get(name)
            shift[i] = center.value if isinstance(center, Number) else 0.0
    out: list[ExportedRotor] = []
    for i, rotor in enumerate(vehicle.rotors):
        own = numbers.get(f"kt_{i + 1}")
        out.append(
            ExportedRotor(
                position=np.array(rotor.position) + shift,
                axis=np.array(rotor.axis),
                spin=1.0 if rotor.spin == "ccw" else -1.0,
                kt=own.value if isinstance(own, Number) else mean,
            )
        )
    return tuple(out)


def _notes(
    numbers: Mapping[str, Number | Missing], vehicle: Vehicle, law: SpeedLaw | None
) -> tuple[str, ...]:
    """Return what a reader of the file has to know beyond the numbers."""
    notes: list[str] = []
    if vehicle.imu_position is None:
        notes.append(
            "the origin is the IMU (or the tracked point): its place among the rotors was not "
            "given; the height of the rotors over it is as declared"
        )
    mean = [
        str(i + 1)
        for i in range(len(vehicle.rotors))
        if isinstance(numbers.get(f"kt_{i + 1}"), Missing)
    ]
    if mean:
        notes.append(f"rotors with the mean kt, their own is not known: {', '.join(mean)}")
    if isinstance(numbers.get("Jr"), Missing):
        notes.append("Jr is not known from these flights: left out")
    if law is not None and law.voltage is not None:
        notes.append(f"max_speed holds at {law.voltage.nominal:g} V")
    return tuple(notes)


def second_moments(inertia_com: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    r"""Return the integral of r r^T over the mass: tr(I)/2 - I.

    A body with that inertia exists if and only if it has no negative eigenvalue, which holds the
    triangle inequality of the principal moments (Wensing, Kim and Slotine, RA-L 3(1), 2018).
    """
    return 0.5 * float(np.trace(inertia_com)) * np.eye(3) - inertia_com


def _physical(model: VehicleModel, *, project: bool) -> VehicleModel:
    """Return the model if a body can have it, else refuse it or put the nearest in its place."""
    _refuse_signs(model)
    if not np.isfinite(model.inertia_com).all():
        return model
    size = float(np.abs(model.inertia_com).max())
    smallest = float(np.linalg.eigvalsh(second_moments(model.inertia_com))[0])
    if smallest >= -1e-9 * size:
        return model
    if project:
        return _projected(model)
    moments = np.linalg.eigvalsh(model.inertia_com)
    raise OutputError(
        "no body has this inertia about its CoM: the principal moments "
        f"{', '.join(f'{m:.4g}' for m in moments)} kg m^2 break the triangle inequality (each is "
        "at most the sum of the others); fly what the report advises, pass --assume Izz_com=VALUE, "
        "or --project to export the nearest inertia that a body can have"
    )


def _refuse_signs(model: VehicleModel) -> None:
    """Raise if a coefficient that is above zero in nature is not."""
    named = [
        ("mass", model.mass),
        ("kt", model.kt),
        ("kd", model.kd),
        ("max_speed", model.max_speed),
    ]
    named += [(f"kt_{i + 1}", rotor.kt) for i, rotor in enumerate(model.rotors)]
    named += [("Jr", 1.0 if model.Jr is None else model.Jr)]
    for name, value in named:
        if value <= 0.0:
            raise OutputError(
                f"{name} is {value:.3g} {unit_of(name)}, and nature has it above 0; check spins "
                f"and axes, fly what the report advises, or pass --assume {name}=VALUE"
            )


def _projected(model: VehicleModel) -> VehicleModel:
    """Return the model with the nearest inertia that a body can have, the distance said."""
    raise OutputError("--project is not available in this version; pass --assume Izz_com=VALUE")


def inertia_at_origin(model: VehicleModel) -> Float[np.ndarray, "3 3"]:
    """Return the inertia at the origin (parallel axes), FLU [kg m^2]."""
    elements = np.array([model.inertia_com[i, j] for i, j in _PLACES])
    return inertia_matrix(inertia_about(elements, model.mass, model.com))


_PLACES: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def refuse_no_lag(model: VehicleModel, target: str) -> None:
    """Raise if the motors have no lag in a target that divides by it."""
    if model.lag_up <= 0.0 or model.lag_down <= 0.0:
        raise OutputError(
            f"the motors' lag is 0, and {target} divides by it; pass --assume motor_lag=VALUE (s)"
        )


def with_note(model: VehicleModel, note: str) -> VehicleModel:
    """Return the model with one more remark for the reader of the file."""
    return replace(model, notes=(*model.notes, note))
