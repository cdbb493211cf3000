"""The half-width by the sides of the frame: a ruler's, or what the flights show."""

import numpy as np
import pytest

from rotorfit.fit.frame_sides import FrameSides


def sides(value, std, blocks=20.0, by_mistake=1.0):
    one = np.ones(1)
    return FrameSides(
        declared=1.0,
        ruler=0.01,
        value=value,
        std=std,
        blocks=blocks,
        slopes=one,
        by_mistake=by_mistake * one,
    )


def half_width(one):
    return float(one.half_widths[0])


def test_sides_that_no_flight_shows_are_those_of_a_ruler():
    untold = sides(0.0, np.inf)
    assert untold.measured == pytest.approx(0.98, abs=0.005)
    assert 0.02 < half_width(untold) < 0.025
    assert half_width(sides(0.0, 0.01)) == pytest.approx(0.02, abs=0.002)
    assert half_width(sides(-0.05, 0.022, 12.0)) < 0.025


@pytest.mark.parametrize("value", [0.0, 0.1, 0.24, 0.3])
def test_a_flight_that_hardly_tells_leaves_the_ruler(value):
    """Known to +- .2: nothing that may be there by chance makes the interval a mistake's."""
    assert half_width(sides(value, 0.2, 14.0)) < 0.025


def test_one_side_that_is_surely_wrong_moves_the_mean_arm_too():
    stated = [sides(-0.11, 0.005, 12.0, by_mistake=k) for k in (1.0, 2.0)]
    assert stated[0].measured < 0.1
    assert half_width(stated[0]) == pytest.approx(0.13, abs=0.02)
    assert half_width(stated[1]) == pytest.approx(2.0 * half_width(stated[0]), rel=0.05)


def test_the_half_width_grows_to_a_mistake_without_a_jump():
    far = [sides(-value, 0.02, 12.0) for value in np.linspace(0.0, 0.5, 101)]
    half = np.array([half_width(one) for one in far])
    chance = np.array([one.measured for one in far])
    assert np.all(np.diff(chance) < 1e-9)
    assert np.all(np.diff(half) > -1e-3)
    assert np.diff(half).max() < 0.05
    assert half[-1] > 0.5
    assert chance[-1] < 1e-4 < 0.9 < chance[20]
