"""Intervals of a least-squares fit whose residuals are correlated: one block of time left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from rotorfit.estimation.distributions import student_quantile

FEWEST_BLOCKS: Final = 8
"""Fewest blocks: with fewer, the scatter between them is hardly known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jackknife:
    """What leaving out one block after the other does.

    - `shifts`: of the parameters, one row per block.
    - `held_out`: residuals of each block under the fit to all others, squared and summed.
    """

    shifts: Float[np.ndarray, "B p"]
    held_out: Float[np.ndarray, " B"]

    def half_width(self, gradient: Float[np.ndarray, " p"]) -> float:
        """Compute half of the 95 % interval of a linear function of the parameters."""
        blocks = len(self.shifts)
        moved = self.shifts @ gradient
        std = np.sqrt((blocks - 1) / blocks * float(moved @ moved))
        return float(student_quantile(0.975, blocks - 1) * std)


def jackknife(
    slopes: Float[np.ndarray, "m p"],
    residuals: Float[np.ndarray, " m"],
    block: Int[np.ndarray, " m"],
) -> Jackknife:
    r"""Compute the jackknife of a least-squares fit (slopes J, residuals e) over blocks of rows.

    With G = J'J and, of one block, G_b and s_b = J_b' e_b, the fit to all other blocks is off by
    :math:`-(G - G_b)^{-1} s_b`, to first order, and the residuals of the block under that fit are
    :math:`e_b + J_b (G - G_b)^{-1} s_b`. The scatter of the former is the estimator CR3 of the
    covariance, which holds for any correlation within a block, and errs to the wide side where
    blocks are few or unlike (Bell and McCaffrey, Survey Methodology 28(2), 2002; MacKinnon,
    Nielsen and Webb, J. of Applied Econometrics 38(5), 2023).
    """
    size = np.sqrt((slopes * slopes).sum(axis=0))
    J = slopes / np.where(size > 0.0, size, 1.0)
    order = np.argsort(block, kind="stable")
    J, e, edges = J[order], residuals[order], np.flatnonzero(np.diff(block[order])) + 1
    parts = list(zip(np.split(J, edges), np.split(e, edges), strict=True))
    G = J.T @ J
    scores = np.array([J_b.T @ e_b for J_b, e_b in parts])
    rest = G - np.array([J_b.T @ J_b for J_b, _ in parts])
    without = np.linalg.pinv(rest, hermitian=True, rcond=1e-10)
    shifts = -(without @ scores[:, :, None])[:, :, 0]
    left = [e_b - J_b @ shift for (J_b, e_b), shift in zip(parts, shifts, strict=True)]
    held_out = np.array([e_b @ e_b for e_b in left])
    return Jackknife(shifts=shifts / np.where(size > 0.0, size, np.inf), held_out=held_out)


def blocks_of(
    flight: Int[np.ndarray, " m"], time: Float[np.ndarray, " m"], seconds: float
) -> Int[np.ndarray, " m"]:
    """Assign the rows to equal blocks of each flight's time; a short rest joins the last."""
    block = np.zeros(len(time), dtype=int)
    first = 0
    for k in range(int(flight.max()) + 1):
        rows = flight == k
        since: Float[np.ndarray, " k"] = time[rows] - float(time[rows].min())
        last = max(round(float(since.max()) / seconds) - 1, 0)
        number: Int[np.ndarray, " k"] = np.minimum((since / seconds).astype(int), last)
        found = np.searchsorted(np.unique(number), number)
        block[rows] = first + found
        first = int(block[rows].max()) + 1
    return block


def widest(jackknives: Sequence[Jackknife], gradient: Float[np.ndarray, " p"]) -> float:
    """Return the largest half-width over several lengths of blocks.

    Correlation that outlasts a block shows as more scatter between longer ones.
    """
    return max((one.half_width(gradient) for one in jackknives), default=float("inf"))
