"""Names, units and meaning of every parameter, in the order in which they are reported."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.model.terms import air, body
from rotorfit.model.terms.registry import TERMS
from rotorfit.model.terms.rotors import MOST_ROTORS
from rotorfit.model.terms.term import ParameterInfo

if TYPE_CHECKING:
    from jaxtyping import Float

FIRST_MOMENTS: Final = body.FIRST_MOMENTS.names
INERTIA: Final = body.INERTIA.names
COM: Final = ("com_x", "com_y", "com_z")
INERTIA_COM: Final = tuple(f"{name}_com" for name in INERTIA)
AIR_TERMS: Final = (air.DRAG, air.TURN_DAMPING, air.INFLOW, air.TRANSLATIONAL_LIFT)
AIR: Final = tuple(name for term in AIR_TERMS for name in term.names)
"""What the air does besides thrust and drag torque, where the flights ask for it."""
INERTIA_PLACES: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
MOTOR_TIMES: Final = ("motor_lag", "motor_lag_up", "motor_lag_down", "motor_delay")


def _of_motors(unit: str, meaning: str, title: str, effective: str | None = None) -> ParameterInfo:
    power = 0 if effective is None else 1
    return ParameterInfo(unit, 0, meaning, title=title, effective_unit=effective, speed_power=power)


MOTORS: Final[dict[str, ParameterInfo]] = {
    "motor_lag": _of_motors(
        "s", "first-order time constant of the motors", "Motor lag (time constant)"
    ),
    "motor_lag_up": _of_motors(
        "s", "time constant of rising motor speed", "Motor lag, rising speed"
    ),
    "motor_lag_down": _of_motors(
        "s", "time constant of falling motor speed", "Motor lag, falling speed"
    ),
    "motor_delay": _of_motors("s", "time by which motor data lead their effect", "Motor delay"),
    "command_delay": _of_motors(
        "s",
        "time by which commands lead the measured speeds",
        "Delay from command to measured speed",
    ),
    "max_speed": _of_motors(
        "rad/s", "rotor speed at full command", "Rotor speed at full command", "command"
    ),
}
"""Times of the motors, and the law from command to speed; no term of the equations of motion."""


def names_of(*owners: str) -> tuple[str, ...]:
    """Return the reported parameters that belong to all, to a rotor or to a configuration."""
    return tuple(n for t in TERMS if t.owner in owners and t.reported for n in t.parameters)


_ROTORS: Final = ("kt", *(f"kt_{i}" for i in range(1, MOST_ROTORS + 1)), "kd", "Jr")
_OF_TERMS: Final = {n: info for t in TERMS if t.reported for n, info in t.parameters.items()}
PARAMETERS: Final[dict[str, ParameterInfo]] = {
    **{name: _OF_TERMS[name] for name in _ROTORS},
    **_OF_TERMS,
    **MOTORS,
}
"""Everything that stands under ``parameters`` of a result."""
NUISANCE: Final = tuple(name for term in TERMS if term.of_sensor for name in term.parameters)
"""Parameters of the sensors, not of the vehicle: nobody flies for them."""
NO_NUMBERS: Final = {n: info for t in TERMS if not t.reported for n, info in t.parameters.items()}
UNREPORTED: Final = tuple(NO_NUMBERS)
"""Parameters of a fit that are no numbers of a result."""
ROW_ORDER: Final = (
    *(*_ROTORS, *MOTORS),
    *(name for name in _OF_TERMS if name not in (*_ROTORS, *NUISANCE)),
    *NUISANCE,
)
"""The order of a result's parameters, within what they belong to."""


def _about_com(name: str, title: str) -> ParameterInfo:
    origin = PARAMETERS[name]
    return ParameterInfo(
        "kg m^2",
        1,
        "inertia about the CoM",
        title=title,
        motion=origin.motion,
        on_yaw_scale=origin.on_yaw_scale,
        relevant=origin.relevant,
    )


def _com_parameter(axis: str, title: str) -> ParameterInfo:
    return ParameterInfo(
        "m",
        0,
        "centre of mass from the origin",
        title=f"Centre of mass, {title}",
        motion=PARAMETERS[f"ms{axis}"].motion,
        relevant=lambda s: s.arm / 50.0,
    )


def _over_kt(name: str, axis: str) -> ParameterInfo:
    return ParameterInfo(
        "m rad^2",
        0,
        f"{axis} inertia about the CoM over kt",
        title=f"{axis.capitalize()} inertia over thrust coefficient",
        effective_unit="m s^2 times squared command",
        speed_power=2,
        motion=PARAMETERS[name].motion,
        on_yaw_scale=PARAMETERS[name].on_yaw_scale,
    )


