r"""What a controller that answers the errors adds to the likelihood.

The inputs u of a vehicle that is steered are not given beforehand: its controller sees the errors
v of the accelerations and drives them out. Inside its bandwidth it makes G u = w - v, w being what
is asked for. There v = w - G u, and its density, taken over to the inputs,

.. math:: p(u) = p(v)\,|\partial v / \partial u|,

gains the logarithm of the inputs' effect in every row: :math:`\ln|g(\theta)|` of an axis whose
inputs act by g. Without it the effect comes out too small by about one over the ratio of explained
to residual power. (Summed over all frequencies the score of the plain likelihood has no such pull,
the controller being causal: Ljung, System Identification, 13.4. But the upper ones hold the noise
of gyros that no controller answers, and are left out.)
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Feedback:
    """Which errors a controller answers, by which signals, and where.

    Attributes
    ----------
    errors
        Places among the noisy signals.
    inputs
        Signals.
    mixer
        How it moves the inputs together to answer each error, up to a factor.
    rows
        How many rows of each block are answered, per error; one array per configuration.
    """

    errors: tuple[int, ...]
    inputs: tuple[int, ...]
    mixer: Float[np.ndarray, "e u"]
    rows: tuple[Float[np.ndarray, "_ e"], ...]

    def log_effect(self, G: Float[np.ndarray, "k z"]) -> Float[np.ndarray, " e"]:
        """Return the logarithm of what the answer to each error does to it, up to a constant."""
        return np.log(np.maximum(np.abs(self._effect(G)), np.finfo(float).tiny))

    def slope(
        self, G: Float[np.ndarray, "k z"], dG: Float[np.ndarray, "f k z"]
    ) -> Float[np.ndarray, "e f"]:
        """Return the derivative of `log_effect` along dG."""
        moved = dG[:, list(self.errors)][:, :, list(self.inputs)]
        return np.einsum("fei,ei->ef", moved, self.mixer) / self._effect(G)[:, None]

    def _effect(self, G: Float[np.ndarray, "k z"]) -> Float[np.ndarray, " e"]:
        return np.einsum("ei,ei->e", G[np.ix_(self.errors, self.inputs)], self.mixer)
