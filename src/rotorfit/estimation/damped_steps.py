"""Damped steps of Gauss and Newton, and how large they may be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

LEAST_DAMPING: Final = 1e-9
SMALLEST_SHARE: Final = float(np.finfo(float).eps)
"""Least eigenvalue of the scaled information over the largest: below it there is only rounding."""


@frozen_dataclass
class Step:
    """A damped step, the deviations of its parameters, and the predicted gain of the cost.

    - `root`: of the inverse of the information, without the damping.
    """

    step: Float[np.ndarray, " f"]
    root: Float[np.ndarray, "f f"]
    std: Float[np.ndarray, " f"]
    predicted_gain: float


def damped_step(
    information: Float[np.ndarray, "f f"], score: Float[np.ndarray, " f"], damping: float
) -> Step:
    """Solve for a Levenberg-Marquardt step, columns of the information scaled.

    `score` is half the slope; the damping is in units of the scaled information. Rounding of the
    information is far below `LEAST_DAMPING`, so that a step needs no root of it from the rows.
    """
    if not (np.diagonal(information) > 0.0).all():
        raise EstimationError("the flights do not move a parameter at all; remove its term")
    strength, V, lengths = scaled_directions(information)
    asked = (score / lengths) @ V
    moved = asked / (strength + damping)
    root: Float[np.ndarray, "f f"] = V / np.sqrt(strength) / lengths[:, None]
    return Step(
        step=V @ moved / lengths,
        root=root,
        std=np.linalg.norm(root, axis=1),
        # Of the undamped quadratic model at the damped step: only so does Nielsen's ratio tell how
        # far the model holds.
        predicted_gain=float(moved @ (2.0 * asked - strength * moved)),
    )


def scaled_directions(
    information: Float[np.ndarray, "f f"],
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "f f"], Float[np.ndarray, " f"]]:
    """Return eigenvalues and -vectors of a column-scaled information, and the columns' lengths."""
    # Parameters have units of their own (kt is 1e-7, a mass 1): unscaled, the small eigenvalues
    # would be rounding.
    lengths = np.sqrt(np.diagonal(information))
    strength, V = np.linalg.eigh(information / np.outer(lengths, lengths))
    # Below this share eigenvalues are only rounding.
    return np.maximum(strength, SMALLEST_SHARE * strength[-1]), V, lengths


def reduced_damping(damping: float, won: float, predicted_gain: float) -> float:
    """Reduce the damping after a step, by the achieved share of the predicted gain.

    References
    ----------
    Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05, Technical University of
    Denmark, 1999.
    """
    ratio = min(won / max(predicted_gain, float(np.finfo(float).tiny)), 1.0)
    return max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), LEAST_DAMPING)
