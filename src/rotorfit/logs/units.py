"""Units, axes and attitudes as files have them, to SI, FLU body axes and a world with z up.

Every conversion of a unit is one factor and one offset.
"""

from __future__ import annotations

import difflib
from math import pi
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

Quantity = Literal[
    "time",
    "angular velocity",
    "rotor speed",
    "acceleration",
    "command",
    "voltage",
    "velocity",
    "position",
    "angle",
    "quaternion",
]

STANDARD_GRAVITY: Final = 9.80665
"""The acceleration that accelerometers call 1 g [m/s^2]."""

_REVOLUTION = 2.0 * pi
_DEGREE = pi / 180.0

UNITS: Final[Mapping[Quantity, Mapping[str, float]]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angular velocity": {
        "rad/s": 1.0,
        "mrad/s": 1e-3,
        "deg/s": _DEGREE,
        "mdeg/s": 1e-3 * _DEGREE,
        "rpm": _REVOLUTION / 60.0,
        "Hz": _REVOLUTION,
    },
    "rotor speed": {
        "rad/s": 1.0,
        "deg/s": _DEGREE,
        "rpm": _REVOLUTION / 60.0,
        "erpm": _REVOLUTION / 60.0,
        "Hz": _REVOLUTION,
    },
    "acceleration": {
        "m/s^2": 1.0,
        "g": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY,
        "cm/s^2": 1e-2,
        "mm/s^2": 1e-3,
    },
    "command": {"1": 1.0, "%": 1e-2, "us": 1.0, "counts": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "quaternion": {"1": 1.0},
}
"""SI value of one recorded unit, by kind of quantity; the first unit is the SI unit itself.

``erpm`` (electrical revolutions per minute) is divided by the pole pairs besides; ``us`` (pulse
width) and ``counts`` of a command are placed in the stated range instead.
"""

_ALIASES: Final[Mapping[str, str]] = {
    "sec": "s",
    "µs": "us",
    "μs": "us",
    "rad/sec": "rad/s",
    "dps": "deg/s",
    "mdps": "mdeg/s",
    "°/s": "deg/s",
    "°": "deg",
    "RPM": "rpm",
    "eRPM": "erpm",
    "rev/s": "Hz",
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
    "m/s²": "m/s^2",
    "": "1",
}

_NEEDS_RANGE: Final = ("us", "counts")


@frozen_dataclass
class Conversion:
    """SI value = factor * recorded value + offset."""

    factor: float
    offset: float = 0.0

    def __call__(self, recorded: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Return the SI values of recorded values; what overflows becomes infinite."""
        with np.errstate(over="ignore", invalid="ignore"):
            return recorded * self.factor + self.offset


def si_unit(quantity: Quantity) -> str:
    """Return the SI unit of a kind of quantity."""
    return next(iter(UNITS[quantity]))


def conversion(
    quantity: Quantity,
    unit: str,
    *,
    motor_poles: int | None = None,
    recorded_range: tuple[float, float] | None = None,
) -> Conversion:
    """Return the conversion of one recorded unit to SI."""
    known = _known_unit(quantity, unit)
    if quantity == "command" and (known in _NEEDS_RANGE or recorded_range is not None):
        return _command_in_range(known, recorded_range)
    factor = UNITS[quantity][known]
    return Conversion(factor=factor / _pole_pairs(motor_poles) if known == "erpm" else factor)


def is_unit(text: str) -> bool:
    """Return whether a text is the name of a unit, of whatever quantity; brackets aside."""
    name = text.strip().strip("[]()").strip()
    name = _ALIASES.get(name, name)
    return any(name in units for units in UNITS.values())


def _known_unit(quantity: Quantity, unit: str) -> str:
    units = UNITS[quantity]
    name = unit.strip()
    name = _ALIASES.get(name, name)
    if name in units:
        return name
    close = difflib.get_close_matches(name.lower(), [u.lower() for u in units], n=1, cutoff=0.4)
    nearest = [u for u in units if close and u.lower() == close[0]]
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    raise LogError(f"unknown unit {unit!r} of {quantity}: {hint}known are {', '.join(units)}")


def _command_in_range(unit: str, recorded_range: tuple[float, float] | None) -> Conversion:
    if recorded_range is None:
        example = "[1000, 2000]" if unit == "us" else "[0, 65535]"
        raise LogError(
            f"a command in {unit} needs the recorded values of stop and full: "
            f"add range = {example} or what the log uses"
        )
    low, high = recorded_range
    if not (np.isfinite([low, high]).all() and low != high):
        raise LogError(
            f"range = [{low:g}, {high:g}] of a command: the recorded values of stop and of full "
            "must be two different finite numbers"
        )
    return Conversion(factor=1.0 / (high - low), offset=-low / (high - low))


def _pole_pairs(motor_poles: int | None) -> float:
    if motor_poles is None:
        raise LogError(
            "rotor speeds in erpm need the number of magnet poles of the motors: "
            "give motor_poles (often 14), or record rpm"
        )
    if motor_poles < 2 or motor_poles % 2:
        raise LogError(f"motor_poles = {motor_poles}: magnet poles come in pairs, 2 or more")
    return motor_poles / 2


Axes = Literal["FLU", "FRD"]

_HALF_TURN_ABOUT_X = np.array([1.0, -1.0, -1.0])
_OFF_LENGTH = 0.05
"""A quaternion this far from length 1 is no rotation, such as zeros where a body is not seen."""


def vectors_to_flu(vectors: Float[np.ndarray, "n 3"], axes: Axes) -> Float[np.ndarray, "n 3"]:
    """Turn body vectors into FLU axes; FRD is FLU turned by half a turn about x.

    The same turn takes world vectors from north-east-down to north-west-up.
    """
    return vectors if axes == "FLU" else vectors * _HALF_TURN_ABOUT_X


def attitude_to_flu(
    attitude_wxyz: Float[np.ndarray, "n 4"], axes: Axes
) -> Float[np.ndarray, "n 4"]:
    """Turn body-to-world quaternions to FLU axes and z up."""
    turn = np.concatenate([[1.0], _HALF_TURN_ABOUT_X])
    # With D the half turn about x on both ends, R' = D R D: the same angle about the turned axis.
    return attitude_wxyz if axes == "FLU" else attitude_wxyz * turn


def attitude_from_euler(angles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Return the quaternion w, x, y, z of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles / 2).T, np.sin(angles / 2).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def world_to_body(
    world: Float[np.ndarray, "n 3"], attitude_wxyz: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 3"]:
    """Turn world vectors into body axes, by the quaternion from body to world."""
    w, u = attitude_wxyz[:, :1], -attitude_wxyz[:, 1:]
    turn = 2.0 * np.cross(u, world)
    return world + w * turn + np.cross(u, turn)


def unit_or_nan(attitude: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Bring quaternions to length 1; those far from it are no rotation, and become NaN."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(attitude, axis=1)
        good = np.abs(length - 1.0) < _OFF_LENGTH
    return attitude / np.where(good, length, np.nan)[:, None]
