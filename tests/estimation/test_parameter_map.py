"""The map from free parameters to every configuration's theta, and problems built on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import LinearProblem, problem_rows
from rotorfit.estimation.factors import time_block_factors
from rotorfit.estimation.least_squares import ordinary, total
from rotorfit.estimation.parameter_map import parameter_map

NAMES = ("mass", "msx", "Ixx", "Iyy", "kt")


def two_configurations():
    """Return kt shared, msx apart, Iyy of both as one, Ixx of B as twice that of A."""
    free = {
        "kt": {(0, "kt"): 1.0, (1, "kt"): 1.0},
        "msx_A": {(0, "msx"): 1.0},
        "msx_B": {(1, "msx"): 1.0},
        "inertia": {(0, "Ixx"): 1.0, (1, "Ixx"): 2.0, (0, "Iyy"): -1.0},
    }
    given_ = {(0, "mass"): 1.285, (1, "mass"): 1.452, (1, "msx"): 0.04}
    return parameter_map(NAMES, free, given_, configurations=2)


def test_theta_of_shared_separate_combined_and_given_parameters():
    theta = two_configurations().theta(np.array([3.0, 0.1, 0.2, 0.5]))
    np.testing.assert_allclose(
        theta, [[1.285, 0.1, 0.5, -0.5, 3.0], [1.452, 0.24, 1.0, 0.0, 3.0]], rtol=1e-15
    )


def test_the_jacobian_is_the_difference_quotient():
    map_ = two_configurations()
    phi = np.array([3.0, 0.1, 0.2, 0.5])
    for i, step in enumerate(np.eye(4)):
        change = map_.theta(phi + step) - map_.theta(phi)
        np.testing.assert_allclose(map_.jacobian(phi)[:, :, i], change, atol=1e-15)


def test_a_removed_parameter_rests_at_what_is_given():
    map_ = two_configurations().without("msx_B")
    assert map_.names == ("kt", "msx_A", "inertia")
    theta = map_.theta(np.array([3.0, 0.1, 0.5]))
    assert theta[1, 1] == 0.04
    assert map_.matrix.shape == (2, 5, 3)


def test_a_fixed_parameter_moves_all_its_entries():
    map_ = two_configurations().fixed("inertia", 0.5).fixed("kt", 3.0)
    assert map_.names == ("msx_A", "msx_B")
    np.testing.assert_array_equal(
        map_.theta(np.array([0.1, 0.2])), two_configurations().theta(np.array([3.0, 0.1, 0.2, 0.5]))
    )


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(EstimationError, match="'Ixz'; it has mass, msx, Ixx, Iyy, kt"):
        parameter_map(NAMES, {"x": {(0, "Ixz"): 1.0}}, {})
    with pytest.raises(EstimationError, match="'weight'; it has mass, msx, Ixx, Iyy, kt"):
        parameter_map(NAMES, {}, {(0, "weight"): 1.0})
    with pytest.raises(EstimationError, match="'kd'; the map has kt, msx_A, msx_B, inertia"):
        two_configurations().without("kd")


def two_flights(seed, noise=0.01):
    """Return dense signals and tensors of two configurations that obey one phi, and that phi."""
    rng = np.random.default_rng(seed)
    phi = rng.normal(size=4)
    map_ = two_configurations()
    theta = map_.theta(phi)
    Z, tensors = [], []
    for c, n in enumerate((150, 90)):
        tensor = rng.normal(size=(5, 3, 8))
        B = np.einsum("p,pjz->jz", theta[c], tensor)
        free = rng.normal(size=(n, 8))
        exact = free - free @ np.linalg.pinv(B) @ B
        Z.append(exact + noise * rng.normal(size=(n, 8)))
        tensors.append(tensor)
    return Z, tensors, map_, phi


def stacked(Z, tensors, map_, weights):
    """Return [A, b] of both configurations, sample by sample."""
    parts = []
    for c, (rows, tensor) in enumerate(zip(Z, tensors, strict=True)):
        per_theta = np.einsum("nz,pjz->njp", rows, tensor) * weights[c][:, None]
        columns = np.column_stack([map_.matrix[c], map_.constant[c]])
        parts.append((per_theta @ columns).reshape(-1, columns.shape[1]))
    return np.concatenate(parts)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_two_configurations_are_the_dense_stacked_system(seed):
    Z, tensors, map_, _ = two_flights(seed)
    weights = np.random.default_rng(seed + 1).uniform(0.5, 2.0, (2, 3))
    weights[1, 2] = 0.0
    problem = LinearProblem(
        factors=tuple(time_block_factors(rows, block_rows=40) for rows in Z),
        tensors=tuple(tensors),
        map=map_,
        weights=weights,
    )
    dense = stacked(Z, tensors, map_, weights)
    reduced = problem_rows(problem)
    size = np.linalg.norm(dense, axis=0)
    np.testing.assert_allclose(
        (reduced.T @ reduced) / np.outer(size, size),
        (dense.T @ dense) / np.outer(size, size),
        atol=1e-13,
    )
    assert problem.rows == 150 * 3 + 90 * 2
    expected, *_ = np.linalg.lstsq(dense[:, :4], -dense[:, 4])
    np.testing.assert_allclose(ordinary(problem).values, expected, rtol=1e-8, atol=1e-10)
    v = np.linalg.svd(dense)[2][-1]
    np.testing.assert_allclose(total(problem).values, v[:4] / v[4], rtol=1e-8, atol=1e-10)


def test_an_exact_flight_gives_its_parameters_back():
    Z, tensors, map_, phi = two_flights(7, noise=0.0)
    problem = LinearProblem(
        factors=tuple(time_block_factors(rows, block_rows=40) for rows in Z),
        tensors=tuple(tensors),
        map=map_,
        weights=np.ones((2, 3)),
    )
    np.testing.assert_allclose(ordinary(problem).values, phi, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(total(problem).values, phi, rtol=1e-12, atol=1e-13)
