"""Damped steps of Gauss and Newton: how large, and where crawling ones lead."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import EstimationError

LEAST_DAMPING: Final = 1e-9
SMALLEST_SHARE: Final = float(np.finfo(float).eps)
"""Least eigenvalue of the scaled information over the largest: below it there is only rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A damped step, the deviations of its parameters, and the predicted gain of the cost."""

    step: Float[np.ndarray, " f"]
    std: Float[np.ndarray, " f"]
    predicted_gain: float


def damped_step(
    information: Float[np.ndarray, "f f"], score: Float[np.ndarray, " f"], damping: float
) -> Step:
    """Solve for a Levenberg-Marquardt step, columns of the information scaled.

    `score` is half the slope; the damping is in units of the scaled information. Rounding of the
    information is far below `LEAST_DAMPING`, so that a step needs no root of it from the rows.
    """
    lengths = np.sqrt(np.diagonal(information))
    if not (lengths > 0.0).all():
        raise EstimationError("the flights do not move a parameter at all; remove its term")
    strength, V = np.linalg.eigh(information / np.outer(lengths, lengths))
    strength = np.maximum(strength, SMALLEST_SHARE * strength[-1])
    asked = (score / lengths) @ V
    moved = asked / (strength + damping)
    return Step(
        step=V @ moved / lengths,
        std=np.linalg.norm(V / np.sqrt(strength), axis=1) / lengths,
        predicted_gain=float(moved @ (2.0 * asked - strength * moved)),
    )


def reduced_damping(damping: float, won: float, predicted_gain: float) -> float:
    """Reduce the damping after a step, by the achieved share of the predicted gain.

    References
    ----------
    Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05, Technical University of
    Denmark, 1999.
    """
    ratio = min(won / max(predicted_gain, float(np.finfo(float).tiny)), 1.0)
    return max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), LEAST_DAMPING)


def extrapolated(
    path: Sequence[Float[np.ndarray, " f"]], std: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " f"] | None:
    """Extrapolate the last three points of steps that change by one share each; None of fewer.

    Reweighting at each step is what EM algorithms do, and crawls along valleys as they do (Varadhan
    and Roland, Scandinavian J. of Statistics 35(2), 2008: SQUAREM, third step length).
    """
    if len(path) < 3:
        return None
    first, second = path[-2] - path[-3], path[-1] - path[-2]
    turned = (second - first) / std
    if not turned.any():
        return None
    leap = max(float(np.linalg.norm(first / std) / np.linalg.norm(turned)), 1.0)
    return path[-3] + 2.0 * leap * first + leap**2 * (second - first)
