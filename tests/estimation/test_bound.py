"""The bound: the covariance of the banded estimate, and the shift that wrong signals cause."""

import numpy as np
import pytest

from rotorfit.estimation.banded import BandedProblem, banded
from rotorfit.estimation.bound import information, linearised, score
from rotorfit.estimation.factors import time_block_factors
from rotorfit.estimation.parameter_map import parameter_map

NAMES = ("y", "u", "slope", "offset", "mixed")
TRUE = np.array([1.7, -0.4, 0.6])


def tensor():
    """Equations y - slope x - offset = 0 and (1 + mixed) u - slope x = 0; y and u are noisy."""
    A = np.zeros((5, 2, 4))  # signals: y, u, x, 1
    A[0, 0, 0] = A[1, 1, 1] = 1.0
    A[2, 0, 2] = A[2, 1, 2] = -1.0
    A[3, 0, 3] = -1.0
    A[4, 1, 1] = 1.0
    return A


def mapped():
    free = {name: {(0, name): 1.0} for name in ("slope", "offset", "mixed")}
    return parameter_map(NAMES, free, {(0, "y"): 1.0, (0, "u"): 1.0})


def signals(phi, *, noise=0.0, n=4000, seed=0):
    rng = np.random.default_rng(seed)
    slope, offset, mixed = phi
    x = rng.normal(size=n)
    y, u = slope * x + offset, slope * x / (1.0 + mixed)
    e = noise * rng.normal(size=(n, 2)) * [1.0, 0.5]
    return np.column_stack([y + e[:, 0], u + e[:, 1], x, np.ones(n)])


def model_at(phi):
    return linearised(tensor(), mapped(), phi, configuration=0, noisy=(0, 1))


def test_it_is_the_covariance_of_the_estimate():
    factors = time_block_factors(signals(TRUE, noise=0.3), block_rows=500)
    problem = BandedProblem(
        factors=(factors,), tensors=(tensor(),), map=mapped(), noisy=(0, 1),
        prior_mean={}, prior_std={},
    )  # fmt: skip
    fit = banded(problem, np.array([1.0, 0.0, 0.0]))
    found = information(model_at(fit.estimate.values), factors, fit.variance)
    np.testing.assert_allclose(np.linalg.inv(found), fit.estimate.covariance, rtol=1e-6)


def test_exact_signals_and_known_noise_predict_the_scatter():
    exact = time_block_factors(signals(TRUE), block_rows=500)
    variance = np.tile([0.3**2, 0.15**2], (len(exact), 1))
    std = np.sqrt(np.diag(np.linalg.inv(information(model_at(TRUE), exact, variance))))
    found = []
    for seed in range(60):
        noisy = signals(TRUE, noise=0.3)
        noisy[:, :2] = signals(TRUE)[:, :2] + 0.3 * np.random.default_rng(seed + 1).normal(
            size=(4000, 2)
        ) * [1.0, 0.5]
        problem = BandedProblem(
            factors=(time_block_factors(noisy, block_rows=500),), tensors=(tensor(),),
            map=mapped(), noisy=(0, 1), prior_mean={}, prior_std={},
        )  # fmt: skip
        found.append(banded(problem, np.array([1.0, 0.0, 0.0])).estimate.values)
    np.testing.assert_allclose(np.std(found, axis=0) / std, 1.0, atol=0.35)  # 3.5 of its own std


def test_informations_add():
    one = time_block_factors(signals(TRUE, n=1000), block_rows=250)
    variance = np.full((4, 2), 0.1)
    whole = information(model_at(TRUE), one, variance)
    parts = [
        information(model_at(TRUE), one.select(np.arange(4) == b), variance[:1]) for b in range(4)
    ]
    np.testing.assert_allclose(sum(parts), whole, rtol=1e-12)


def test_the_bias_of_wrong_signals_is_a_newton_step():
    small = 1e-5 * np.array([1.0, -2.0, 0.5])
    factors = time_block_factors(signals(TRUE + small), block_rows=500)
    variance = np.full((len(factors), 2), 0.2)
    model = model_at(TRUE)
    step = -np.linalg.solve(information(model, factors, variance), score(model, factors, variance))
    np.testing.assert_allclose(step, small, rtol=1e-3)


def test_exact_signals_do_not_bias():
    factors = time_block_factors(signals(TRUE), block_rows=500)
    variance = np.full((len(factors), 2), 0.2)
    assert np.abs(score(model_at(TRUE), factors, variance)).max() == pytest.approx(0.0, abs=1e-7)
