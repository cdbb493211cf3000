"""Intervals of a least-squares fit whose residuals are correlated: one block of time left out."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import student_quantile
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float, Int

FEWEST_BLOCKS: Final = 8
"""Fewest blocks: with fewer, the scatter between them is hardly known."""


@frozen_dataclass
class BlockSums:
    """What a jackknife needs of slopes J and residuals e: sums over each block of rows.

    - `information`: J'J.
    - `score`: J'e.
    - `squares`: e'e.
    - `counts`: rows of each block.
    """

    information: Float[np.ndarray, "B p p"]
    score: Float[np.ndarray, "B p"]
    squares: Float[np.ndarray, " B"]
    counts: Int[np.ndarray, " B"]

    def joined(self, block: Int[np.ndarray, " B"]) -> BlockSums:
        """Add up the blocks that have the same number in `block`, which rises."""
        first = np.searchsorted(block, np.unique(block))
        return BlockSums(
            information=np.add.reduceat(self.information, first, axis=0),
            score=np.add.reduceat(self.score, first, axis=0),
            squares=np.add.reduceat(self.squares, first),
            counts=np.add.reduceat(self.counts, first),
        )


@frozen_dataclass
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


def sum_blocks(
    slopes: Float[np.ndarray, "p m"],
    residuals: Float[np.ndarray, " m"],
    block: Int[np.ndarray, " m"],
    *,
    count: int,
) -> BlockSums:
    """Sum products of slopes and residuals over the rows of each of `count` blocks."""
    order = np.argsort(block, kind="stable")
    rows = np.vstack([slopes, residuals])[:, order]
    counts = np.bincount(block, minlength=count)
    edges = [0, *np.cumsum(counts).tolist()]
    sums = np.empty((len(counts), len(rows), len(rows)))
    for b, (begin, end) in enumerate(pairwise(edges)):
        part = rows[:, begin:end]
        np.matmul(part, part.T, out=sums[b])
    return BlockSums(
        information=sums[:, :-1, :-1],
        score=sums[:, :-1, -1],
        squares=sums[:, -1, -1],
        counts=counts,
    )


def jackknife(sums: BlockSums) -> Jackknife:
    """Compute the jackknife of a least-squares fit (slopes J, residuals e) over blocks of rows."""
    G = sums.information.sum(axis=0)
    size = np.sqrt(np.diagonal(G))
    unit = np.where(size > 0.0, size, 1.0)
    G_b, scores = sums.information / np.outer(unit, unit), sums.score / unit
    rest: Float[np.ndarray, "B p p"] = G / np.outer(unit, unit) - G_b
    # Without a block a parameter may be unknown: the pseudo-inverse leaves it where it is.
    # By G = J'J and, of one block, G_b and s_b = J_b' e_b, d_b = -(G - G_b)^-1 s_b to first order,
    # and the residuals of the block under that fit are e_b - J_b d_b. The scatter of the shifts is
    # the estimator CR3, which holds for any correlation within a block, and errs to the wide side
    # where blocks are few or unlike (Bell and McCaffrey, Survey Methodology 28(2), 2002; MacKinnon,
    # Nielsen and Webb, J. of Applied Econometrics 38(5), 2023).
    without = np.asarray(np.linalg.pinv(rest, hermitian=True, rcond=1e-10), dtype=float)
    shifts: Float[np.ndarray, "B p"] = -(without @ scores[:, :, None])[:, :, 0]
    # |e_b - J_b d_b|^2 = |e_b|^2 - 2 s_b d_b + d_b G_b d_b.
    spread: Float[np.ndarray, " B"] = ((G_b @ shifts[:, :, None])[:, :, 0] * shifts).sum(axis=1)
    held_out = np.maximum(sums.squares - 2.0 * (scores * shifts).sum(axis=1) + spread, 0.0)
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
        # Blocks of twice the length hold two whole ones each, so that their sums add up.
        number: Int[np.ndarray, " k"] = np.minimum((since / seconds).astype(int), last)
        found = np.searchsorted(np.unique(number), number)
        block[rows] = first + found
        first = int(block[rows].max()) + 1
    return block


def widest(jackknives: Sequence[Jackknife], gradient: Float[np.ndarray, " p"]) -> float:
    """Return the largest half-width over several lengths of blocks."""
    # Correlation that outlasts a block shows as more scatter between longer ones.
    return max((one.half_width(gradient) for one in jackknives), default=float("inf"))
