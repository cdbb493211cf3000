"""Differences of groups: Student's where nothing is stated, true chances, outlying groups found."""

import numpy as np
import pytest
from scipy import stats

from rotorfit.tools.fleet.group_differences import contrasts, discoveries, outlier_test


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
def test_chances_of_like_pairs_are_even(rng, scatter):
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


def levels(seed: int, g: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(g)


def test_chances_of_like_groups_are_even():
    p = np.concatenate([outlier_test(levels(i), np.full(20, 0.3)).p for i in range(60)])
    shares = [float(np.mean(p < level)) for level in (0.5, 0.05, 0.005)]
    assert shares == pytest.approx([0.5, 0.05, 0.005], abs=0.03)
    assert shares[2] < 0.012


def test_precision_of_each_group_counts():
    values = levels(1)
    values[4] = 8.0
    loose = np.where(np.arange(20) == 4, 100.0, 0.1)
    assert outlier_test(values, np.full(20, 0.1)).p[4] < 1e-5
    assert outlier_test(values, loose).p[4] > 0.2


def test_two_do_not_hide_one_another():
    values = levels(2)
    values[[3, 9]] += 30.0
    found = outlier_test(values, np.full(20, 0.1))
    assert set(np.flatnonzero(found.p < 1e-6)) == {3, 9}
    assert found.difference[3] == pytest.approx(30.0, abs=4.0)


def test_an_unknown_level_is_not_judged():
    values = levels(3)
    values[2] = np.nan
    found = outlier_test(values, np.full(20, 0.1))
    assert np.isnan(found.p[2])
    assert np.isfinite(np.delete(found.p, 2)).all()


def test_few_groups_are_not_judged():
    assert np.isnan(outlier_test(levels(1, 4), np.ones(4)).p).all()


def test_discoveries_are_those_of_benjamini_and_hochberg():
    p = np.array([0.001, 0.008, 0.039, 0.041, 0.042, 0.06, 0.074, 0.205, 0.212, 0.216])
    found = discoveries(p[:, None], 0.05)  # one number of each group
    assert found[:, 0].tolist() == [True, True] + [False] * 8
    assert not discoveries(np.array([[np.nan], [0.9]]), 0.05).any()


def test_a_group_is_selected_before_its_numbers():
    """Many clear numbers of one group do not lower the bar for the others."""
    p = np.full((20, 10), 0.5)
    p[3] = 1e-9
    p[8, 2] = 0.002  # would pass among ten discoveries of two hundred
    found = discoveries(p, 0.05)
    assert found[3].all()
    assert found.sum() == 10
