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

Flights differ in it: in one the air is calm, in another gusts take longer than a block. So each
group of parts has its own, by the sums over its parts, drawn to the others as far as all of them
differ by no more than chance (`alike`). Of a number's variance
:math:`\nabla g^T C (\sum_f H_f + P) C \nabla g`, with P the information of what was known before,
each flight's part is as much larger; P is stated and no scatter contradicts it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded import BandedEstimate, information_of_parts, square_root
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

FEWEST_DEGREES: Final = 1.0
"""Degrees of freedom below which the logarithm of a mean square has no mean to speak of: of f of
them, the one that is taken off goes with 1 / f."""
LEAST: Final = 1e-9
"""Share of what the parts know that another part can contradict: less is rounding."""


@frozen_dataclass
class Dispersion:
    """Variances between parts of a fit over the formal ones, and their degrees of freedom.

    - `ratio`: one where the parts scatter as stated.
    - `degrees`: of freedom; 0 if no part can differ from another.
    """

    ratio: float
    degrees: float


def pooled(
    dispersions: Sequence[Dispersion],
    stated: Float[np.ndarray, "d q"],
    shown: Float[np.ndarray, " q"],
    blocks: Float[np.ndarray, " q"],
) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Pool the variances of single numbers with dispersions; return them, and their degrees.

    Parameters
    ----------
    dispersions
        Of each group of parts.
    stated
        Variance of each number by the fit that comes from each group.
    shown
        Variance of each number by the scatter of its own blocks.
    blocks
        Effective number of blocks of each number.
    """
    made = np.array([[one.ratio] for one in dispersions]) * stated
    total, free = made.sum(axis=0), np.array([[one.degrees] for one in dispersions])
    weight = np.where(total > 0.0, made, stated)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_group = np.nan_to_num((weight**2 / free).sum(axis=0), nan=np.inf)
        degrees = np.where(by_group > 0.0, weight.sum(axis=0) ** 2 / by_group, 0.0)
    whole = blocks + degrees
    return (blocks * shown + degrees * total) / whole, whole


def dispersions(
    fit: BandedEstimate,
    parts: Sequence[Bool[np.ndarray, " b"]],
    groups: Sequence[Bool[np.ndarray, " b"]],
) -> list[Dispersion]:
    """Estimate the dispersion of each group of blocks by the parts in it, as `alike` has it.

    A part lies in one group.
    """
    influences = np.array([fit.influence[part].sum(axis=0) for part in parts])
    information = information_of_parts(fit, parts)
    own = [[bool(part[group].any()) for part in parts] for group in groups]
    return alike(
        [
            dispersion_of_parts(fit.estimate.covariance, information[one], influences[one])
            for one in own
        ]
    )


def alike(found: Sequence[Dispersion]) -> list[Dispersion]:
    """Draw dispersions to their mean, as far as they differ by no more than chance."""
    from scipy import special  # slow to import

    ratio, degrees = np.array([(one.ratio, one.degrees) for one in found]).T
    shown = (degrees >= FEWEST_DEGREES) & (ratio > 0.0)
    if len(found) < 2 or not shown.any():
        return list(found)
    # The logarithm of a mean square of f degrees of freedom has the variance trigamma(f / 2). One
    # that shows nothing is known as the others are alike.
    half = 0.5 * degrees[shown]
    logarithm, chance = np.zeros(len(found)), np.full(len(found), np.inf)
    # The logarithm of chi^2_f / f has the mean digamma(f / 2) - log(f / 2), below zero: taken off,
    # or few degrees of freedom would pull the common ratio down.
    logarithm[shown] = np.log(ratio[shown]) + np.log(half) - special.digamma(half)
    chance[shown] = special.polygamma(1, half)
    common = common_mean(logarithm[shown], chance[shown])
    drawn = [common.drawn(float(y), float(v)) for y, v in zip(logarithm, chance, strict=True)]
    return [Dispersion(ratio=float(np.exp(y)), degrees=degrees_of(v)) for y, v in drawn]


def degrees_of(variance: float, *, least: float = float(np.finfo(float).eps)) -> float:
    """Return the degrees of freedom of a variance, by the variance of its logarithm.

    `least`: variance of the logarithm below which it counts as no smaller.
    """
    # The solution of variance = trigamma(f / 2), about 2 / f + 2 / f^2.
    return float((1.0 + np.sqrt(1.0 + 2.0 * variance)) / max(variance, least))


@frozen_dataclass
class CommonMean:
    """The mean of one quantity over groups in which it differs.

    - `mean`, `variance`: of the groups, and of that mean.
    - `between`: variance of the true values about it.
    """

    mean: float
    variance: float
    between: float

    def drawn(self, value: float, variance: float) -> tuple[float, float]:
        """Draw the value of one group to the mean; return it, and its variance.

        `variance`: of the value by chance; infinite if the group shows nothing.
        """
        kept = self.between / (self.between + variance)
        lost = 1.0 - kept
        return (
            self.mean + kept * (value - self.mean),
            lost * self.between + lost**2 * self.variance,
        )


def common_mean(values: Float[np.ndarray, " g"], variances: Float[np.ndarray, " g"]) -> CommonMean:
    """Estimate the mean of groups, and how far they differ by more than chance, by moments.

    `variances`: of the values by chance, none zero. DerSimonian and Laird, Controlled Clinical
    Trials 7, 1986.
    """
    weight = 1.0 / variances
    mean = weight @ values / weight.sum()
    # Cochran's Q less what it is by chance alone.
    spare = float(weight @ (values - mean) ** 2) - (len(values) - 1.0)
    unit = float(weight.sum() - (weight**2).sum() / weight.sum())
    between = max(spare / unit, 0.0) if len(values) > 1 else 0.0
    total = 1.0 / (variances + between)
    return CommonMean(
        mean=float(total @ values / total.sum()),
        variance=1.0 / float(total.sum()),
        between=between,
    )


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
    # Sum of |Y_k Y_l|^2 over k != l, by the trace of (sum Y_k^2)^2 less the terms k = l.
    across = float((squares.sum(axis=0) ** 2).sum() - (squares**2).sum())
    spread = float((own**2).sum()) + max(across, 0.0)
    if not stated > LEAST * float(np.trace(Y, axis1=1, axis2=2).sum()):
        return Dispersion(ratio=1.0, degrees=0.0)
    shown = float((_whiten_influences(influences, root) ** 2).sum())
    return Dispersion(ratio=shown / stated, degrees=stated**2 / spread)


def _whiten_influences(
    influences: Float[np.ndarray, "p f"], root: Float[np.ndarray, "f f"]
) -> Float[np.ndarray, "p f"]:
    """Express moves of the parameters in deviations of independent directions."""
    size = np.linalg.norm(root, axis=1)
    size = np.where(size > 0.0, size, 1.0)
    white: Float[np.ndarray, "p f"] = (influences / size) @ np.linalg.pinv(root / size[:, None]).T
    return white
