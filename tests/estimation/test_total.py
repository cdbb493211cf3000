"""Total least squares: published numbers, the paper's sigmas, weights and essential parameters."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from odrpack import odr_fit
from plain_problem import dense_rows, plain_problem, wrench_problem

from rotorfit.errors import EstimationError
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.least_squares import (
    component_weights,
    essential_total,
    ordinary,
    relative_std,
    total,
    weighted_total,
)

SEEDS = st.integers(0, 2**32 - 1)

# The example of MB02MD in the SLICOT library's documentation: [A, b], X = .5003 .8003 .2995.
SLICOT = np.array(
    [
        [0.80010, 0.39985, 0.60005, 0.89999],
        [0.29996, 0.69990, 0.39997, 0.82997],
        [0.49994, 0.60003, 0.20012, 0.79011],
        [0.90013, 0.20016, 0.79995, 0.85002],
        [0.39998, 0.80006, 0.49985, 0.99016],
        [0.20002, 0.90007, 0.70009, 1.02994],
    ]
)
# Pearson, Philosophical Magazine 2(11), 1901.
PEARSON_X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
PEARSON_Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])


@pytest.mark.parametrize("block_rows", [2, 6])
def test_slicot_example(block_rows):
    e = total(plain_problem(SLICOT[:, :3], SLICOT[:, 3], block_rows=block_rows))
    np.testing.assert_allclose(e.values, [0.5003, 0.8003, 0.2995], atol=5e-5)
    np.testing.assert_allclose(e.values, [0.50025426, 0.80025202, 0.29949269], atol=5e-9)
    s = np.linalg.svd(SLICOT, compute_uv=False)
    np.testing.assert_allclose(s, [3.2281, 0.8716, 0.3697, 0.0001], atol=5e-5)


def test_pearsons_line():
    """A column without error is a column that is scaled up until the correction ignores it."""
    exact = 1e7
    A = np.column_stack([PEARSON_X, np.full(10, exact)])
    slope, intercept = total(plain_problem(A, PEARSON_Y)).values
    assert slope == pytest.approx(-0.5455611975, abs=1e-10)
    assert intercept * exact == pytest.approx(5.7840437745, abs=1e-9)
    centred = plain_problem((PEARSON_X - PEARSON_X.mean())[:, None], PEARSON_Y - PEARSON_Y.mean())
    assert total(centred).values[0] == pytest.approx(-0.5455611975, abs=1e-10)


def test_the_pair_of_ordinary_and_total_least_squares():
    e = total(plain_problem(np.array([[1.0], [2.0], [3.0], [4.0]]), [2.01, 3.99, 5.80, 8.30]))
    assert e.values[0] == pytest.approx(2.0212389, abs=5e-8)


def test_scaled_columns_are_linear_errors_in_variables():
    """Columns over the known std of their errors: the maximum of the likelihood, as odrpack's."""
    rng = np.random.default_rng(10)
    std_x, std_y = np.array([0.05, 0.4, 2.0]), 0.3
    truth = np.array([2.0, -0.7, 0.05])
    exact = rng.normal(size=(400, 3)) * [1.0, 5.0, 30.0]
    x = exact + std_x * rng.normal(size=(400, 3))
    y = exact @ truth + std_y * rng.normal(size=400)
    scaled = total(plain_problem(x / std_x, y / std_y)).values * std_y / std_x
    fit = odr_fit(
        lambda x, beta: beta @ x,
        x.T,
        y,
        truth,
        weight_x=std_x**-2,
        weight_y=std_y**-2,
        jac_beta=lambda x, beta: x,
        jac_x=lambda x, beta: np.repeat(beta[:, None], x.shape[1], axis=1),
        sstol=1e-15,
        partol=1e-14,
        maxit=500,
    )
    np.testing.assert_allclose(scaled, fit.beta, rtol=2e-7)
    plain = ordinary(plain_problem(x, y)).values
    assert np.abs(plain / fit.beta - 1.0).max() > 2e-3


def wrench(seed, n=240, f=5, noise=0.02):
    """Return signals, a tensor of three equations that nearly hold, and the known value."""
    rng = np.random.default_rng(seed)
    tensor = rng.normal(size=(f + 1, 3, 12))
    theta = np.append(rng.uniform(0.3, 2.0, f), 1.3)
    B = np.einsum("p,pjz->jz", theta, tensor)
    Z = rng.normal(size=(n, 12))
    Z -= Z @ np.linalg.pinv(B) @ B
    return Z + noise * rng.normal(size=Z.shape), tensor, 1.3


