r"""The likelihood of the inputs of a controller that responds to the errors.

The inputs u of a vehicle in closed loop are not given beforehand: its controller sees the errors
v of the accelerations and works against them. With what the pilot asks for and the errors as the
independent ones, y = G u + v and u = C (r - y), the density of what was logged is

.. math:: p(y, u) = p(v)\,p(r)\,|1 + C G|,

and every row gains :math:`\ln|1 + C(\omega)\,G(\theta, \omega)|`, whose slope is
:math:`\mathrm{Re}(T\,d\ln G)`, T = C G / (1 + C G) being the complementary sensitivity: the share
of an error that the controller responds to, with its phase. Without it the effect of the inputs
comes out too small, by about one over the ratio of explained to residual power where T is one, and
the inputs too late where T lags. (Over all frequencies the slopes sum to nothing, the controller
being causal: Ljung, System Identification, 13.4. But the upper ones hold the noise of gyros that no
controller follows, and are left out.)

T is not known; it is handed over as an assumption about controllers, and how far the estimate
depends on it is `banded.response_sensitivity`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Complex, Float, Int


@frozen_dataclass
class ClosedLoopResponses:
    """The controller's response to the errors in the blocks of one configuration.

    - `rows`: how many rows of each block the controller may respond to, per error.
    - `moves`: by how much each input moves in response to an error, up to a factor.
    - `complementary_sensitivity`: T of each block and error.
    - `uncertainty`: by how much T may be wrong.
    - `log_effect_slopes`: derivative of the logarithm of what the inputs do, by what moves their
      signals, per error.
    """

    rows: Int[np.ndarray, "b e"]
    moves: Complex[np.ndarray, "b e u"]
    complementary_sensitivity: Complex[np.ndarray, "b e"]
    uncertainty: Complex[np.ndarray, "b e"]
    log_effect_slopes: Complex[np.ndarray, "b e t"]

    def select(self, keep: Bool[np.ndarray, " b"]) -> ClosedLoopResponses:
        """Select the responses of some blocks."""
        return ClosedLoopResponses(
            rows=self.rows[keep],
            moves=self.moves[keep],
            complementary_sensitivity=self.complementary_sensitivity[keep],
            uncertainty=self.uncertainty[keep],
            log_effect_slopes=self.log_effect_slopes[keep],
        )

    @property
    def gain_slopes(self) -> Float[np.ndarray, "b e t"]:
        """Slope of the gain of each block and error by what moves the signals."""
        weighted = (self.rows * self.complementary_sensitivity)[:, :, None]
        return np.real(weighted * self.log_effect_slopes)


@frozen_dataclass
class Feedback:
    """Errors (places among the noisy signals) that a controller responds to by some inputs.

    `responses`: one per part of the configurations.
    """

    errors: tuple[int, ...]
    inputs: tuple[int, ...]
    responses: tuple[ClosedLoopResponses, ...]

    def select(self, keep: Sequence[Bool[np.ndarray, " _"]]) -> Feedback:
        """Select the responses of some blocks of each part."""
        chosen = tuple(part.select(k) for part, k in zip(self.responses, keep, strict=True))
        return replace(self, responses=chosen)

    def uncertain_part(self) -> Feedback:
        """Put the uncertainty of T in the place of T."""
        uncertain = tuple(
            replace(part, complementary_sensitivity=part.uncertainty) for part in self.responses
        )
        return replace(self, responses=uncertain)

    def gain(self, c: int, G: Float[np.ndarray, "k z"]) -> float:
        """Compute the share of part `c` in the log-likelihood, up to a constant."""
        response = self.responses[c]
        effect = self._effect_of_response(response, G)
        effect = np.where(np.real(effect) < 0, -effect, effect)  # away from the logarithm's cut
        logarithm = np.log(np.where(effect == 0, np.finfo(float).tiny, effect))
        return float(
            np.sum(response.rows * np.real(response.complementary_sensitivity * logarithm))
        )

    def slope(
        self, c: int, G: Float[np.ndarray, "k z"], dG: Float[np.ndarray, "f k z"]
    ) -> Float[np.ndarray, "b e f"]:
        """Return the derivative of `gain` along dG, block by block and error by error."""
        response = self.responses[c]
        moved = dG[:, list(self.errors)][:, :, list(self.inputs)]
        effect = self._effect_of_response(response, G)
        effect = np.where(effect == 0, np.inf, effect)  # no input to respond with
        by = np.flatnonzero(moved.any(axis=(1, 2)))
        along = response.moves.transpose(1, 0, 2) @ moved[by].transpose(1, 2, 0)
        weight = response.rows * response.complementary_sensitivity / effect
        slope = along.transpose(1, 0, 2) * weight[:, :, None]
        every = np.zeros((*effect.shape, len(dG)))
        every[:, :, by] = np.real(slope)
        return every

    def _effect_of_response(
        self, response: ClosedLoopResponses, G: Float[np.ndarray, "k z"]
    ) -> Complex[np.ndarray, "b e"]:
        return np.einsum("ei,bei->be", G[np.ix_(self.errors, self.inputs)], response.moves)
