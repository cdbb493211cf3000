"""Scatter of blocks as the jackknife sees it, by counting, and what is made of it."""

import numpy as np
import pytest

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import BandedProblem, banded, raised_to, shift_without
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.estimation.reweighted import scatter_covariance


@pytest.mark.parametrize("offset", [0.0, 3.0])
def test_of_a_mean_it_is_the_textbooks_covariance_of_the_mean(offset):
    """A block counted twice moves the mean of b by (x - mean) / b."""
    x = np.random.default_rng(0).normal(size=(9, 2)) @ np.array([[1.0, 0.5], [0.0, 2.0]])
    pulls = (x - x.mean(axis=0)) / 9 + offset  # what all share is no scatter
    np.testing.assert_allclose(scatter_covariance(pulls), np.cov(x.T) / 9, rtol=1e-12)


def test_it_is_the_variance_over_leave_one_block_out_estimates():
    """Of a slope through the origin, to first order: (b - 1) / b times the sum of squares."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 200, 50))
    xy, xx = (x * y).sum(axis=1), (x * x).sum(axis=1)
    slope = xy.sum() / xx.sum()
    left = np.array([np.delete(xy, i).sum() / np.delete(xx, i).sum() for i in range(200)])
    jackknife = 199 / 200 * ((left - left.mean()) ** 2).sum()
    pulls = ((xy - slope * xx) / xx.sum())[:, None]
    assert scatter_covariance(pulls)[0, 0] == pytest.approx(jackknife, rel=0.02)


def test_one_block_has_none():
    with pytest.raises(EstimationError, match="one block has no scatter"):
        scatter_covariance(np.ones((1, 2)))


def test_a_derivative_is_that_of_the_calculus():
    def function(at):
        return np.array([at[0] ** 2 * at[1], np.sin(at[1]), 3.0 * at[0]])

    found = numerical_jacobian(function, np.array([2.0, 0.5]), np.array([0.1, 0.0]))
    expected = [[2.0, 4.0], [0.0, np.cos(0.5)], [3.0, 0.0]]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def levels(means, *, rows=50, spread=0.2, seed=2):
    """Return the fit of one level to blocks whose own means are given, all of one variance.

    Every block has exactly `means` for a mean and `spread` for a deviation about the fit.
    """
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(len(means), rows))
    noise -= noise.mean(axis=1, keepdims=True)
    middle = np.mean(means)
    wanted = spread**2 - (np.asarray(means) - middle) ** 2
    noise *= np.sqrt(wanted / (noise**2).mean(axis=1))[:, None]
    y = noise + np.asarray(means)[:, None]
    tensor = np.zeros((2, 1, 2))
    tensor[0, 0, 0], tensor[1, 0, 1] = 1.0, -1.0
    factors = Factors(
        R=triangular_factors(np.stack([y, np.ones_like(y)], axis=2)),
        rows=np.full(len(y), rows),
        segment=np.arange(len(y)),
        band=np.tile([0.0, 1.0], (len(y), 1)),
    )
    problem = BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("y", "level"), {"level": {(0, "level"): 1.0}}, {(0, "y"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
    )
    return banded(problem, np.array([middle + 0.01]))


def test_the_shift_without_a_part_is_that_of_the_mean():
    """Means 0.1, -0.1, 0.05, -0.05 stay, 0.14, 0.02, -0.1, -0.06 go; all weigh the same.

    A block that stays has 1/4 - 1/8 more of a say than before, one that goes 1/8 less.
    """
    stay, go = np.array([0.1, -0.1, 0.05, -0.05]), np.array([0.14, 0.02, -0.1, -0.06])
    shift = shift_without(levels([*stay, *go]), np.arange(8) >= 4)
    assert shift.values[0] == pytest.approx(stay.mean() - np.mean([*stay, *go]), abs=1e-4)
    scatter = (stay.var(ddof=1) + go.var(ddof=1)) * 4 / 8**2
    assert shift.std[0] == pytest.approx(np.sqrt(scatter), rel=0.01)


def test_the_shift_scatters_no_less_than_the_blocks_noise():
    """All means alike: 0.2^2 / 200 of the rest less 0.2^2 / 400 of all."""
    shift = shift_without(levels([0.01, -0.01] * 4), np.arange(8) >= 4)
    assert shift.std[0] == pytest.approx(0.2 * np.sqrt(1 / 200 - 1 / 400), rel=1e-3)


def test_a_covariance_is_stretched_to_the_variances_of_its_floor():
    found = raised_to(np.array([[4.0, 1.0], [1.0, 1.0]]), np.diag([1.0, 9.0]))
    np.testing.assert_allclose(found, [[4.0, 3.0], [3.0, 9.0]])