def dense_total(W):
    """Return solution and sigmas as Six et al. 2020, eq. 14-21, write them."""
    r, n_t = W.shape
    U, s, Vt = np.linalg.svd(W, full_matrices=False)
    chi = Vt[-1, :-1] / Vt[-1, -1]
    sigma_W = s[-1] / np.sqrt(r - n_t)
    W_bar = (W - s[-1] * np.outer(U[:, -1], Vt[-1]))[:, : n_t - 1]
    C = sigma_W**2 * (1.0 + chi @ chi) * np.linalg.inv(W_bar.T @ W_bar)
    return chi, np.sqrt(np.diagonal(C)), C


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_solution_and_sigmas_are_the_papers_dense_formulas(seed):
    Z, tensor, known = wrench(seed)
    weights = np.random.default_rng(seed).uniform(0.3, 3.0, 3)
    chi, sigma, C = dense_total(dense_rows(Z, tensor, known, weights))
    e = total(wrench_problem(Z, tensor, known, weights=weights))
    np.testing.assert_allclose(e.values, chi, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(e.std, sigma, rtol=1e-8)
    np.testing.assert_allclose(
        e.covariance / np.outer(sigma, sigma), C / np.outer(sigma, sigma), atol=1e-8
    )
    np.testing.assert_allclose(relative_std(e), sigma / np.abs(chi), rtol=1e-7)


def test_columns_of_very_different_size_keep_their_digits():
    """Columns of 1e7 beside columns of 0.5, against extended precision."""
    rng = np.random.default_rng(11)
    sizes = np.array([1e7, 3e6, 60.0, 5.0, 0.5])
    A = (rng.normal(size=(600, 5)) + 3.0 * rng.normal(size=(600, 1))) * sizes
    truth = np.array([3e-6, 5e-8, 0.02, -0.004, 0.01])
    y = A @ truth + 0.05 * rng.normal(size=600)
    got = total(plain_problem(A, y)).values
    # (A^T A - s^2 1) chi = A^T y, with s^2 from its own fixed point, in extended precision.
    A, y = A.astype(np.longdouble), y.astype(np.longdouble)
    chi, H = truth.astype(np.longdouble), A.T @ A
    for _ in range(60):
        square = ((y - A @ chi) ** 2).sum() / (1 + (chi**2).sum())
        # One step of refinement: an ordinary solve of the extended residual.
        residual = A.T @ y - H @ chi + square * chi
        step = np.linalg.solve(
            (H / np.outer(sizes, sizes)).astype(float), residual.astype(float) / sizes
        )
        chi = chi + step / sizes
    np.testing.assert_allclose(got, chi.astype(float), rtol=1e-11)


def mixed(seed=0, n=400):
    """Return columns of which each moves less than the one before, against one noise level."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, 4)) * [1.0, 0.02, 0.2, 0.004]
    return A, A.sum(axis=1) + 0.002 * rng.normal(size=n)


def test_essential_parameters_go_by_relative_sigma():
    A, y = mixed()
    problem = plain_problem(A, y, names=["a", "c", "b", "d"])
    kept = essential_total(problem, r_sigma=30.0)
    assert kept.removed[0] == "d"
    assert kept.estimate.names + kept.removed[::-1] == ("a", "b", "c", "d")
    assert kept.removed == ("d", "c")
    relative = relative_std(kept.estimate)
    assert relative.max() < 30.0 * relative.min()
    assert kept.problem.map.names == ("a", "b")
    assert essential_total(problem, r_sigma=1e6).removed == ()
    assert essential_total(problem, r_sigma=1.0).estimate.names == ("a",)


def dense_essential(Z, tensor, known, r_sigma):
    """Return what the paper's loop leaves, with dense rows throughout."""
    columns = list(range(len(tensor) - 1))
    removed = []
    while True:
        chosen = tensor[[*columns, -1]]
        rows = dense_rows(Z, chosen, known, np.ones(3))
        first = np.linalg.lstsq(rows[:, :-1], -rows[:, -1], rcond=None)[0]
        error = (rows @ np.append(first, 1.0)).reshape(-1, 3)
        weights = 1.0 / np.sqrt((error**2).mean(axis=0))
        chi, sigma, _ = dense_total(dense_rows(Z, chosen, known, weights))
        relative = sigma / np.abs(chi)
        if len(columns) == 1 or relative.max() < r_sigma * relative.min():
            return chi, sigma, removed, weights
        removed.append(columns.pop(int(np.argmax(relative))))


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, r_sigma=st.floats(1.5, 20.0))
def test_weights_and_elimination_are_the_dense_loop(seed, r_sigma):
    Z, tensor, known = wrench(seed, noise=0.05)
    tensor[1] *= 0.1
    tensor[3] *= 0.02
    Z[:, :4] += 0.2 * np.random.default_rng(seed).normal(size=(240, 4))
    chi, sigma, removed, weights = dense_essential(Z, tensor, known, r_sigma)
    got = essential_total(wrench_problem(Z, tensor, known, weights=np.ones(3)), r_sigma=r_sigma)
    assert got.removed == tuple(f"p{i}" for i in removed)
    np.testing.assert_allclose(got.estimate.values, chi, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(got.estimate.std, sigma, rtol=1e-6)
    np.testing.assert_allclose(got.problem.weights[0], weights, rtol=1e-8)


def test_weights_come_from_one_pass_and_keep_the_factor():
    Z, tensor, known = wrench(2)
    problem = wrench_problem(Z, tensor, known, weights=[2.0, 2.0, 2.0])
    rows = dense_rows(Z, tensor, known, np.ones(3))
    ordinary = np.linalg.lstsq(rows[:, :-1], -rows[:, -1], rcond=None)[0]
    error = (rows @ np.append(ordinary, 1.0)).reshape(-1, 3)
    expected = 1.0 / np.sqrt((error**2).mean(axis=0))
    estimate, weighted = weighted_total(problem)
    np.testing.assert_allclose(weighted.weights[0], 2.0 * expected, rtol=1e-9)
    np.testing.assert_array_equal(estimate.values, total(weighted).values)


def test_a_component_without_weight_stays_without():
    Z, tensor, known = wrench(3)
    problem = wrench_problem(Z, tensor, known, weights=[1.0, 0.0, 1.0])
    assert weighted_total(problem)[1].weights[0, 1] == 0.0
    assert (weighted_total(problem)[1].weights[0, [0, 2]] > 0).all()


def test_components_are_weighed_by_both_configurations_together():
    Z, tensor, known = wrench(4)
    one = wrench_problem(Z, tensor, known, weights=[1.0, 1.0, 1.0])
    other = wrench_problem(Z[:80], tensor, known, weights=[1.0, 1.0, 1.0])
    both = dataclasses.replace(
        one,
        factors=one.factors + other.factors,
        tensors=one.tensors * 2,
        map=dataclasses.replace(
            one.map,
            constant=np.repeat(one.map.constant, 2, axis=0),
            matrix=np.repeat(one.map.matrix, 2, axis=0),
        ),
        weights=np.array([[1.0] * 3, [2.0] * 3]),
    )
    e = total(one)
    rows = dense_rows(np.concatenate([Z, Z[:80]]), tensor, known, np.ones(3))
    error = (rows @ np.append(e.values, 1.0)).reshape(-1, 3)
    expected = 1.0 / np.sqrt((error**2).mean(axis=0))
    np.testing.assert_allclose(component_weights(both, e), [expected, 2 * expected], rtol=1e-10)


def test_an_exact_flight_keeps_its_weights():
    A = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0]])
    problem = plain_problem(A, A @ [0.0, 0.0])
    e = total(plain_problem(A, A @ [3.0, 4.0]))
    np.testing.assert_allclose(e.values, [3.0, 4.0], rtol=1e-14)
    zero = dataclasses.replace(e, values=np.zeros(2))
    np.testing.assert_array_equal(component_weights(problem, zero), problem.weights)


