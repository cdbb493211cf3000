"""The motors' law, lag and delay between command and measured speed, as a result keeps them."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any, Final, get_args

from rotorfit.estimation.measured import Measured
from rotorfit.fit.motor_law.law_model import FormName
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import (
    Curve,
    MotorLaw,
    PowerCurve,
    SquareRootCurve,
    VoltageFactor,
)

if TYPE_CHECKING:
    from collections.abc import Mapping


USUAL_EXPONENT: Final = Measured(value=0.8, std=0.2)
"""Of the voltage, in the speed at one command: 1 / (2 - e) of a motor that turns a share e of its
power into torque (0.7 to 0.9), 0 where the autopilot makes up for the battery."""
AT_COMMAND: Final = "full_command_voltage"
UNDER_LOAD: Final = "full_load_voltage"
"""Diagnostics: the voltage of full thrust by the law, and the one that the battery gives then."""


@frozen_dataclass
class LawNumber:
    """One number of the law.

    Attributes
    ----------
    name, unit
        Such as ``full_speed`` in rad/s.
    value, interval
        SI; the interval is 95 %.
    """

    name: str
    value: float
    interval: tuple[float, float]
    unit: str


@frozen_dataclass
class LawPoint:
    """Measured speeds about one command: their median, and the range of 90 % of them.

    Attributes
    ----------
    command
        As the motors have it after lag and delay, 0 to 1.
    low, median, high
        Of the mean rotor, at the nominal voltage [rad/s].
    """

    command: float
    low: float
    median: float
    high: float


@frozen_dataclass
class CommandLaw:
    """The speed that motors settle at over their command, fitted to measured speeds.

    Attributes
    ----------
    form
        ``linear``, ``power`` or ``offset power``: full_speed (offset + (1 - offset) u)^exponent;
        ``sqrt``: full_speed sqrt(f u^2 + (1 - f) u), f being thr_mdl_fac.
    numbers
        Of the form, of the battery's voltage, of the curve of thrust.
    nominal_voltage
        At which full_speed holds [V]; None if the flights show nothing of the voltage.
    known
        Whether full speed is known well enough to be used.
    commands
        Between which 99.8 % of the commands in flight were.
    relative_error
        Root mean square of measured over predicted speed, less one.
    held_out
        By form: error on blocks of time that the fit had not seen [rad/s].
    rotor_factors
        Speed of each rotor over the mean one's at the same command; None if it has none.
    points
        For a picture.
    motors
        The ``[motors]`` table for later flights of the vehicle without rotor speed.
    estimator
        How law and intervals were made.
    """

    form: str
    numbers: tuple[LawNumber, ...]
    nominal_voltage: float | None
    known: bool
    commands: tuple[float, float]
    relative_error: float
    held_out: Mapping[str, float]
    rotor_factors: tuple[float | None, ...]
    points: tuple[LawPoint, ...]
    motors: Mapping[str, Any]
    estimator: str

    def number(self, name: str) -> LawNumber | None:
        """Return a number of the law by its name; None if its form has no such number."""
        return next((number for number in self.numbers if number.name == name), None)

    @property
    def law(self) -> MotorLaw:
        """From command to speed, of the mean rotor."""
        at = {number.name: number.value for number in self.numbers}
        curve: Curve
        if self.form == "sqrt":
            curve = SquareRootCurve(at["full_speed"], at["thr_mdl_fac"])
        else:
            curve = PowerCurve(at["full_speed"], at.get("offset", 0.0), at.get("exponent", 1.0))
        if self.nominal_voltage is None:
            return MotorLaw(curve=curve)
        voltage = VoltageFactor(self.nominal_voltage, at["voltage_exponent"])
        return MotorLaw(curve=curve, voltage=voltage)


def law_to_plain(law: CommandLaw | None) -> dict[str, Any] | None:
    """Return a law as a result's file has it."""
    return None if law is None else dataclasses.asdict(law)


def law_from_plain(entry: Mapping[str, Any] | None) -> CommandLaw | None:
    """Return the law of a result's file.

    Raises `KeyError`, `TypeError`, `ValueError` if it is not one.
    """
    if entry is None:
        return None
    fields: dict[str, Any] = dict(entry)
    low, high = fields["commands"]
    fields["commands"] = (low, high)
    fields["numbers"] = tuple(
        LawNumber(
            name=number["name"],
            value=number["value"],
            interval=(number["interval"][0], number["interval"][1]),
            unit=number["unit"],
        )
        for number in fields["numbers"]
    )
    fields["rotor_factors"] = tuple(fields["rotor_factors"])
    fields["points"] = tuple(LawPoint(**point) for point in fields["points"])
    law = CommandLaw(**fields)
    values: list[Any] = [v for n in law.numbers for v in (n.value, *n.interval)]
    if not all(isinstance(v, int | float) and math.isfinite(v) for v in values):
        raise ValueError("command_law holds what is no number")
    if law.form not in get_args(FormName):
        raise ValueError(f"command_law has the form {law.form!r}")
    _ = law.law  # all that it needs is there
    return law
