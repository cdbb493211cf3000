"""Groups apart are found, also in pairs; of like groups few are."""

import numpy as np
import pytest

from rotorfit.fleet.population.outlying import apart, discovered


def levels(seed: int, g: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(g)


def test_chances_of_like_groups_are_even():
    p = np.concatenate([apart(levels(i), np.full(20, 0.3)).p for i in range(60)])
    shares = [float(np.mean(p < level)) for level in (0.5, 0.05, 0.005)]
    assert shares == pytest.approx([0.5, 0.05, 0.005], abs=0.03)
    assert shares[2] < 0.012


def test_precision_of_each_group_counts():
    values = levels(1)
    values[4] = 8.0
    loose = np.where(np.arange(20) == 4, 100.0, 0.1)
    assert apart(values, np.full(20, 0.1)).p[4] < 1e-5
    assert apart(values, loose).p[4] > 0.2


def test_two_do_not_hide_one_another():
    values = levels(2)
    values[[3, 9]] += 30.0
    found = apart(values, np.full(20, 0.1))
    assert set(np.flatnonzero(found.p < 1e-6)) == {3, 9}
    assert found.difference[3] == pytest.approx(30.0, abs=4.0)


def test_what_is_not_told_is_not_judged():
    values = levels(3)
    values[2] = np.nan
    found = apart(values, np.full(20, 0.1))
    assert np.isnan(found.p[2])
    assert np.isfinite(np.delete(found.p, 2)).all()


def test_few_groups_are_not_judged():
    assert np.isnan(apart(levels(1, 4), np.ones(4)).p).all()


def test_discoveries_are_those_of_benjamini_and_hochberg():
    p = np.array([0.001, 0.008, 0.039, 0.041, 0.042, 0.06, 0.074, 0.205, 0.212, 0.216])
    found = discovered(p[:, None], 0.05)  # one number of each group
    assert found[:, 0].tolist() == [True, True] + [False] * 8
    assert not discovered(np.array([[np.nan], [0.9]]), 0.05).any()


def test_a_group_is_selected_before_its_numbers():
    """Many clear numbers of one group do not lower the bar for the others."""
    p = np.full((20, 10), 0.5)
    p[3] = 1e-9
    p[8, 2] = 0.002  # would pass among ten discoveries of two hundred
    found = discovered(p, 0.05)
    assert found[3].all()
    assert found.sum() == 10
