"""Half-widths of the row fits: the scatter of all rows counts for each."""

import numpy as np
import pytest
from scipy import stats

from rotorfit.estimation.estimate import Estimate
from rotorfit.estimation.reweighted import BandedFit
from rotorfit.fit.intervals.row_scatter import row_half_widths
from rotorfit.fit.row_fits import ROWS, RowFits

BLOCKS = 20
STD = BLOCKS**-0.5
"""Of one parameter of which each block has the information of one."""


def fits(moves, *, segment=None):
    """Return fits of one parameter each, which blocks move to and fro by so much."""
    signs = np.where(np.arange(BLOCKS) % 2, 1.0, -1.0)
    made = {
        row: BandedFit(
            estimate=Estimate(
                names=("k",), values=np.ones(1), covariance=np.eye(1) * STD**2, condition_number=1.0
            ),
            influence=(move * signs)[:, None],
            variance=np.ones(BLOCKS),
            known_power=np.ones(BLOCKS),
            residual_power=np.ones(BLOCKS),
            log_likelihood=0.0,
            information=np.ones((BLOCKS, 1, 1)),
        )
        for row, move in zip(ROWS, moves, strict=True)
    }
    spread = np.array(moves) ** 2 * BLOCKS * BLOCKS / (BLOCKS - 1.0)
    return RowFits(
        fits=made,
        excitation={},
        covariance=np.diag(spread),
        formal=np.eye(4) * STD**2,
        segment=np.zeros(BLOCKS, dtype=int) if segment is None else segment,
    )


def test_a_row_that_is_still_by_luck_scatters_as_the_others():
    """As stated a block moves its row by .049; the last row's stand still, the others' by twice."""
    stated = STD**2 * (1.0 - 1.0 / BLOCKS) ** 0.5
    widths = row_half_widths(fits([2 * stated] * 3 + [0.0]))
    ratio = 3 * BLOCKS * 4 * stated**2 / STD**2 / (4 * (1.0 - 1.0 / BLOCKS))
    assert ratio == pytest.approx(3.0)
    pooled = 4.0 * (BLOCKS - 1)  # degrees of freedom: of 20 equal blocks 19 a row
    degrees = BLOCKS - 1 + pooled
    variance = pooled * ratio * STD**2 / degrees
    assert widths[3] == pytest.approx(stats.t.ppf(0.975, degrees) * variance**0.5, rel=1e-9)
    assert widths[0] > widths[3] > 1.4 * stats.t.ppf(0.975, BLOCKS - 1) * STD


def test_of_blocks_as_stated_the_formal_width_is_left():
    widths = row_half_widths(fits([STD**2 * (1.0 - 1.0 / BLOCKS) ** 0.5] * 4))
    formal = stats.t.ppf(0.975, BLOCKS - 1) * STD * (BLOCKS / (BLOCKS - 1)) ** 0.5
    assert widths == pytest.approx(np.full(4, formal), rel=0.03)


def test_of_several_phases_their_scatter_counts():
    """Blocks that undo each other within a phase are no scatter of phases."""
    widths = row_half_widths(fits([0.2] * 4, segment=np.repeat(np.arange(5), 4)))
    own = 0.2**2 * BLOCKS * BLOCKS / (BLOCKS - 1.0) * BLOCKS / (BLOCKS - 1.0)
    degrees = BLOCKS - 1.0 + 4 * (5 - 1)  # of the row's blocks, and of the rows' phases
    expected = stats.t.ppf(0.975, degrees) * (own * (BLOCKS - 1.0) / degrees) ** 0.5
    assert widths == pytest.approx(np.full(4, expected), rel=1e-9)
