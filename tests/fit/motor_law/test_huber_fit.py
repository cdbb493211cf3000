"""Least squares on normal equations, against `scipy.optimize.least_squares`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from rotorfit.fit.motor_law.huber_fit import fit_huber

TIME = np.linspace(0.0, 3.0, 400)
BLOCK = np.arange(400) // 20


def predict(x):
    """Predict a decay to a level, and its slopes."""
    decay = np.exp(-x[2] * TIME)
    return x[0] + x[1] * decay, np.array([np.ones(400), decay, -x[1] * TIME * decay])


def minimum_of_scipy(measured, begin, bounds, limit):
    return least_squares(
        lambda x: predict(x)[0] - measured,
        begin,
        jac=lambda x: predict(x)[1].T.copy(),
        bounds=bounds,
        x_scale="jac",
        loss="huber",
        f_scale=limit,
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-14,
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.02, 0.2]), st.booleans())
def test_it_ends_where_scipy_does(seed, glitches, is_bounded):
    rng = np.random.default_rng(seed)
    truth = np.array([rng.normal(), rng.uniform(1.0, 3.0), rng.uniform(0.5, 3.0)])
    measured = predict(truth)[0] + 0.1 * rng.normal(size=400)
    spoilt = rng.random(400) < glitches
    measured[spoilt] += rng.uniform(2.0, 5.0, spoilt.sum())
    high = np.array([np.inf, np.inf, 0.8 * truth[2] if is_bounded else 10.0])
    bounds = np.array([-np.inf, -np.inf, 0.01]), high
    begin = np.array([0.0, 1.0, min(1.0, 0.9 * high[2])])
    found = fit_huber(predict, measured, begin, bounds=bounds, block=BLOCK, limit=0.4, close=0.01)
    expected = minimum_of_scipy(measured, begin, bounds, 0.4)
    std = np.sqrt(np.diagonal(np.linalg.inv(expected.jac.T @ expected.jac))) * 0.1
    assert np.abs(found.values - expected.x) == pytest.approx(np.zeros(3), abs=0.05 * std.max())
    assert found.loss == pytest.approx(2.0 * expected.cost / 400, rel=1e-4)
    weight = np.minimum(1.0, 0.4 / np.abs(measured - found.predicted))
    assert found.residuals**2 == pytest.approx(weight * (measured - found.predicted) ** 2)


def test_a_start_far_away_ends_at_the_minimum_too():
    rng = np.random.default_rng(1)
    truth = np.array([500.0, 300.0, 1.5])
    measured = predict(truth)[0] + 0.1 * rng.normal(size=400)
    bounds = np.array([-np.inf, -np.inf, 0.01]), np.array([np.inf, np.inf, 10.0])
    begin = np.array([-200.0, 1.0, 5.0])
    found = fit_huber(predict, measured, begin, bounds=bounds, block=BLOCK, limit=0.4)
    assert found.values == pytest.approx(truth, rel=1e-3)


def test_a_misfit_at_the_start_is_no_scatter():
    """Few blocks, whose scores scatter by the misfit: no step is the last one there."""
    truth = np.array([1.0, 2.0, 1.0])
    bounds = np.array([-9.0, -9.0, 0.01]), np.array([9.0, 9.0, 9.0])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        measured = predict(truth)[0] + 0.01 * rng.normal(size=400)
        begin = np.array([rng.uniform(-1.0, 3.0), rng.uniform(0.5, 4.0), rng.uniform(0.2, 4.0)])
        block = np.arange(400) // 100
        found = fit_huber(predict, measured, begin, bounds=bounds, block=block, limit=0.04)
        assert np.abs(found.values - truth).max() < 0.1, seed


def test_a_parameter_without_effect_stays():
    def with_idle(x):
        speed, slopes = predict(x[:3])
        return speed, np.vstack([slopes, np.zeros(400)])

    measured = predict(np.array([1.0, 2.0, 1.0]))[0]
    bounds = np.array([-9.0, -9.0, 0.01, -1.0]), np.array([9.0, 9.0, 9.0, 1.0])
    begin = np.array([0.0, 1.0, 2.0, 0.25])
    found = fit_huber(with_idle, measured, begin, bounds=bounds, block=BLOCK)
    assert found.values == pytest.approx([1.0, 2.0, 1.0, 0.25], rel=1e-3)
