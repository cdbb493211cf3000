r"""Scatter of the parts of a fit over its formal covariance, of all parameters together.

Two or three parts of a flight show one number, and their scatter its variance to a factor of
three. What the model lacks shows in all numbers, so that their scatters together show how much
larger than stated variances are (the dispersion of a quasi-likelihood: Wedderburn, Biometrika 61,
1974). At the estimate the score :math:`s_k` of part k has the covariance :math:`H_k - H_k C H_k`
(H_k its information, C the covariance of the fit; its influence on the estimate is :math:`C s_k`),
so that

.. math:: \varphi = \sum_k s_k^T C s_k \Big/ \sum_k \mathrm{tr}(Y_k - Y_k^2), \quad
   Y_k = C^{1/2} H_k C^{1/2}

is one where the parts scatter as stated. As those scores have
:math:`\mathrm{cov}(s_k, s_l) = \delta_{kl} H_k - H_k C H_l`, which sum to nothing, it has the
degrees of freedom :math:`\mathrm{tr}^2 / (\sum_k |Y_k - Y_k^2|^2 + \sum_{k \ne l} |Y_k Y_l|^2)`
(Satterthwaite, Biometrics Bulletin 2, 1946).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.estimation.banded import BandedEstimate, information_of_parts, square_root

LEAST: Final = 1e-9
"""Share of what the parts know that another part can contradict: less is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dispersion:
    """Variances between parts of a fit over the formal ones, and their degrees of freedom.

    - `ratio`: one where the parts scatter as stated.
    - `degrees`: of freedom; 0 where no part can differ from another.
    """

    ratio: float
    degrees: float

    def pooled(
        self,
        stated: Float[np.ndarray, " q"],
        shown: Float[np.ndarray, " q"],
        blocks: Float[np.ndarray, " q"],
    ) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
        """Pool variances and degrees of freedom of single numbers with the dispersion.

        `stated`, `shown`: variances by the fit, and by the scatter of the blocks. `blocks`: the
        effective number of blocks of each number.
        """
        degrees = blocks + self.degrees
        return (blocks * shown + self.degrees * self.ratio * stated) / degrees, degrees


def dispersion(fit: BandedEstimate, parts: Sequence[Bool[np.ndarray, " b"]]) -> Dispersion:
    """Estimate the dispersion of a fit by parts of its blocks."""
    influences = np.array([fit.influence[part].sum(axis=0) for part in parts])
    information = information_of_parts(fit, parts)
    return dispersion_of_parts(fit.estimate.covariance, information, influences)


def dispersion_of_parts(
    covariance: Float[np.ndarray, "f f"],
    information: Float[np.ndarray, "p f f"],
    influences: Float[np.ndarray, "p f"],
) -> Dispersion:
    """Estimate the dispersion by each part's information and influence on the estimate."""
    root = square_root(covariance)
    Y = root.T @ information @ root
    squares = Y @ Y
    own = Y - squares
    stated = float(np.trace(own, axis1=1, axis2=2).sum())
    across = float((squares.sum(axis=0) ** 2).sum() - (squares**2).sum())
    spread = float((own**2).sum()) + max(across, 0.0)
    if not stated > LEAST * float(np.trace(Y, axis1=1, axis2=2).sum()):
        return Dispersion(ratio=1.0, degrees=0.0)
    shown = float((_whitened(influences, root) ** 2).sum())
    return Dispersion(ratio=shown / stated, degrees=stated**2 / spread)


def _whitened(
    influences: Float[np.ndarray, "p f"], root: Float[np.ndarray, "f f"]
) -> Float[np.ndarray, "p f"]:
    """Express moves of the parameters in deviations of independent directions."""
    size = np.linalg.norm(root, axis=1)
    size = np.where(size > 0.0, size, 1.0)
    white: Float[np.ndarray, "p f"] = (influences / size) @ np.linalg.pinv(root / size[:, None]).T
    return white