def test_no_solution_if_the_flattest_direction_misses_the_known():
    problem = plain_problem(np.array([[0.1], [0.0], [0.0]]), [0.0, 1.0, 0.0])
    with pytest.raises(EstimationError, match="total least squares has no solution here"):
        total(problem)


def test_two_flat_directions_are_refused():
    """(k_d, Izz) unidentified and the equations exact: the kernel is a plane, not a line."""
    A = np.random.default_rng(0).normal(size=(60, 3))
    A[:, 2] = 1e4 * A[:, 1]
    with pytest.raises(EstimationError, match="free"):
        total(plain_problem(A, A @ [1.0, 2.0, 0.0]))
    with pytest.raises(EstimationError, match="free"):
        total(plain_problem(np.random.default_rng(1).normal(size=(2, 3)), [1.0, 2.0]))


def test_a_parameter_that_nothing_moves_is_named():
    A, y = mixed()
    A[:, 1] = 0.0
    with pytest.raises(EstimationError, match="does not move c at all"):
        total(plain_problem(A, y, names=["a", "c", "b", "d"]))


def test_only_total_least_squares_depends_on_units():
    A, y = mixed(1)
    to_mm = np.array([1.0, 1e3, 1.0, 1.0])
    SI, mm = total(plain_problem(A, y)), total(plain_problem(A / to_mm, y))
    plain, plain_mm = ordinary(plain_problem(A, y)), ordinary(plain_problem(A / to_mm, y))
    np.testing.assert_allclose(plain_mm.values / to_mm, plain.values, rtol=1e-11)
    assert np.abs(mm.values / to_mm / SI.values - 1.0).max() > 0.02


def test_the_same_data_twice_halve_the_covariance():
    Z, tensor, known = wrench(6)
    problem = wrench_problem(Z, tensor, known, weights=np.ones(3))
    twice = dataclasses.replace(problem, factors=(stack_factors(problem.factors * 2),))
    r, n_t = 720, 6
    np.testing.assert_allclose(total(twice).values, total(problem).values, rtol=1e-10)
    np.testing.assert_allclose(
        total(twice).covariance,
        total(problem).covariance * (r - n_t) / (2 * r - n_t),
        rtol=1e-8,
        atol=1e-12,
    )


def test_scaling_every_weight_leaves_values_and_sigmas():
    Z, tensor, known = wrench(7)
    one = total(wrench_problem(Z, tensor, known, weights=[1.0, 2.0, 3.0]))
    other = total(wrench_problem(Z, tensor, known, weights=[1e4, 2e4, 3e4]))
    np.testing.assert_allclose(other.values, one.values, rtol=1e-10)
    np.testing.assert_allclose(other.std, one.std, rtol=1e-9)
