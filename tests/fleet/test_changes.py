"""A change is found, named and sized; nothing is found where nothing changed."""

import numpy as np
import pytest
from scipy import stats

from rotorfit.fleet.changes import (
    chance_of_largest,
    find_changes,
    overstated,
    robust_scatter,
    shapes_of,
)

ALARM = 0.05


def series(seed: int, n: int = 25) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(n)


def test_false_alarms_are_as_often_as_stated():
    """The bound is one: not above the rate, nor far below it."""
    drawn = [find_changes(series(i), np.ones(25), alarm=ALARM) for i in range(300)]
    rate = np.mean([len(found) > 0 for found in drawn])
    assert 0.01 < rate < 0.08


def test_a_step_is_dated_and_sized():
    y = series(1) + 6.0 * (np.arange(25) >= 9)
    (change,) = find_changes(y, np.ones(25), alarm=1e-4)
    assert (change.kind, change.first) == ("step", 9)
    assert change.earliest <= 9 <= change.latest
    assert change.low < 6.0 < change.high
    assert change.total == change.size


def test_steady_change_is_a_ramp():
    y = series(2) + 0.8 * np.maximum(np.arange(25) - 5, 0)
    change = find_changes(y, np.ones(25), alarm=1e-4)[0]
    assert change.kind == "ramp"
    assert change.earliest <= 6 <= change.latest
    assert change.low < 0.8 < change.high


def test_one_strange_value_is_not_taken_for_a_step():
    y = series(3) + 9.0 * (np.arange(25) == 12)
    (change,) = find_changes(y, np.ones(25), alarm=1e-4)
    assert (change.kind, change.first, change.latest) == ("once", 12, 12)


def test_two_changes_are_two():
    y = series(4) + 9.0 * (np.arange(25) == 4) - 7.0 * (np.arange(25) >= 15)
    found = find_changes(y, np.ones(25), alarm=1e-4)
    assert {(c.kind, c.first) for c in found} == {("once", 4), ("step", 15)}


def test_short_series_say_nothing():
    assert find_changes(np.array([0.0, 0.0, 99.0]), np.ones(3), alarm=ALARM) == ()


def test_values_of_little_weight_weigh_little():
    y = series(5) + 30.0 * (np.arange(25) == 7)
    variance = np.where(np.arange(25) == 7, 1e4, 1.0)
    assert find_changes(y, variance, alarm=1e-3) == ()


def test_the_bound_of_one_direction_is_the_normal_tail():
    u = np.ones((1, 4)) / 2
    assert chance_of_largest(2.5, u, np.inf) == pytest.approx(2 * stats.norm.sf(2.5))
    assert chance_of_largest(2.5, u, 6.0) == pytest.approx(2 * stats.t.sf(2.5, 6.0))


def test_the_bound_of_the_same_direction_twice_is_that_of_one():
    u = np.ones((2, 4)) / 2
    assert chance_of_largest(2.5, u, np.inf) == pytest.approx(2 * stats.norm.sf(2.5), rel=0.01)


def test_long_series_are_tried_at_a_limited_number_of_moments():
    assert len(shapes_of(5000).values) <= 1200


def test_scatter_is_not_widened_by_changes():
    y = np.concatenate([series(i) + 0.5 * np.arange(25) * (i < 3) for i in range(8)])
    group = np.repeat(np.arange(8), 25)
    found = robust_scatter(2.0 * y, np.ones(200), group)
    assert found == pytest.approx(3.0, rel=0.4)  # 4 of chance, of which 1 is known


def test_stated_variances_are_held_against_what_is_seen():
    y = np.concatenate([series(i) + 0.5 * np.arange(25) * (i < 3) for i in range(8)])
    group = np.repeat(np.arange(8), 25)
    assert overstated(y, np.full(200, 100.0), group) == pytest.approx(0.01, rel=0.4)
    assert overstated(y, np.full(200, 0.3), group) == 1.0
    assert overstated(y[:6], np.full(6, 100.0), group[:6]) == 1.0  # too few to tell
