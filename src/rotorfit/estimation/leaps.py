"""Steps of a fit that lead further than those of given variances: they let the variances follow."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.damped_steps import scaled_directions
from rotorfit.estimation.fixed_point import FixedPointRounds

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.estimation.banded_equations import CorrectedEquations, State

MOST_REWEIGHTING = 0.95
"""Largest share of the information that a step takes as given back by the variances: its leap is
twenty times as long as the step of given variances."""
MOST_NOISE = 0.7
"""Share of the regressors' noise in the information on a direction, over which the correction for
it is larger than what it corrects: nothing is known there."""


@dataclass(slots=True)
class Leaps:
    """Steps that lead further than those of given variances, and what was learnt of them.

    - `newton`, `reweighted`: the last points and steps with variances that follow, and without.
    - `before_newton`: size of the step of given variances where the last Newton step was taken.
    - `barred_over`: size from which on no further one is taken: half of that after which one led to
      a longer step.
    """

    newton: FixedPointRounds = field(default_factory=FixedPointRounds)
    reweighted: FixedPointRounds = field(default_factory=FixedPointRounds)
    barred_over: float = np.inf
    before_newton: float = np.inf

    def from_state(
        self,
        state: State,
        equations: CorrectedEquations,
        root: Float[np.ndarray, "f q"],
    ) -> Float[np.ndarray, " f"] | None:
        """Return the step with variances that follow the parameters; None if no end of it is near.

        It solves (information - noise - reweighting) step = score but along directions where that
        has no maximum; what the matrix lacks, such as the turn of the autopilot's response, the
        rounds learn. `root`: of the inverse of the information less noise, along what is known.
        """
        std: Float[np.ndarray, " f"] = np.linalg.norm(root, axis=1)
        asked: Float[np.ndarray, " q"] = root.T @ equations.score
        plain: Float[np.ndarray, " f"] = root @ asked
        size = float(np.abs(plain / std).max())
        if size > self.before_newton:
            self.barred_over = 0.5 * self.before_newton
        share, V = np.linalg.eigh(root.T @ equations.reweighting @ root)
        if not len(share) or size > self.barred_over:
            self.before_newton = np.inf
            return self.reweighted.leap(state.phi, plain, std)
        self.before_newton = size
        # Along a direction with share s of the information given back, the root of the score is 1 /
        # (1 - s) times as far. From s = 1 on there is no maximum there, and the plain step remains.
        gain = np.where(share < 1.0, 1.0 / (1.0 - np.minimum(share, MOST_REWEIGHTING)), 1.0)
        step: Float[np.ndarray, " f"] = root @ (V @ (gain * (V.T @ asked)))
        leap = self.newton.leap(state.phi, step, std)
        return step if leap is None else leap


def corrected_root(equations: CorrectedEquations) -> Float[np.ndarray, "f q"]:
    """Factor the inverse of information less noise, without directions that are mostly noise."""
    strength, V, lengths = scaled_directions(equations.information)
    root: Float[np.ndarray, "f f"] = V / np.sqrt(strength) / lengths[:, None]
    share, V = np.linalg.eigh(root.T @ equations.noise_information @ root)
    known = share < MOST_NOISE
    corrected: Float[np.ndarray, "f q"] = root @ (V[:, known] / np.sqrt(1.0 - share[known]))
    return corrected
