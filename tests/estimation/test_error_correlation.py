"""Errors that come with others: what they share is taken off, as generalised least squares does."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.estimation.banded import BandedProblem, banded
from rotorfit.estimation.error_correlation import error_correlation_shifts
from rotorfit.estimation.factors import time_block_factors
from rotorfit.estimation.parameter_map import parameter_map

SHARE = 0.8
ROWS = 400


def two_lines(seed, *, heard=0.0):
    """Two lines y = a x + v and y' = b x' + SHARE v + w as rows, and as a problem.

    `heard`: how much of v is in x'.
    """
    rng = np.random.default_rng(seed)
    x, other, v, w = rng.normal(size=(4, ROWS))
    w *= 0.1
    other += heard * v
    rows = np.column_stack([2.0 * x + v, 3.0 * other + SHARE * v + w, x, other])
    tensor = np.zeros((3, 2, 4))
    tensor[0, [0, 1], [0, 1]] = 1.0
    tensor[1, 0, 2] = tensor[2, 1, 3] = -1.0
    free = {"a": {(0, "a"): 1.0}, "b": {(0, "b"): 1.0}}
    problem = BandedProblem(
        factors=(time_block_factors(rows, block_rows=ROWS),),
        tensors=(tensor,),
        map=parameter_map(("y", "a", "b"), free, {(0, "y"): 1.0}),
        noisy=(0, 1),
        prior_mean={},
        prior_std={},
    )
    return rows, problem


def tied(problem, share=SHARE, *, std=np.inf):
    tie = np.array([[0.0, 0.0], [share, 0.0]])
    return replace(problem, error_correlation=(tie,), error_correlation_std=(std,))


def test_values_and_deviations_are_generalised_least_squares():
    rows, problem = two_lines(1)
    fit = banded(tied(problem), np.zeros(2))
    X = np.zeros((2, ROWS, 2))
    X[0, :, 0], X[1, :, 1] = rows[:, 2], rows[:, 3]
    e = rows[:, :2].T - X @ fit.estimate.values
    apart = np.array([[1.0, 0.0], [-SHARE, 1.0]])
    S = np.linalg.inv(apart.T @ np.diag(ROWS / ((apart @ e) ** 2).sum(axis=1)) @ apart)
    P = np.linalg.inv(S)
    information = np.einsum("inp,ij,jnq->pq", X, P, X)
    expected = np.linalg.solve(information, np.einsum("inp,ij,jn->p", X, P, rows[:, :2].T))
    np.testing.assert_allclose(fit.estimate.values, expected, rtol=1e-5)
    np.testing.assert_allclose(fit.estimate.covariance, np.linalg.inv(information), rtol=1e-3)


@pytest.mark.parametrize("share", [0.0, SHARE])
def test_what_is_shared_no_longer_hides_the_rest(share):
    """Without it the second slope is as uncertain as the first; with it, by its own error alone."""
    found = np.array(
        [
            (fit.estimate.value("b") - 3.0, fit.estimate.std[1])
            for fit in (banded(tied(two_lines(seed)[1], share), np.zeros(2)) for seed in range(60))
        ]
    )
    spread = float(np.sqrt((found[:, 0] ** 2).mean()))
    assert spread == pytest.approx((0.1 if share else 0.81) / ROWS**0.5, rel=0.25)
    assert found[:, 1].mean() == pytest.approx(spread, rel=0.25)


@pytest.mark.parametrize("std", [np.inf, 0.01])
@pytest.mark.parametrize("heard", [0.0, 2.0])
def test_an_estimated_share_widens_as_one_parameter_more_does(heard, std):
    rows, problem = two_lines(2, heard=heard)
    fit = banded(tied(problem, std=std), np.zeros(2))
    a, b = fit.estimate.values
    y, line, x, other = rows.T
    e = np.array([y - a * x, line - b * other - SHARE * (y - a * x)])
    slopes = np.zeros((2, ROWS, 3))
    slopes[0, :, 0], slopes[1, :, 0] = x, -SHARE * x
    slopes[1, :, 1], slopes[1, :, 2] = other, e[0]
    variance = (e**2).mean(axis=1)
    information = np.einsum("inp,inq,i->pq", slopes, slopes, 1.0 / variance)
    information[2, 2] += std**-2.0
    more = np.linalg.inv(information)[:2, :2] - np.linalg.inv(information[:2, :2])
    shifts = error_correlation_shifts(fit)
    np.testing.assert_allclose(shifts.T @ shifts, more, rtol=1e-3, atol=1e-4 * more[1, 1])
    if heard and np.isinf(std):  # then the share is half of what is open of the second slope
        assert more[1, 1] > fit.estimate.covariance[1, 1]


def test_without_ties_nothing_is_open():
    fit = banded(two_lines(3)[1], np.zeros(2))
    assert error_correlation_shifts(fit).shape == (0, 2)
    assert error_correlation_shifts(banded(tied(two_lines(3)[1], 0.0), np.zeros(2))).shape == (0, 2)
