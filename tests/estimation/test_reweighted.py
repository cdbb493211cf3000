"""Bands weighed by their own residuals: the point where weights and estimate agree, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from plain_problem import plain_problem

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import (
    Factors,
    borrowed_mean_square,
    borrowed_rows,
    triangular_factors,
)
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.estimation.reweighted import reweighted

ROWS, BLOCKS = 100, 6
LOUD = np.array([0.1, 0.2, 0.4, 0.1, 0.8, 0.3])


def line(seed=0):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=BLOCKS * ROWS)
    return x, 2.0 * x + np.repeat(LOUD, ROWS) * rng.normal(size=len(x))


def separated(problem):
    """Return the problem with every block a segment of its own, so that none borrows."""
    factors = replace(problem.factors[0], segment=np.arange(len(problem.factors[0])))
    return replace(problem, factors=(factors,))


def by_blocks(x, y, slope):
    x, y = x.reshape(BLOCKS, ROWS), y.reshape(BLOCKS, ROWS)
    return (x * y).sum(axis=1), (x * x).sum(axis=1), ((y - slope * x) ** 2).mean(axis=1)


@pytest.mark.parametrize("std", [None, 0.005])
def test_weights_are_the_inverse_of_each_blocks_mean_square(std):
    """And a prior about zero is one equation more."""
    x, y = line()
    problem = separated(plain_problem(x[:, None], y, block_rows=ROWS))
    fit = reweighted(problem, prior_std={} if std is None else {"p0": std})
    slope = float(fit.estimate.values[0])
    xy, xx, v = by_blocks(x, y, slope)
    information = (xx / v).sum() + (0.0 if std is None else std**-2.0)
    assert slope == pytest.approx((xy / v).sum() / information, abs=0.02 / information**0.5)
    np.testing.assert_allclose(fit.variance, v, rtol=1e-9)
    np.testing.assert_allclose(fit.estimate.covariance, 1.0 / information, rtol=1e-2)
    expected = (xy - slope * xx) / v / information
    np.testing.assert_allclose(fit.influence[:, 0], expected, rtol=1e-2)
    assert fit.log_likelihood == pytest.approx(-0.5 * ROWS * np.log(v).sum())
    np.testing.assert_allclose(fit.known_power, (y.reshape(BLOCKS, ROWS) ** 2).sum(axis=1))
    np.testing.assert_allclose(fit.residual_power, v * ROWS)


def test_a_variance_is_that_of_one_of_several_equations():
    """Three equations y_j = slope x in the same rows: their squares are over three times n."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(4, 60))
    y = 2.0 * x[:, :, None] + 0.3 * rng.normal(size=(4, 60, 3))
    tensor = np.zeros((2, 3, 4))
    tensor[0, :, 3] = 1.0
    tensor[1, range(3), range(3)] = -1.0
    factors = Factors(
        R=triangular_factors(np.concatenate([y, x[:, :, None]], axis=2)),
        rows=np.full(4, 60),
        segment=np.arange(4),
        band=np.tile([0.0, 1.0], (4, 1)),
    )
    mapped = ParameterMap(names=("slope",), constant=np.eye(2)[1:], matrix=np.eye(2)[None, :, :1])
    problem = LinearProblem(
        factors=(factors,), tensors=(tensor,), map=mapped, weights=np.ones((1, 3))
    )
    fit = reweighted(problem)
    residual = y - fit.estimate.values[0] * x[:, :, None]
    np.testing.assert_allclose(fit.variance, (residual**2).mean(axis=(1, 2)), rtol=1e-9)
    expected = -0.5 * 180 * np.log(fit.variance).sum()
    assert fit.log_likelihood == pytest.approx(expected)


def test_exact_equations_have_next_to_no_variance():
    x = np.random.default_rng(2).normal(size=200)
    fit = reweighted(separated(plain_problem(x[:, None], 2.0 * x, block_rows=100)))
    np.testing.assert_allclose(fit.variance, 1e-20 * 4.0 * (x**2).mean(), rtol=1e-9)


def test_a_signal_that_is_zero_throughout_is_refused():
    x = np.random.default_rng(3).normal(size=200)
    with pytest.raises(EstimationError, match="no turn at all"):
        reweighted(plain_problem(x[:, None], np.zeros(200), block_rows=100))


def three_blocks(rows, segment=(0, 0, 0)):
    return Factors(
        R=np.tile(np.eye(2), (3, 1, 1)),
        rows=np.array(rows),
        segment=np.array(segment),
        band=np.tile([0.0, 1.0], (3, 1)),
    )


def mean_squares(rows, power, segment=(0, 0, 0)):
    factors = three_blocks(rows, segment)
    return borrowed_mean_square(np.array(power)[:, None], factors)[:, 0].tolist()


def test_bands_under_28_rows_borrow_half_of_their_neighbours():
    full = [90.0 / 30, 10.0 / 28, 160.0 / 40]
    assert mean_squares([30, 28, 40], [90.0, 10.0, 160.0]) == pytest.approx(full)
    few = mean_squares([30, 27, 40], [90.0, 10.0, 160.0])
    assert few == pytest.approx([full[0], (10.0 + 45.0 + 80.0) / (27 + 15 + 20), full[2]])
    apart = mean_squares([30, 27, 40], [90.0, 10.0, 160.0], (0, 1, 1))
    assert apart == pytest.approx([full[0], (10.0 + 80.0) / (27 + 20), full[2]])


def test_rows_of_what_is_borrowed_count_half():
    assert borrowed_rows(three_blocks([30, 27, 40])).tolist() == [30.0, 27.0 + 15.0 + 20.0, 40.0]
    assert borrowed_rows(three_blocks([1, 9, 40])).tolist() == [1.0 + 4.5, 9.0 + 0.5 + 20.0, 40.0]
