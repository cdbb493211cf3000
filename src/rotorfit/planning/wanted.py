"""What accuracy is wanted: the largest half of the 95 % interval of each number."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rotorfit.errors import ExperimentError

WANTABLE: Final[Mapping[str, str]] = {
    **{name: name for name in ("kt", "kd", "Jr")},
    **{name: f"{name}_com@A" for name in ("Ixx", "Iyy", "Izz")},
    **{name: f"{name}@A" for name in ("com_x", "com_y", "com_z")},
}
"""What can be asked for, and its name among the predicted numbers; inertia about the CoM."""
IN_MM: Final = ("com_x", "com_y", "com_z")
"""Wanted in millimetres; everything else in percent."""
USUAL: Final = ("kt", "kd", "Ixx", "Iyy", "Izz")
"""What a single percentage is wanted of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """The accuracy wanted.

    Attributes
    ----------
    limits
        By the names of `WANTABLE`: percent of the value, for the CoM millimetres.
    """

    limits: Mapping[str, float]

    def met_by(self, half_widths: Mapping[str, float], values: Mapping[str, float]) -> bool:
        """Say whether half-widths (SI) of these values are all small enough."""
        return self.worst(half_widths, values) <= 1.0

    def worst(self, half_widths: Mapping[str, float], values: Mapping[str, float]) -> float:
        """Return the largest half-width in parts of its limit; what has no number is infinite."""
        shares = [
            shown_width(name, half_widths.get(name, math.inf), values.get(name, 1.0)) / limit
            for name, limit in self.limits.items()
        ]
        return max(shares)


def shown_width(name: str, half_width: float, value: float) -> float:
    """Return a half-width in the unit it is wanted in: millimetres for the CoM, else percent."""
    return 1e3 * half_width if name in IN_MM else 100.0 * half_width / abs(value)


def wanted_accuracy(text: str) -> Wanted:
    """Return the accuracy of words such as ``5`` or ``kd=2,Izz=3,com_x=1``.

    Parameters
    ----------
    text
        One percentage for kt, kd, Ixx, Iyy and Izz, or names with their own: half of the 95 %
        interval in percent of the value, for the CoM in mm.

    Raises
    ------
    ExperimentError
        If they name nothing known, or no sensible number.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1 and "=" not in parts[0]:
        return Wanted(limits=dict.fromkeys(USUAL, _limit(parts[0], "accuracy")))
    limits: dict[str, float] = {}
    for part in parts:
        name, sign, number = (word.strip() for word in part.partition("="))
        if not sign or name not in WANTABLE:
            raise ExperimentError(
                f"accuracy {part!r}, expected one percentage such as 5, or names with percentages "
                f"such as kd=2,Izz=3; names: {', '.join(WANTABLE)} ({', '.join(IN_MM)} in mm)"
            )
        limits[name] = _limit(number, name)
    return Wanted(limits=limits)


def _limit(text: str, name: str) -> float:
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not (math.isfinite(limit) and limit > 0):
        raise ExperimentError(f"{name} {text!r} is no accuracy; give a number over 0, such as 5")
    return limit
