"""Names, units and meaning of every parameter, in the order in which they are reported."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

INERTIA: Final = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
COM: Final = ("com_x", "com_y", "com_z")
INERTIA_COM: Final = tuple(f"{name}_com" for name in INERTIA)
FIRST_MOMENTS: Final = ("msx", "msy", "msz")
MOST_ROTORS: Final = 16
DRAG: Final = ("drag_x", "drag_y", "drag_z")
DRAG_MOMENTS: Final = tuple(f"drag_moment_{a}{b}" for a in "xyz" for b in "xyz" if a != b)
TURN_DAMPING: Final = ("turn_damping_x", "turn_damping_y")
ROTORS_AIR: Final = ("inflow", "translational_lift")
AIR: Final = (*DRAG, *DRAG_MOMENTS, *TURN_DAMPING, *ROTORS_AIR)
"""What the air does besides thrust and drag torque, where the flights ask for it."""
INERTIA_PLACES: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """Unit of a parameter, its power of the mass (for mass = "unknown"), and what it is."""

    unit: str
    mass_power: int
    meaning: str


PARAMETERS: Final[dict[str, ParameterInfo]] = {
    "kt": ParameterInfo("N s^2/rad^2", 1, "thrust coefficient of a rotor"),
    **{
        f"kt_{i}": ParameterInfo("N s^2/rad^2", 1, f"thrust coefficient of rotor {i}")
        for i in range(1, MOST_ROTORS + 1)
    },
    "kd": ParameterInfo("N m s^2/rad^2", 1, "drag torque coefficient of a rotor"),
    "Jr": ParameterInfo("kg m^2", 1, "spin inertia of a rotor with its motor bell"),
    "mass": ParameterInfo("kg", 1, "mass"),
    "msx": ParameterInfo("kg m", 1, "first moment, mass times CoM x"),
    "msy": ParameterInfo("kg m", 1, "first moment, mass times CoM y"),
    "msz": ParameterInfo("kg m", 1, "first moment, mass times CoM z"),
    "Ixx": ParameterInfo("kg m^2", 1, "inertia at the body origin"),
    "Iyy": ParameterInfo("kg m^2", 1, "inertia at the body origin"),
    "Izz": ParameterInfo("kg m^2", 1, "inertia at the body origin"),
    "Ixy": ParameterInfo("kg m^2", 1, "product of inertia at the body origin (tensor element)"),
    "Ixz": ParameterInfo("kg m^2", 1, "product of inertia at the body origin (tensor element)"),
    "Iyz": ParameterInfo("kg m^2", 1, "product of inertia at the body origin (tensor element)"),
    "accel_bias_x": ParameterInfo("m/s^2", 0, "accelerometer bias, mounting tilt included"),
    "accel_bias_y": ParameterInfo("m/s^2", 0, "accelerometer bias, mounting tilt included"),
    "accel_bias_z": ParameterInfo("m/s^2", 0, "accelerometer bias"),
    "rotor_center_x": ParameterInfo("m", 0, "centre of the rotors from the origin"),
    "rotor_center_y": ParameterInfo("m", 0, "centre of the rotors from the origin"),
    "twist": ParameterInfo("m", 0, "yaw torque over thrust: mean tilt about the arms, times arm"),
    "rotor_drag": ParameterInfo("N s^2/(m rad)", 1, "in-plane drag of a rotor over its speeds"),
    "drag_x": ParameterInfo("N s/m", 1, "air drag of the frame over its velocity"),
    "drag_y": ParameterInfo("N s/m", 1, "air drag of the frame over its velocity"),
    "drag_z": ParameterInfo("N s/m", 1, "air drag of the frame over its velocity"),
    **{
        name: ParameterInfo(
            "N s", 1, f"torque of the air about {name[-2]} over velocity {name[-1]}"
        )
        for name in DRAG_MOMENTS
    },
    "turn_damping_x": ParameterInfo("N m s", 1, "torque of the air over the rate about x"),
    "turn_damping_y": ParameterInfo("N m s", 1, "torque of the air over the rate about y"),
    "inflow": ParameterInfo("N s^2/(m rad)", 1, "thrust lost over rotor speed and climb"),
    "translational_lift": ParameterInfo("N s^2/m^2", 1, "thrust over the squared sideways speed"),
    "torque_offset_x": ParameterInfo("N m", 1, "torque that does not change"),
    "torque_offset_y": ParameterInfo("N m", 1, "torque that does not change"),
    "torque_offset_z": ParameterInfo("N m", 1, "torque that does not change"),
    "motor_lag": ParameterInfo("s", 0, "first-order time constant of the motors"),
    "motor_lag_up": ParameterInfo("s", 0, "time constant of rising motor speed"),
    "motor_lag_down": ParameterInfo("s", 0, "time constant of falling motor speed"),
    "motor_delay": ParameterInfo("s", 0, "time by which motor data lead their effect"),
    "command_delay": ParameterInfo("s", 0, "time by which commands lead the measured speeds"),
    "max_speed": ParameterInfo("rad/s", 0, "rotor speed at full command"),
}
"""Everything that stands under ``parameters`` of a result."""

DERIVED: Final[dict[str, ParameterInfo]] = {
    "com_x": ParameterInfo("m", 0, "centre of mass from the origin"),
    "com_y": ParameterInfo("m", 0, "centre of mass from the origin"),
    "com_z": ParameterInfo("m", 0, "centre of mass from the origin"),
    **{name: ParameterInfo("kg m^2", 1, "inertia about the CoM") for name in INERTIA_COM},
    "kd_over_kt": ParameterInfo("m", 0, "drag torque over thrust"),
    "Ixx_over_kt": ParameterInfo("m rad^2", 0, "roll inertia about the CoM over kt"),
    "Iyy_over_kt": ParameterInfo("m rad^2", 0, "pitch inertia about the CoM over kt"),
    "Izz_over_kt": ParameterInfo("m rad^2", 0, "yaw inertia about the CoM over kt"),
    "kd_over_Izz": ParameterInfo("1/rad^2", 0, "yaw acceleration per rotor speed squared"),
    "Jr_over_Izz": ParameterInfo("1", 0, "yaw acceleration per rotor acceleration"),
    "hover_speed": ParameterInfo("rad/s", 0, "rotor speed that carries the weight"),
    "motor_lag_total": ParameterInfo("s", 0, "motor lag plus delay"),
}
"""Everything that stands under ``derived`` of a result."""

EFFECTIVE_UNITS: Final[dict[str, str]] = {
    "kt": "N per squared command",
    "kd": "N m per squared command",
    "Jr": "N m s per command",
    "rotor_drag": "N s/m per command",
    "inflow": "N s/m per command",
    "Ixx_over_kt": "m s^2 times squared command",
    "Iyy_over_kt": "m s^2 times squared command",
    "Izz_over_kt": "m s^2 times squared command",
    "kd_over_Izz": "1/s^2 per squared command",
    "Jr_over_Izz": "1/s per command",
    "hover_speed": "command",
    "max_speed": "command",
}
"""Units where the command, 0 to 1, stands for the rotor speed; those of the others stay."""

ACCEL_BIAS_STD: Final = 0.2
"""What is known of a calibrated accelerometer before the flight [m/s^2]: 20 mg."""
MOUNTING_STD: Final = 0.5
"""The same sideways, where 3 degrees between IMU and rotor plane look like a bias [m/s^2]."""
MOTOR_TIMES = ("motor_lag", "motor_lag_up", "motor_lag_down", "motor_delay")
SHARED = ("kt", "kd", "Jr", "rotor_drag", *ROTORS_AIR, *MOTOR_TIMES, "command_delay", "max_speed")
"""Of the propulsion: every configuration has the same."""


def inertia_matrix(elements: Float[np.ndarray, " 6"]) -> Float[np.ndarray, "3 3"]:
    """Return the symmetric tensor of (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""
    matrix = np.empty((3, 3))
    for value, (i, j) in zip(elements, INERTIA_PLACES, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def inertia_about(
    elements_com: Float[np.ndarray, " 6"], mass: float, com: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 6"]:
    """Return the inertia at the origin from that about a CoM at `com` (parallel axes, Steiner)."""
    steiner = mass * (com @ com * np.eye(3) - np.outer(com, com))
    moved = inertia_matrix(elements_com) + steiner
    return np.array([moved[i, j] for i, j in INERTIA_PLACES])


def full_name(name: str, configuration: str) -> str:
    """Return the name of a parameter in covariances, such as ``Ixx@A``."""
    return name if name in SHARED else f"{name}@{configuration}"
