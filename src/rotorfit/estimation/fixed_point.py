"""Extrapolate the fixed point of an iteration whose steps shrink by about one share each.

A fit that takes the variance of every block from its last residuals goes to its end as EM
algorithms do: each step is .6 to .95 of the one before; steps of Newton with part of the second
derivatives do alike. The last few points and their steps show along which directions, and by which
share; the combination of them whose step would be shortest is nearer to the end (Anderson,
Iterative procedures for nonlinear integral equations, J. ACM 12, 1965; Walker and Ni, SIAM J.
Numer. Anal. 49, 2011).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float

MOST_ROUNDS: Final = 4
"""Points that are combined at most."""
LARGEST_STEP: Final = 1.0
"""Longest step, in standard deviations, from which the end is extrapolated: beyond it the steps do
not shrink by one share yet."""
LONGEST_LEAP: Final = 20.0
"""Longest leap over the step it replaces, the last of a share of .95: longer ones are cut."""
SHRINKS: Final = 1.5
"""Share of the step before a leap under which the step after it must be, or the rounds are
forgotten."""


@dataclass(slots=True)
class FixedPointRounds:
    """The last points of an iteration and the steps from them, in standard deviations."""

    points: list[Float[np.ndarray, " f"]] = field(default_factory=list[np.ndarray])
    steps: list[Float[np.ndarray, " f"]] = field(default_factory=list[np.ndarray])
    before_leap: float = np.inf

    def leap(
        self,
        point: Float[np.ndarray, " f"],
        step: Float[np.ndarray, " f"],
        std: Float[np.ndarray, " f"],
    ) -> Float[np.ndarray, " f"] | None:
        """Return the step that leads near the fixed point; None if a plain one is better."""
        size = float(np.abs(step / std).max())
        if size > LARGEST_STEP or size > SHRINKS * self.before_leap:
            self.points, self.steps, self.before_leap = [], [], np.inf
            return None
        self.points = [*self.points[1 - MOST_ROUNDS :], point]
        self.steps = [*self.steps[1 - MOST_ROUNDS :], step]
        if len(self.steps) < 3:
            return None
        # Anderson's mixing (J. of the ACM 12, 1965): the mix of past steps that would have been
        # zero.
        turned = np.diff(np.array(self.steps), axis=0) / std
        moved = np.diff(np.array(self.points), axis=0)
        share, *_ = np.linalg.lstsq(turned.T, step / std, rcond=1e-6)
        leap = step - share @ (moved + turned * std)
        self.before_leap = size
        return leap * min(1.0, LONGEST_LEAP * size / float(np.abs(leap / std).max()))
