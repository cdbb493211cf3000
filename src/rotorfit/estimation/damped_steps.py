"""Damped steps of Gauss and Newton: how large, and where crawling ones lead."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

LEAST_DAMPING: Final = 1e-9
SMALLEST_SHARE: Final = 1e-15
"""Share of the largest singular value, under which a direction is not known at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A damped step, the deviations of its parameters, and the predicted gain of the cost."""

    step: Float[np.ndarray, " f"]
    std: Float[np.ndarray, " f"]
    predicted_gain: float


def damped_step(
    root: Float[np.ndarray, "n f"], score: Float[np.ndarray, " f"], damping: float
) -> Step:
    """Solve for a Levenberg-Marquardt step, columns scaled, with R^T R the information.

    `score` is half the slope; the damping is in units of the scaled information.
    """
    lengths = np.linalg.norm(root, axis=0)
    _, s, Vt = np.linalg.svd(root / lengths, full_matrices=False)
    known = s > SMALLEST_SHARE * s[0]
    s, Vt = s[known], Vt[known]
    projected = Vt @ (score / lengths)
    moved = s / (s**2 + damping) * projected
    return Step(
        step=(moved / s) @ Vt / lengths,
        std=np.linalg.norm(Vt / s[:, None], axis=0) / lengths,
        predicted_gain=float(moved @ (2.0 * projected / s - moved)),
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
