"""Differences of two groups: Student's where nothing is stated, and true chances."""

import numpy as np
import pytest
from scipy import stats

from rotorfit.fleet.population.contrasts import contrasts


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_without_stated_variances_it_is_students_test(rng):
    values, group = rng.standard_normal(11), np.repeat([0, 1], [5, 6])
    found = contrasts(values, np.full(11, 1e-12), group, [(1, 0)])
    expected = stats.ttest_ind(values[group == 1], values[group == 0])
    interval = expected.confidence_interval()
    assert found.p[0] == pytest.approx(expected.pvalue, rel=1e-6)
    assert (found.low[0], found.high[0]) == pytest.approx((interval.low, interval.high), rel=1e-6)
    assert found.difference[0] == pytest.approx(0.5 * (interval.low + interval.high), rel=1e-9)


def test_what_is_stated_counts_as_known(rng):
    """Values that scatter no more than they state: the difference is normal."""
    variance = rng.uniform(1.0, 9.0, 12)
    group = np.repeat([0, 1, 2], 4)
    values = np.zeros(12) + 3.0 * (group == 1)
    found = contrasts(values, variance, group, [(1, 2)])
    std = np.sqrt(sum(1.0 / np.sum(1.0 / variance[group == g]) for g in (1, 2)))
    assert found.difference[0] == pytest.approx(3.0)
    assert found.high[0] - 3.0 == pytest.approx(1.96 * std, rel=1e-3)
    assert found.p[0] == pytest.approx(2 * stats.norm.sf(3.0 / std), rel=1e-6)


@pytest.mark.parametrize("scatter", [0.0, 1.0])
def test_chances_of_like_groups_are_even(rng, scatter):
    group = np.repeat([0, 1, 2, 3], [4, 3, 2, 2])
    p = []
    for _ in range(800):
        std = rng.uniform(0.5, 1.5, 11)
        values = rng.standard_normal(11) * np.hypot(std, scatter)
        p.append(contrasts(values, std**2, group, [(1, 0)]).p[0])
    shares = [float(np.mean(np.array(p) < level)) for level in (0.5, 0.05, 0.01)]
    assert shares[0] == pytest.approx(0.5, abs=0.06)
    assert 0.015 < shares[1] < 0.065
    assert shares[2] < 0.02


def test_few_values_say_nothing(rng):
    found = contrasts(rng.standard_normal(5), np.ones(5), np.array([0, 0, 1, 1, 2]), [(0, 1)])
    assert np.isnan([found.p[0], found.low[0], found.difference[0]]).all()
