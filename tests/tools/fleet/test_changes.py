"""A change is found, named and sized; nothing is found where nothing changed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.tools.fleet.changes import find_changes, shapes_of

ALARM = 0.05


def series(seed: int, n: int = 25) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(n)


def changes(y: np.ndarray, variance: np.ndarray | float = 1.0, *, alarm: float = 1e-4):
    """Of one vehicle."""
    stated = np.broadcast_to(variance, y.shape).astype(float)
    return find_changes(y, stated, np.zeros(len(y), dtype=int), alarm=alarm).of_group[0]


def test_false_alarms_are_as_often_as_stated():
    """Not above the rate, whether the scatter is stated, in part or not at all."""
    for stated in (0.3, 0.0):
        drawn = [changes(series(i, 12), stated, alarm=ALARM) for i in range(100)]
        assert np.mean([len(found) > 0 for found in drawn]) < 0.08
    assert any(changes(series(i, 12), 0.3, alarm=10 * ALARM) for i in range(50))


def test_a_step_is_dated_and_sized():
    y = series(1) + 6.0 * (np.arange(25) >= 9)
    (change,) = changes(y)
    assert (change.kind, change.first) == ("step", 9)
    assert change.earliest <= 9 <= change.latest
    assert change.low < 6.0 < change.high
    assert change.total == change.size


def test_steady_change_is_a_ramp():
    y = series(2) + 0.8 * np.maximum(np.arange(25) - 5, 0)
    change = changes(y)[0]
    assert change.kind == "ramp"
    assert change.earliest <= 6 <= change.latest
    assert change.low < 0.8 < change.high


def test_one_strange_value_is_not_taken_for_a_step():
    y = series(3) + 9.0 * (np.arange(25) == 12)
    (change,) = changes(y)
    assert (change.kind, change.first, change.latest) == ("once", 12, 12)


def test_two_changes_are_two():
    y = series(4) + 9.0 * (np.arange(25) == 4) - 7.0 * (np.arange(25) >= 15)
    found = changes(y)
    assert {(c.kind, c.first) for c in found} == {("once", 4), ("step", 15)}


def test_short_series_say_nothing():
    assert changes(np.array([0.0, 0.0, 99.0]), alarm=ALARM) == ()


def test_values_of_little_weight_weigh_little():
    y = series(5) + 30.0 * (np.arange(25) == 7)
    variance = np.where(np.arange(25) == 7, 1e4, 1.0)
    assert changes(y, variance, alarm=1e-3) == ()


def test_long_series_are_tried_at_a_limited_number_of_moments():
    assert len(shapes_of(5000).values) <= 1200


def test_the_scatter_belongs_to_the_model():
    """Beside a step of ten deviations the flights scatter by one, and a second step shows."""
    y = series(6) + 10.0 * (np.arange(25) >= 3) + 5.0 * (np.arange(25) >= 14)
    assert [(c.kind, c.first) for c in sorted(changes(y, 0.0), key=lambda c: c.first)] == [
        ("step", 3),
        ("step", 14),
    ]


def test_wear_of_many_vehicles_hides_no_wear():
    worn = [series(i, 12) + 1.0 * np.arange(12) * (i < 6) for i in range(8)]
    group = np.repeat(np.arange(8), 12)
    found = find_changes(np.concatenate(worn), np.full(96, 0.1), group, alarm=1e-3).of_group
    assert [bool(of_one) for of_one in found] == [True] * 6 + [False] * 2


@given(
    values=st.lists(st.integers(-100, 100), min_size=1, max_size=12),
    stated=st.sampled_from([0.0, 0.1, 10.0]),
    scale=st.sampled_from([2.0**-40, 2.0**20]),
)
@settings(max_examples=30, deadline=None)
def test_any_values_have_an_answer_in_any_unit(values, stated, scale):
    y = np.array(values, dtype=float)
    found, scaled = changes(y, stated), changes(scale * y, scale**2 * stated)
    assert [(c.kind, c.first) for c in found] == [(c.kind, c.first) for c in scaled]
    for change in found:
        assert change.low <= change.size <= change.high
        assert change.earliest <= change.first <= change.latest


def test_stated_variances_are_held_against_what_is_seen():
    group = np.repeat(np.arange(8), 25)
    y = np.concatenate([series(i) + 3.0 * (np.arange(25) > 5) * (i < 3) for i in range(8)])

    def share(stated: float, n: int = 200) -> float:
        variance = np.full(n, stated)
        return find_changes(y[:n], variance, group[:n], alarm=1e-4, overstated=True).share

    assert share(100.0) == pytest.approx(0.01, rel=0.4)
    assert share(0.3) == pytest.approx(1.0, rel=0.01)
    assert share(100.0, 6) == 1.0  # too few to tell
