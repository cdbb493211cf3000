"""The forms that a law from command to rotor speed may have, with their derivatives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.logs.speed_law import Curve, PowerLaw, SquareRootLaw

FormName = Literal["linear", "power", "offset power", "sqrt"]
Vector = Float[np.ndarray, " _"]
TINY: Final = 1e-6
"""Commands below are as it, in what goes with their logarithm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A curve of relative speed, 1 at full command.

    Attributes
    ----------
    start, lower, upper
        Of its parameters.
    logarithm
        From commands and parameters to the logarithm of the relative speed and its derivatives.
    curve
        With a speed at full command.
    """

    start: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    logarithm: Callable[[Vector, Vector], tuple[Vector, Float[np.ndarray, "n p"]]]
    curve: Callable[[float, Vector], Curve]


def _offset_power(u: Vector, b: float, p: float) -> tuple[Vector, Vector, Vector]:
    """Return p log(b + (1 - b) u), and its derivatives by b and p."""
    base = np.maximum(b + (1.0 - b) * u, TINY)
    return p * np.log(base), np.where(base > TINY, p * (1.0 - u) / base, 0.0), np.log(base)


def _linear(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "n p"]]:
    value, by_offset, _ = _offset_power(u, float(x[0]), 1.0)
    return value, by_offset[:, None]


def _power(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "n p"]]:
    value, _, by_exponent = _offset_power(u, 0.0, float(x[0]))
    return value, by_exponent[:, None]


def _both(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "n p"]]:
    value, *slopes = _offset_power(u, float(x[0]), float(x[1]))
    return value, np.column_stack(slopes)


def _sqrt(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "n p"]]:
    u = np.maximum(u, TINY)
    thrust = x[0] * u**2 + (1.0 - x[0]) * u
    return 0.5 * np.log(thrust), (0.5 * (u**2 - u) / thrust)[:, None]


FORMS: Final[Mapping[FormName, Form]] = {
    "linear": Form(
        start=(0.1,),
        lower=(-0.5,),
        upper=(0.95,),
        logarithm=_linear,
        curve=lambda full, x: PowerLaw(full, float(x[0]), 1.0),
    ),
    "power": Form(
        start=(0.7,),
        lower=(0.1,),
        upper=(3.0,),
        logarithm=_power,
        curve=lambda full, x: PowerLaw(full, 0.0, float(x[0])),
    ),
    "sqrt": Form(
        start=(0.5,),
        lower=(0.0,),
        upper=(1.0,),
        logarithm=_sqrt,
        curve=lambda full, x: SquareRootLaw(full, float(x[0])),
    ),
    "offset power": Form(
        start=(0.05, 0.7),
        lower=(-0.5, 0.1),
        upper=(0.95, 3.0),
        logarithm=_both,
        curve=lambda full, x: PowerLaw(full, float(x[0]), float(x[1])),
    ),
}
"""By name, those with fewer parameters first."""