DERIVED: Final[dict[str, ParameterInfo]] = {
    "com_x": _com_parameter("x", "forward"),
    "com_y": _com_parameter("y", "to the left"),
    "com_z": _com_parameter("z", "up"),
    "Ixx_com": _about_com("Ixx", "Roll inertia about the CoM"),
    "Iyy_com": _about_com("Iyy", "Pitch inertia about the CoM"),
    "Izz_com": _about_com("Izz", "Yaw inertia about the CoM"),
    **{f"{n}_com": _about_com(n, f"Product of inertia {n[1:]} about the CoM") for n in INERTIA[3:]},
    "kd_over_kt": ParameterInfo(
        "m",
        0,
        "drag torque over thrust",
        title="Drag torque over thrust",
        motion="yaw",
        on_yaw_scale=True,
    ),
    "Ixx_over_kt": _over_kt("Ixx", "roll"),
    "Iyy_over_kt": _over_kt("Iyy", "pitch"),
    "Izz_over_kt": _over_kt("Izz", "yaw"),
    "kd_over_Izz": ParameterInfo(
        "1/rad^2",
        0,
        "yaw acceleration per rotor speed squared",
        title="Yaw acceleration per rotor speed squared",
        effective_unit="1/s^2 per squared command",
        speed_power=2,
        motion="yaw",
    ),
    "Jr_over_Izz": ParameterInfo(
        "1",
        0,
        "yaw acceleration per rotor acceleration",
        title="Yaw acceleration per rotor acceleration",
        effective_unit="1/s per command",
        speed_power=1,
        motion="yaw",
    ),
    "hover_speed": ParameterInfo(
        "rad/s",
        0,
        "rotor speed that carries the weight",
        title="Rotor speed in hover",
        effective_unit="command",
        speed_power=1,
    ),
    "motor_lag_total": ParameterInfo(
        "s", 0, "motor lag plus delay", title="Motor lag and delay together"
    ),
    "max_thrust": ParameterInfo(
        "N", 0, "thrust of the mean rotor at full command", title="Largest thrust of a motor"
    ),
    "motor_imbalance": ParameterInfo(
        "1",
        0,
        "strongest less weakest rotor's thrust coefficient, over the mean",
        title="Imbalance of the motors",
    ),
    "hover_throttle": ParameterInfo(
        "1", 0, "motor command that carries the weight", title="Throttle in hover"
    ),
    "thrust_to_weight": ParameterInfo(
        "1", 0, "thrust at full command over the weight", title="Thrust over weight"
    ),
    "max_thrust_loaded": ParameterInfo(
        "N",
        0,
        "thrust of the mean rotor at full command as the battery sags under it",
        title="Largest thrust of a motor under full load",
    ),
    "thrust_to_weight_loaded": ParameterInfo(
        "1",
        0,
        "thrust at full command as the battery sags under it, over the weight",
        title="Thrust over weight under full load",
    ),
}
"""Everything that stands under ``derived`` of a result."""
OF_FLIGHT: Final = (
    *("max_thrust", "motor_imbalance", "hover_throttle", "thrust_to_weight"),
    *("max_thrust_loaded", "thrust_to_weight_loaded"),
)
"""Derived numbers that follow from the others once the motors' law is known."""

EVERY: Final = PARAMETERS | DERIVED
TITLES: Final[dict[str, str]] = {name: info.title for name, info in EVERY.items()}
"""Names of parameters in words."""
EFFECTIVE_UNITS: Final[dict[str, str]] = {
    name: info.effective_unit for name, info in EVERY.items() if info.effective_unit is not None
}
"""Units where the command, 0 to 1, stands for the rotor speed; those of the others stay."""
PER_MASS: Final = " per kg"
"""Behind the units of a vehicle whose mass is unknown."""
SHARED: Final = (*names_of("shared"), *MOTORS)
"""Parameters of the propulsion: every configuration has the same."""


def effective_unit(name: str, unit: str) -> str:
    """Return the unit of a parameter in commands; ``kt_1`` and so on are as ``kt``."""
    base = "kt" if name.startswith("kt_") else name
    if base not in EFFECTIVE_UNITS:
        return unit
    return EFFECTIVE_UNITS[base] + (PER_MASS if unit.endswith(PER_MASS) else "")


def title_of(name: str) -> str:
    """Return a parameter's name in words."""
    return TITLES.get(name, name)


def inertia_matrix(elements: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 3 3"]:
    """Return the symmetric tensor of (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""
    matrix = np.empty((*elements.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(INERTIA_PLACES):
        matrix[..., i, j] = matrix[..., j, i] = elements[..., k]
    return matrix


def inertia_about(
    elements_com: Float[np.ndarray, "*b 6"], mass: float, com: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*b 6"]:
    """Return the inertia at the origin from that about a CoM at `com` (parallel axes, Steiner)."""
    x, y, z = np.moveaxis(com, -1, 0)
    steiner = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
    return elements_com + mass * np.stack(steiner, axis=-1)


def full_name(name: str, configuration: str) -> str:
    """Return the name of a parameter in covariances, such as ``Ixx@A``."""
    return name if name in SHARED else f"{name}@{configuration}"
