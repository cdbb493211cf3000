"""The speed that a motor settles at, over its command: laws as curves, with the battery's share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import Finding, doubt

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class PolynomialLaw:
    """Speed c0 + c1 u + c2 u^2 + ... of a command u, lowest power first [rad/s]."""

    coefficients: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TableLaw:
    """Rising speeds [rad/s] at rising commands (0 to 1), as a bench gives them; linear between."""

    commands: tuple[float, ...]
    speeds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SquareRootLaw:
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
class PowerLaw:
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

    The exponent is 1 where the speed goes with the voltage, 0.5 where the thrust does. `optional`:
    without a voltage the speed is that at the nominal one.
    """

    nominal: float
    exponent: float
    optional: bool = False


Curve = PolynomialLaw | TableLaw | SquareRootLaw | PowerLaw


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedLaw:
    """From command to rotor speed; without `voltage` it does not depend on the battery."""

    curve: Curve
    voltage: VoltageFactor | None = None


def speed_from_command(
    command: Float[np.ndarray, "n N"],
    law: SpeedLaw,
    *,
    battery: Float[np.ndarray, "n 1"] | None = None,
) -> Float[np.ndarray, "n N"]:
    """Compute the speed that a command settles at, never below 0 [rad/s]."""
    # Below a dead zone a fitted curve is negative, where the rotor stands.
    speed = np.maximum(_curve_speed(command, law.curve), 0.0)
    if law.voltage is None:
        return speed
    if battery is None:
        if law.voltage.optional:
            return speed
        raise LogError(
            "the law of the motors has a voltage factor, but there is no battery voltage with "
            "the commands; log it, or give a law without voltage"
        )
    relative = np.maximum(battery, 0.0) / law.voltage.nominal
    return speed * relative**law.voltage.exponent


def _curve_speed(command: Float[np.ndarray, "n N"], curve: Curve) -> Float[np.ndarray, "n N"]:
    match curve:
        case PolynomialLaw(coefficients):
            return np.polynomial.polynomial.polyval(command, np.asarray(coefficients))
        case TableLaw(commands, speeds):
            return np.interp(command, commands, speeds)
        case SquareRootLaw(full_speed, f, start, end):
            u = np.clip((command - start) / (end - start), 0.0, 1.0)
            return full_speed * np.sqrt(f * u**2 + (1.0 - f) * u)
        case PowerLaw(full_speed, b, p):
            return full_speed * np.maximum(b + (1.0 - b) * command, 0.0) ** p


def law_doubts(law: SpeedLaw, command: Float[np.ndarray, "n N"]) -> Iterator[Finding]:
    """Find what contradicts a law for the commands of a flight."""
    low, high = float(command.min()), float(command.max())
    if isinstance(law.curve, TableLaw):
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
