"""The law of the motors: the speed that they settle at over their command.

`fit/motor_law/` estimates it from measured speeds, `fit/motors/law_from_thrust.py` from thrust.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import Finding, doubt
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class PolynomialCurve:
    """Speed c0 + c1 u + c2 u^2 + ... of a command u, lowest power first [rad/s]."""

    coefficients: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TableCurve:
    """Rising speeds [rad/s] at rising commands (0 to 1), as a bench gives them; linear between."""

    commands: tuple[float, ...]
    speeds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SquareRootCurve:
    """Speed of a thrust that is partly linear in the command.

    Relative thrust f u^2 + (1 - f) u is what PX4 takes for its parameter THR_MDL_FAC, and thrust
    goes with the square of the speed.

    - `full_speed`: at full command [rad/s].
    - `thr_mdl_fac`: the factor f, 0 (thrust in proportion to the command) to 1 (speed).
    - `start`, `end`: commands between which u goes from 0 to 1: MOT_SPIN_MIN and MOT_SPIN_MAX of
      ArduPilot.
    """

    full_speed: float
    thr_mdl_fac: float
    start: float = 0.0
    end: float = 1.0


@dataclass(frozen=True, slots=True)
class PowerCurve:
    """Speed that goes with a power of the command, or of the command beyond an idle one.

    full_speed (b + (1 - b) u)^p: with b = 0 a power of the command, with p = 1 a straight line.

    - `full_speed`: at full command [rad/s].
    - `offset`: b, what the motors get at command 0 as a share of full command; below 0 a dead zone.
    - `exponent`: p.
    """

    full_speed: float
    offset: float
    exponent: float


@dataclass(frozen=True, slots=True)
class VoltageFactor:
    """What the battery does to the speed: a factor (V / nominal)^exponent, nominal in V.

    The exponent is 1 where the speed goes with the voltage, 0.5 where the thrust does.

    - `exponent_std`: its deviation.
    - `missing_std`: deviation of the speed, as a share, in a flight whose log has no voltage, and
      whose speeds are those at the nominal one; None: such a log is refused.
    """

    nominal: float
    exponent: float = 1.0
    exponent_std: float = 0.0
    missing_std: float | None = None


Curve = PolynomialCurve | TableCurve | SquareRootCurve | PowerCurve


@frozen_dataclass
class MotorLaw:
    """From command to rotor speed [rad/s], and how well that is known.

    - `curve`: speed over command, at the battery's nominal voltage.
    - `voltage`: the battery's share; None: the speed does not depend on it.
    - `speed_std`, `slope_std`: deviation of the speed in hover, and of how steeply it grows with
      the command there, as shares of them.
    - `usual_speed`: the speed at which they hold [rad/s]; None: that of the flight.
    - `exact`: it is that of simulated motors: no flight is asked whether it is right.
    - `stated`: it is a setting of the firmware, which nobody need have measured.
    """

    curve: Curve
    voltage: VoltageFactor | None = None
    speed_std: float = 0.0
    slope_std: float = 0.0
    usual_speed: float | None = None
    exact: bool = False
    stated: bool = False

    @property
    def full_speed(self) -> float:
        """Speed at full command, at the battery's nominal voltage [rad/s]."""
        return max(float(_curve_speed(np.ones((1, 1)), self.curve)[0, 0]), 0.0)

    @property
    def is_relative(self) -> bool:
        """Whether rotor speed is in parts of its largest: the law ends at 1."""
        return math.isclose(self.full_speed, 1.0)


def speed_from_command(
    command: Float[np.ndarray, "n N"],
    law: MotorLaw,
    *,
    battery: Float[np.ndarray, "n 1"] | None = None,
) -> Float[np.ndarray, "n N"]:
    """Compute the speed that a command settles at, never below 0 [rad/s]."""
    # Below a dead zone a fitted curve is negative, where the rotor stands.
    speed = np.maximum(_curve_speed(command, law.curve), 0.0)
    if law.voltage is None:
        return speed
    if battery is None:
        if law.voltage.missing_std is not None:
            return speed
        raise LogError(
            "the law of the motors has a voltage factor, but there is no battery voltage with "
            "the commands; log it, or give a law without voltage"
        )
    relative = np.maximum(battery, 0.0) / law.voltage.nominal
    return speed * relative**law.voltage.exponent


def _curve_speed(command: Float[np.ndarray, "n N"], curve: Curve) -> Float[np.ndarray, "n N"]:
    match curve:
        case PolynomialCurve(coefficients):
            return np.polynomial.polynomial.polyval(command, np.asarray(coefficients))
        case TableCurve(commands, speeds):
            return np.interp(command, commands, speeds)
        case SquareRootCurve(full_speed, f, start, end):
            u = np.clip((command - start) / (end - start), 0.0, 1.0)
            return full_speed * np.sqrt(f * u**2 + (1.0 - f) * u)
        case PowerCurve(full_speed, b, p):
            return full_speed * np.maximum(b + (1.0 - b) * command, 0.0) ** p


def law_doubts(law: MotorLaw, command: Float[np.ndarray, "n N"]) -> Iterator[Finding]:
    """Find what contradicts a law for the commands of a flight."""
    low, high = float(command.min()), float(command.max())
    if isinstance(law.curve, TableCurve):
        first, last = law.curve.commands[0], law.curve.commands[-1]
        beyond = float(((command < first) | (command > last)).mean())
        if beyond > 0.0:
            yield doubt(
                "beyond-law",
                f"{100 * beyond:.3g} % of the commands ({low:.3g} to {high:.3g}) are beyond the "
                f"table of the motors' law ({first:g} to {last:g}), where its end is taken: "
                "measure the speed there, too",
            )
    else:
        speeds = _curve_speed(np.linspace(low, high, 101)[:, None], law.curve)
        if (np.diff(speeds[:, 0]) < 0.0).any():
            yield doubt(
                "falling-law",
                f"the motors' law falls somewhere between the commands {low:.3g} and {high:.3g} of "
                "the flight, but no rotor slows down when the command rises: check its "
                "coefficients",
            )
