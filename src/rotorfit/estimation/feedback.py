r"""What a controller that answers the errors adds to the likelihood.

The inputs u of a vehicle that is steered are not given beforehand: its controller sees the errors
v of the accelerations and works against them. With what the pilot asks for and the errors as the
independent ones, y = G u + v and u = C (r - y), the density of what was logged is

.. math:: p(y, u) = p(v)\,p(r)\,|1 + C G|,

and every row gains :math:`\ln|1 + C(\omega)\,G(\theta, \omega)|`, whose slope is
:math:`\mathrm{Re}(T\,d\ln G)`, T = C G / (1 + C G) being the share of an error that the controller
answers, with its phase. Without it the effect of the inputs comes out too small, by about one over
the ratio of explained to residual power where T is one, and the inputs too late where T lags. (Over
all frequencies the slopes sum to nothing, the controller being causal: Ljung, System
Identification, 13.4. But the upper ones hold the noise of gyros that no controller answers, and
are left out.)

T is not known; it is handed over as an assumption about controllers, and how far the estimate hangs
on it is `banded.response_sensitivity`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What the controller does about the errors in the blocks of one configuration.

    Attributes
    ----------
    rows
        How many rows of each block a controller may answer, per error.
    moves
        By how much each input moves when the controller answers an error, up to a factor.
    share
        T of each block and error: the share of an error that is answered.
    doubt
        By how much that may be wrong.
    late
        Derivative of the logarithm of the inputs' effect by what moves their signals.
    """

    rows: Int[np.ndarray, "b e"]
    moves: Complex[np.ndarray, "b e u"]
    share: Complex[np.ndarray, "b e"]
    doubt: Complex[np.ndarray, "b e"]
    late: Complex[np.ndarray, "b t"]

    def select(self, keep: Bool[np.ndarray, " b"]) -> "Answers":
        """Return the answers of some blocks."""
        return Answers(
            rows=self.rows[keep],
            moves=self.moves[keep],
            share=self.share[keep],
            doubt=self.doubt[keep],
            late=self.late[keep],
        )

    @property
    def drift(self) -> Float[np.ndarray, "b e t"]:
        """Slope of the gain of each block and error by what moves the signals."""
        return np.real((self.rows * self.share)[:, :, None] * self.late[:, None, :])


@dataclass(frozen=True, slots=True, kw_only=True)
class Feedback:
    """Which errors a controller answers, by which signals, and where.

    Attributes
    ----------
    errors
        Places among the noisy signals.
    inputs
        Signals.
    answers
        One per configuration.
    """

    errors: tuple[int, ...]
    inputs: tuple[int, ...]
    answers: tuple[Answers, ...]

    def select(self, keep: Sequence[Bool[np.ndarray, " _"]]) -> "Feedback":
        """Return the answers of some blocks of each configuration."""
        answers = tuple(own.select(k) for own, k in zip(self.answers, keep, strict=True))
        return replace(self, answers=answers)

    def doubtful(self) -> "Feedback":
        """Return what would be answered beside what is."""
        answers = tuple(replace(own, share=own.doubt) for own in self.answers)
        return replace(self, answers=answers)

    def gain(self, c: int, G: Float[np.ndarray, "k z"]) -> float:
        """Return what configuration `c` adds to the log-likelihood, up to a constant."""
        own = self.answers[c]
        effect = self._effect(own, G)
        effect = np.where(np.real(effect) < 0, -effect, effect)  # away from the logarithm's cut
        logarithm = np.log(np.where(effect == 0, np.finfo(float).tiny, effect))
        return float(np.sum(own.rows * np.real(own.share * logarithm)))

    def slope(
        self, c: int, G: Float[np.ndarray, "k z"], dG: Float[np.ndarray, "f k z"]
    ) -> Float[np.ndarray, "b e f"]:
        """Return the derivative of `gain` along dG, block by block and error by error."""
        own = self.answers[c]
        moved = dG[:, list(self.errors)][:, :, list(self.inputs)]
        effect = self._effect(own, G)
        effect = np.where(effect == 0, np.inf, effect)  # nothing to answer with
        by = np.flatnonzero(moved.any(axis=(1, 2)))
        along = own.moves.transpose(1, 0, 2) @ moved[by].transpose(1, 2, 0)
        slope = along.transpose(1, 0, 2) * (own.rows * own.share / effect)[:, :, None]
        every = np.zeros((*effect.shape, len(dG)))
        every[:, :, by] = np.real(slope)
        return every

    def _effect(self, own: Answers, G: Float[np.ndarray, "k z"]) -> Complex[np.ndarray, "b e"]:
        return np.einsum("ei,bei->be", G[np.ix_(self.errors, self.inputs)], own.moves)
