"""How many blocks stand behind a number: by hand, on lines through the origin."""

import numpy as np
import pytest

from rotorfit.estimation.banded import BandedProblem, banded
from rotorfit.estimation.effective_blocks import effective_blocks, variance_shares
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.parameter_map import parameter_map


def two_slopes(size_x, size_w, *, rows=40):
    """Fit y = a x + b w to blocks in which x and w are of these sizes; return fit and blocks."""
    rng = np.random.default_rng(5)
    count = len(size_x)
    x = np.array(size_x)[:, None] * rng.normal(size=(count, rows))
    w = np.array(size_w)[:, None] * rng.normal(size=(count, rows))
    Z = np.stack([2.0 * x - w + rng.normal(size=x.shape), x, w], axis=2)
    factors = Factors(
        R=triangular_factors(Z),
        rows=np.full(count, rows),
        segment=np.arange(count),
        band=np.tile([0.0, 1.0], (count, 1)),
    )
    tensor = np.zeros((3, 1, 3))
    tensor[0, 0, 0], tensor[1, 0, 1], tensor[2, 0, 2] = 1.0, -1.0, -1.0
    free = {"a": {(0, "x"): 1.0}, "b": {(0, "w"): 1.0}}
    problem = BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("y", "x", "w"), free, {(0, "y"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
    )
    return banded(problem, np.array([1.0, 0.0])), x, w


def test_shares_are_gradient_covariance_information():
    fit, x, w = two_slopes([1.0, 2.0, 4.0, 1.0], [3.0, 1.0, 1.0, 2.0])
    J = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, -3.0]])
    found = variance_shares(fit, J)
    for b, v in enumerate(fit.variance[:, 0]):
        X = np.column_stack([x[b], w[b]])
        g = fit.estimate.covariance @ J.T
        np.testing.assert_allclose(found[b], np.diagonal(g.T @ X.T @ X @ g) / v, rtol=1e-9)
    total = np.diagonal(J @ fit.estimate.covariance @ J.T)
    np.testing.assert_allclose(found.sum(axis=0), total, rtol=1e-6)


@pytest.mark.parametrize(("sizes", "expected"), [([1.0] * 8, 8.0), ([30.0, *[1.0] * 7], 1.0)])
def test_one_lively_block_of_many_counts_as_one(sizes, expected):
    """Each number has its own count: b comes from all blocks, a from the lively one."""
    fit, *_ = two_slopes(sizes, [1.0] * 8)
    a, b = effective_blocks(fit, np.eye(2))
    assert a == pytest.approx(expected, rel=0.15)
    assert 5.0 < b <= 8.0


def test_what_no_block_shows_has_all_of_them():
    fit, *_ = two_slopes([1.0] * 5, [1.0] * 5)
    assert effective_blocks(fit, np.zeros((1, 2)))[0] == 5.0
