"""What autopilots ask of the law from command to rotor speed: full speed, curve of thrust."""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from jaxtyping import Float

from rotorfit.logs.speed_law import SpeedLaw, SquareRootLaw, speed_from_command

GRID = np.linspace(0.0, 1.0, 501)
"""Commands on which a curve is compared with another."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustCurve:
    """Relative thrust f u^2 + (1 - f) u of a command u, PX4's model and ArduPilot's.

    Attributes
    ----------
    factor
        f: THR_MDL_FAC of PX4, MOT_THST_EXPO of ArduPilot.
    error
        Largest difference to the law, as a fraction of full thrust.
    """

    factor: float
    error: float

    def command(self, thrust: float) -> float:
        """Solve for the command u at a thrust, both as a fraction of full."""
        f = self.factor
        if f < 1e-12:
            return thrust
        b = 1.0 - f
        return float((-b + np.sqrt(b * b + 4.0 * f * thrust)) / (2.0 * f))


def speeds(law: SpeedLaw, commands: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Compute the speed at commands, at the battery's nominal voltage [rad/s]."""
    nominal = SpeedLaw(curve=law.curve)
    return speed_from_command(commands[:, None], nominal)[:, 0]


def full_speed_of(law: SpeedLaw) -> float:
    """Compute the speed at full command [rad/s]."""
    return float(speeds(law, np.array([1.0]))[0])


def command_range(law: SpeedLaw) -> tuple[float, float]:
    """Return the commands at which a law's rotor begins to turn, and is at full speed."""
    if isinstance(law.curve, SquareRootLaw):
        return law.curve.start, law.curve.end
    return dead_zone(law), 1.0


def dead_zone(law: SpeedLaw) -> float:
    """Find the largest command at which a law's rotor stands; 0 where it turns at any."""
    standing = np.flatnonzero(speeds(law, GRID) <= 0.0)
    return float(GRID[standing[-1]]) if len(standing) else 0.0


def betaflight_linear(law: SpeedLaw) -> ThrustCurve:
    """Fit the factor by which Betaflight's ``thrust_linear`` makes thrust linear, 0 to 1.5.

    Betaflight moves each motor's output x to x (1 + c (1 - x)^2), c being thrust_linear / 100
    (src/main/flight/pid.c, pidApplyThrustLinearization): the c for which thrust between idle and
    full is nearest to a straight line.
    """
    x = GRID
    found = scipy.optimize.minimize_scalar(
        lambda c: float(np.mean(_bend(law, x, float(c)) ** 2)), bounds=(0.0, 1.5), method="bounded"
    )
    c = float(found.x)
    return ThrustCurve(factor=c, error=float(np.abs(_bend(law, x, c)).max()))


def _bend(law: SpeedLaw, x: Float[np.ndarray, " n"], c: float) -> Float[np.ndarray, " n"]:
    """Compute thrust's distance from a straight line, as a share of full thrust over idle."""
    thrust = speeds(law, np.clip(x * (1.0 + c * (1.0 - x) ** 2), 0.0, 1.0)) ** 2
    return (thrust - thrust[0]) / (thrust[-1] - thrust[0]) - x


def thrust_curve(law: SpeedLaw, *, start: float = 0.0, end: float = 1.0) -> ThrustCurve:
    """Fit the curve nearest to a law, in the mean square of thrust over all commands.

    Its command u is 0 at the command `start` of the law, and 1 at its command `end`.

    Thrust goes with the speed squared; r = f u^2 + (1 - f) u is r - u = f (u^2 - u), so that f is
    one quotient, kept between 0 and 1 as both autopilots do.
    """
    u = GRID
    speed = speeds(law, start + (end - start) * u)
    relative = (speed / speed[-1]) ** 2
    bend = u**2 - u
    f = float(np.clip(bend @ (relative - u) / (bend @ bend), 0.0, 1.0))
    return ThrustCurve(factor=f, error=float(np.abs(f * bend + u - relative).max()))
