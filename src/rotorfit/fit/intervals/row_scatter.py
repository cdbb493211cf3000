"""Half-widths of the row fits by chance, with the scatter of all rows pooled.

A row's own blocks show its variance to a factor of three where two or three of them decide; what
the model lacks shows in all rows (`estimation/dispersion.py`), as in all numbers of a joint fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.dispersion import Dispersion, dispersion_of_parts, pooled
from rotorfit.estimation.distributions import student_quantile
from rotorfit.estimation.effective_blocks import effective_count
from rotorfit.fit.intervals.numbers import FEWEST_PHASES
from rotorfit.fit.row_fits import ROWS, RowFits, block_diagonal

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from rotorfit.estimation.reweighted import BandedFit


def row_half_widths(fits: RowFits) -> Float[np.ndarray, " f"]:
    """Compute the half-width by chance of each parameter of the rows, in their order.

    The larger of the formal one and that of the scatter, each number's own and pooled.
    """
    free = _free_blocks(fits)
    stated = np.diagonal(fits.formal)
    blocks = len(fits.segment)
    own = np.diagonal(fits.covariance) * blocks / free
    formal = student_quantile(0.975, free) * np.sqrt(stated * blocks / free)
    degrees = np.minimum(_effective_blocks(fits), free)
    variance, degrees = pooled([_dispersion_of_rows(fits)], stated[None], own, degrees)
    found: Float[np.ndarray, " f"] = np.maximum(
        formal, student_quantile(0.975, degrees) * np.sqrt(variance)
    )
    return found


def _free_blocks(fits: RowFits) -> Float[np.ndarray, " f"]:
    """Count the free blocks behind each parameter: each of its row costs one."""
    blocks = len(fits.segment)
    counts = [len(fits.fits[row].estimate.names) for row in ROWS]
    return np.concatenate([np.full(n, float(max(blocks - n, 1))) for n in counts])


def _effective_blocks(fits: RowFits) -> Float[np.ndarray, " f"]:
    """Count the effective blocks of each parameter, by their shares of its formal variance."""
    return effective_count(
        np.concatenate([_variance_shares(fits.fits[row]) for row in ROWS], axis=1)
    )


def _variance_shares(fit: BandedFit) -> Float[np.ndarray, "b f"]:
    """Compute each block's share of the formal variances of a row."""
    C = fit.estimate.covariance
    shares: Float[np.ndarray, "b f"] = np.einsum("fi,bij,jf->bf", C, fit.information, C)
    return shares


def _dispersion_of_rows(fits: RowFits) -> Dispersion:
    """Estimate the dispersion of the four rows together, by phases or, of few, by blocks."""
    labels = np.unique(fits.segment)
    parts = [fits.segment == label for label in labels]
    if len(parts) < FEWEST_PHASES:
        parts = list(np.eye(len(fits.segment), dtype=bool))
    influence = np.concatenate([fits.fits[row].influence for row in ROWS], axis=1)
    return dispersion_of_parts(
        fits.formal,
        np.array([_sum_information(fits, own) for own in parts]),
        np.array([influence[own].sum(axis=0) for own in parts]),
    )


def _sum_information(fits: RowFits, own: Bool[np.ndarray, " b"]) -> Float[np.ndarray, "f f"]:
    """Sum the information of some blocks on the parameters of all rows."""
    return block_diagonal([fits.fits[row].information[own].sum(axis=0) for row in ROWS])
