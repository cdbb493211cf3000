"""Ordinary least squares: certified data, textbook covariances, invariances."""

import dataclasses

import nist
import numpy as np
import pytest
from benchmarks.accuracy.rivals import block_covariance, block_scores
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_problem import dense_rows, plain_problem, wrench_problem
from scipy.optimize import nnls

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import problem_rows
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.least_squares import nonnegative_solution, ordinary

SEEDS = st.integers(0, 2**32 - 1)


def digits(values, certified):
    """Return NIST's LRE: the number of correct digits of the worst value, at most 15."""
    error = np.abs(np.asarray(values) / np.asarray(certified) - 1.0).max()
    return -np.log10(max(error, 1e-15))


@pytest.mark.parametrize("block_rows", [5, 12, 36])
def test_norris(block_rows):
    y, x = nist.NORRIS.T
    e = ordinary(plain_problem(np.column_stack([np.ones(36), x]), y, block_rows=block_rows))
    assert digits(e.values, nist.NORRIS_VALUES) > 11
    assert digits(e.std, nist.NORRIS_STD) > 10
    residual = y - e.values[0] - e.values[1] * x
    assert digits(np.sqrt(residual @ residual / 34), nist.NORRIS_RESIDUAL_STD) > 12


def test_line_through_the_origin_of_nist():
    y, x = nist.NOINT1.T
    e = ordinary(plain_problem(x[:, None], y))
    assert digits(e.values, nist.NOINT1_VALUE) > 13
    assert digits(e.std, nist.NOINT1_STD) > 12


@pytest.mark.parametrize("block_rows", [5, 10, 21])
def test_wampler_polynomials(block_rows):
    # One ulp of the largest y moves the constant of Wampler1 by 1e-9: no method has more digits.
    X = np.vander(nist.WAMPLER_X, 6, increasing=True)
    first = ordinary(plain_problem(X, nist.WAMPLER1_Y, block_rows=block_rows))
    assert digits(first.values, nist.WAMPLER1_VALUES) > 8.5
    second = ordinary(plain_problem(X, nist.WAMPLER2_Y, block_rows=block_rows))
    assert digits(second.values, nist.WAMPLER2_VALUES) > 12


def test_the_pair_of_total_least_squares_by_ordinary_ones():
    e = ordinary(plain_problem(np.array([[1.0], [2.0], [3.0], [4.0]]), [2.01, 3.99, 5.80, 8.30]))
    assert e.values[0] == pytest.approx(2.0196667, abs=5e-8)


def noisy(seed, n=200, f=4, noise=0.3):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, f)) * 10.0 ** rng.uniform(-4, 4, f)
    y = A @ (rng.normal(size=f) / np.abs(A).max(axis=0)) + noise * rng.normal(size=n)
    return A, y


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_values_and_covariance_are_the_textbooks(seed):
    A, y = noisy(seed)
    e = ordinary(plain_problem(A, y))
    scale = np.linalg.norm(A, axis=0)
    expected, rss, *_ = np.linalg.lstsq(A / scale, y)
    np.testing.assert_allclose(e.values * scale, expected, rtol=1e-9, atol=1e-11)
    inverse = np.linalg.inv((A / scale).T @ (A / scale)) / np.outer(scale, scale)
    np.testing.assert_allclose(e.covariance, rss[0] / (200 - 4) * inverse, rtol=1e-9)
    assert e.condition_number == pytest.approx(np.linalg.cond(A / scale), rel=1e-9)


def coloured(rng, n, memory):
    """Return errors of unit variance, correlated over `memory` samples."""
    a = np.exp(-1.0 / memory)
    e = np.empty(n)
    e[0] = rng.normal()
    for i, kick in enumerate(np.sqrt(1 - a * a) * rng.normal(size=n - 1)):
        e[i + 1] = a * e[i] + kick
    return e


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_block_covariance_is_the_sandwich(seed):
    A, y = noisy(seed, n=230)
    plain = ordinary(plain_problem(A, y, block_rows=30))
    e = block_covariance(plain_problem(A, y, block_rows=30), plain)
    residual = y - A @ plain.values
    scale = np.linalg.norm(A, axis=0)
    S = A / scale
    bread = np.linalg.inv(S.T @ S)
    meat = np.zeros((4, 4))
    for start in range(0, 230, 30):
        g = S[start : start + 30].T @ residual[start : start + 30]
        meat += np.outer(g, g)
    expected = bread @ meat @ bread * 8 / 7 / np.outer(scale, scale)
    size = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    np.testing.assert_allclose(e.covariance / size, expected / size, atol=1e-9)
    np.testing.assert_array_equal(e.values, plain.values)


def test_block_scores_add_up_to_the_gradient_and_the_information():
    A, y = noisy(5)
    phi = np.zeros(4)
    scores, information = block_scores(plain_problem(A, y, block_rows=30), phi)
    np.testing.assert_allclose(scores.sum(axis=0), -A.T @ y, rtol=1e-10)
    size = np.linalg.norm(A, axis=0)
    np.testing.assert_allclose(
        information.sum(axis=0) / np.outer(size, size),
        A.T @ A / np.outer(size, size),
        atol=1e-13,
    )


def test_only_block_covariance_covers_coloured_errors():
    rng = np.random.default_rng(20)
    truth = np.array([2.0, -1.0])
    hits = np.zeros((2, 2))
    runs, n = 200, 2000
    for _ in range(runs):
        A = np.column_stack([np.ones(n), coloured(rng, n, 10.0)])
        problem = plain_problem(A, A @ truth + coloured(rng, n, 10.0), block_rows=50)
        plain = ordinary(problem)
        for k, e in enumerate((plain, block_covariance(problem, plain))):
            hits[k] += np.abs(e.values - truth) < 1.96 * e.std
    naive, robust = hits / runs
    assert (naive < 0.75).all()
    assert (robust > 0.88).all()
    assert (robust < 0.99).all()


