"""Two measurements of one scale: their mean, and what remains where they contradict each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rotorfit.estimation.measured import (
    CHANCE,
    CONTRADICTION,
    DOUBTED,
    Measured,
    change_of_means,
    combine_scales,
    mean_scale,
    scale_deviations,
)

scales = st.floats(-20.0, 5.0).map(lambda x: float(np.exp(x)))
shares = st.floats(0.003, 0.5)
factors = st.floats(0.05, 20.0)


def scale(value: float, share: float) -> Measured:
    return Measured(value=value, std=share * abs(value))


@given(scales, shares, shares, st.floats(-CHANCE, CHANCE))
def test_two_that_agree_are_averaged_by_their_relative_variances(value, own, theirs, apart):
    first = scale(value, own)
    second = scale(value * float(np.exp(apart * np.hypot(own, theirs))), theirs)
    found = combine_scales(first, second)
    shift = float(np.log(second.value / value)) * own**2 / (own**2 + theirs**2)
    assert np.log(found.value / value) == pytest.approx(shift, abs=1e-9)
    chance = own * theirs / np.hypot(own, theirs)
    assert found.share == pytest.approx(chance * max(abs(apart), 1.0), rel=1e-6)


@given(scales, shares, st.floats(1e-12, 0.5), st.floats(0.0, 3.0))
def test_a_wild_estimate_near_zero_does_not_pull(value, share, factor, wild_share):
    """However sure it is of itself, and however small its absolute deviation is.

    The mean is moved by at most five deviations of the sound one, and by nothing where the two are
    ten deviations apart.
    """
    first, wild = scale(value, share), scale(factor * value, wild_share + 1e-6)
    found = combine_scales(first, wild)
    assert abs(np.log(found.value / value)) <= CONTRADICTION * share * (1.0 + 1e-9)
    if scale_deviations(first, wild) >= 2.0 * CONTRADICTION:
        assert found.value == pytest.approx(value)


@given(scales, shares, st.floats(-0.5, 0.0), shares)
def test_one_below_zero_moves_nothing(value, share, factor, other):
    first = scale(value, share)
    found = combine_scales(first, Measured(value=factor * value, std=other * value))
    assert found.value == pytest.approx(value)
    assert found.std >= first.std * (1.0 - 1e-12)


@given(scales, shares, shares, st.floats(DOUBTED, 4.0 * CONTRADICTION), st.sampled_from([-1, 1]))
def test_the_interval_reaches_both_of_two_that_differ(value, own, theirs, apart, side):
    """Whichever is wrong, the other is in the 95 % interval of the logarithm."""
    first = scale(value, own)
    second = scale(value * float(np.exp(side * apart * np.hypot(own, theirs))), theirs)
    found = combine_scales(first, second)
    for one in (first, second):
        assert 1.96 * found.share >= abs(np.log(one.value / found.value)) * (1.0 - 1e-9)
    assert 1.96 * found.share <= 1.5 * apart * np.hypot(own, theirs)


@given(scales, shares, factors, shares)
def test_two_are_no_surer_than_without_a_difference(value, own, factor, theirs):
    found = combine_scales(scale(value, own), scale(factor * value, theirs))
    assert found.share >= own * theirs / np.hypot(own, theirs) * (1.0 - 1e-9)


@given(scales, factors, shares, shares, st.floats(-30.0, 30.0))
def test_no_unit_matters(value, factor, own, theirs, unit):
    by = float(np.exp(unit))
    first, second = scale(value, own), scale(factor * value, theirs)
    found = combine_scales(first, second)
    scaled = combine_scales(scale(by * value, own), scale(by * factor * value, theirs))
    assert scaled.value == pytest.approx(by * found.value, rel=1e-9)
    assert scaled.share == pytest.approx(found.share, rel=1e-9)


@given(st.floats(0.01, 0.2), st.floats(0.01, 0.2))
def test_nothing_jumps_as_two_move_apart(own, theirs):
    """From equal to thirty deviations apart in small steps, value and interval move little."""
    apart = np.linspace(0.0, 30.0, 3001) * np.hypot(own, theirs)
    found = [combine_scales(scale(1.0, own), scale(float(np.exp(x)), theirs)) for x in apart]
    step = float(apart[1])
    assert np.abs(np.diff(np.log([one.value for one in found]))).max() < 8.0 * step
    assert np.abs(np.diff([one.share for one in found])).max() < 8.0 * step


def test_a_mean_of_many_is_geometric():
    found = mean_scale([scale(1.0, 0.1), scale(4.0, 0.1)])
    assert found.value == pytest.approx(2.0)
    assert found.share == pytest.approx(0.1 / 2**0.5)
    spread = mean_scale([scale(1.0, 0.1), scale(4.0, 0.1)], spread=1.0)
    assert spread.share == pytest.approx((1.01 / 2) ** 0.5)


def test_an_accelerometer_behind_a_filter_leaves_the_weight():
    """8.6e-9 +- 51 % against 1.567e-6 +- 2.1 %, as in a flight of NeuroBEM."""
    found = combine_scales(scale(1.567e-6, 0.021), scale(8.6e-9, 0.51))
    assert found.value == pytest.approx(1.567e-6, rel=1e-9)
    assert 1.96 * found.share > 5.0


def test_a_change_of_means_is_that_of_students_test():
    rng = np.random.default_rng(3)
    before, after = rng.normal(size=(7, 2)), rng.normal(0.5, 1.0, (4, 2))
    change, std = change_of_means(before, after)
    whole = stats.ttest_ind(after, before)
    np.testing.assert_allclose(change / std, whole.statistic)
    assert float(change_of_means(before[:, 0], after[:, 0])[1]) == pytest.approx(std[0])
