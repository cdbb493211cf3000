"""Intervals by leaving blocks out: exact refits of a linear model, and coverage."""

import numpy as np
import pytest

from rotorfit.fit.motor_law.block_jackknife import blocks_of, jackknife, sum_blocks, widest


def test_it_is_the_refit_without_each_block():
    rng = np.random.default_rng(1)
    J = rng.normal(size=(120, 3)) * [1.0, 1e-3, 1e4]
    y = rng.normal(size=120)
    block = np.repeat(np.arange(10), 12)
    x = np.linalg.lstsq(J, y, rcond=None)[0]
    found = jackknife(sum_blocks(J.T, y - J @ x, block, count=10))
    for b in range(10):
        rows = block != b
        refit = np.linalg.lstsq(J[rows], y[rows], rcond=None)[0]
        assert found.shifts[b] == pytest.approx(refit - x, rel=1e-6)
        left = y[~rows] - J[~rows] @ refit
        assert found.held_out[b] == pytest.approx(left @ left, rel=1e-6)


@pytest.mark.parametrize(("correlated", "least", "most"), [(1, 0.92, 0.99), (25, 0.92, 0.99)])
def test_intervals_hold_correlated_rows(correlated, least, most):
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(400):
        noise = np.repeat(rng.normal(size=40), 25) if correlated > 1 else rng.normal(size=1000)
        J = np.column_stack([np.ones(1000), np.repeat(rng.normal(size=40), 25)])
        y = J @ [2.0, 3.0] + noise
        x = np.linalg.lstsq(J, y, rcond=None)[0]
        sums = sum_blocks(J.T, y - J @ x, np.repeat(np.arange(20), 50), count=20)
        found = jackknife(sums)
        half = found.half_width(np.array([0.0, 1.0]))
        inside += abs(x[1] - 3.0) < half
    assert least <= inside / 400 <= most


def test_blocks_are_of_one_flight_and_none_is_a_scrap():
    flight = np.repeat([0, 1], [1000, 230])
    time = np.concatenate([np.arange(1000) / 100.0, 50.0 + np.arange(230) / 100.0])
    block = blocks_of(flight, time, 1.0)
    assert np.bincount(block).tolist() == [100] * 10 + [100, 130]
    assert widest((), np.ones(2)) == np.inf