def test_one_block_has_no_scatter():
    problem = plain_problem(*noisy(0, n=40), block_rows=40)
    with pytest.raises(EstimationError, match="at least two blocks"):
        block_covariance(problem, ordinary(problem))


def doubled(problem):
    factors = tuple(stack_factors([part, part]) for part in problem.factors)
    return dataclasses.replace(problem, factors=factors)


def test_the_same_data_twice_halve_the_covariance():
    problem = plain_problem(*noisy(1, n=400))
    once, twice = ordinary(problem), ordinary(doubled(problem))
    np.testing.assert_allclose(twice.values, once.values, rtol=1e-11)
    np.testing.assert_allclose(
        twice.covariance, once.covariance * (400 - 4) / (800 - 4), rtol=1e-10
    )
    blocks = block_covariance(problem, once), block_covariance(doubled(problem), twice)
    np.testing.assert_allclose(
        blocks[1].covariance, blocks[0].covariance / 2 * (16 / 15) / (8 / 7), rtol=1e-8
    )


def wrench(seed, n=300):
    """Return signals and a tensor of two equations that nearly hold, in SI-like sizes."""
    rng = np.random.default_rng(seed)
    tensor = rng.normal(size=(5, 2, 9))
    truth = np.array([3e-6, 5e-8, 0.02, -0.004, 1.3])
    tensor[0] *= 3e5
    tensor[1] *= 3e5
    B = np.einsum("p,pjz->jz", truth, tensor)
    Z = rng.normal(size=(n, 9))
    Z -= Z @ np.linalg.pinv(B) @ B
    return Z + 0.02 * rng.normal(size=Z.shape), tensor, truth


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_weighted_wrench_equations_are_the_dense_ones(seed):
    Z, tensor, truth = wrench(seed)
    weights = np.random.default_rng(seed).uniform(0.1, 30.0, 2)
    dense = dense_rows(Z, tensor, truth[-1], weights)
    e = ordinary(wrench_problem(Z, tensor, truth[-1], weights=weights))
    scale = np.linalg.norm(dense, axis=0)
    expected = np.linalg.lstsq(dense[:, :-1] / scale[:-1], -dense[:, -1])[0] / scale[:-1]
    size = np.sqrt(np.diagonal(e.covariance))
    np.testing.assert_allclose(e.values / size, expected / size, rtol=1e-9, atol=1e-8)


def test_units_of_parameters_and_signals_do_not_matter():
    """Millimetres, grams and rpm for metres, kilograms and rad/s."""
    Z, tensor, truth = wrench(3)
    SI = ordinary(wrench_problem(Z, tensor, truth[-1], weights=[1.0, 1.0]))
    per_parameter = np.array([1e3 * (np.pi / 30) ** 2, 1e6 * (np.pi / 30) ** 2, 1e6, 1e9, 1e3])
    per_signal = np.array([1e3] * 3 + [30 / np.pi] * 3 + [1.0] * 3)
    other = ordinary(
        wrench_problem(
            Z * per_signal,
            tensor / per_parameter[:, None, None] / per_signal,
            truth[-1] * per_parameter[-1],
            weights=[1.0, 1.0],
        )
    )
    np.testing.assert_allclose(other.values, SI.values * per_parameter[:-1], rtol=1e-10)
    np.testing.assert_allclose(other.std, SI.std * per_parameter[:-1], rtol=1e-10)
    assert other.condition_number == pytest.approx(SI.condition_number, rel=1e-10)


def test_scaling_every_weight_leaves_values_and_covariance():
    Z, tensor, truth = wrench(4)
    one = ordinary(wrench_problem(Z, tensor, truth[-1], weights=[1.0, 5.0]))
    other = ordinary(wrench_problem(Z, tensor, truth[-1], weights=[1e4, 5e4]))
    np.testing.assert_allclose(other.values, one.values, rtol=1e-11)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-9)


def test_an_equation_without_weight_is_not_there():
    Z, tensor, truth = wrench(5)
    problem = wrench_problem(Z, tensor, truth[-1], weights=[0.0, 2.0])
    alone = wrench_problem(Z, tensor[:, 1:], truth[-1], weights=[2.0])
    assert problem.rows == alone.rows == 300
    np.testing.assert_array_equal(problem_rows(problem), problem_rows(alone))


def test_a_parameter_that_nothing_moves_is_named():
    A, y = noisy(7)
    A[:, 2] = 0.0
    with pytest.raises(EstimationError, match="does not move Izz at all"):
        ordinary(plain_problem(A, y, names=["kt", "kd", "Izz", "msz"]))


def test_a_combination_that_the_equations_leave_free_is_named():
    A, y = noisy(8)
    A[:, 3] = A[:, 1] * 1e5
    with pytest.raises(EstimationError, match=r"free \(most of it (kd|msz)\)"):
        ordinary(plain_problem(A, y, names=["kt", "kd", "Izz", "msz"]))


def test_fewer_rows_than_parameters_are_refused():
    A, y = noisy(9, n=3)
    with pytest.raises(EstimationError, match="leave a combination of parameters free"):
        ordinary(plain_problem(A, y))


@settings(deadline=None)
@given(SEEDS, st.integers(1, 4))
def test_nonnegative_solution_is_scipys(seed, columns):
    rng = np.random.default_rng(seed)
    A, y = rng.standard_normal((12, columns)), rng.standard_normal(12)
    expected, left = nnls(A, y)
    found = nonnegative_solution(A.T @ A, A.T @ y)
    assert found == pytest.approx(expected, abs=1e-9)
    assert np.linalg.norm(y - A @ found) == pytest.approx(left, abs=1e-9)
