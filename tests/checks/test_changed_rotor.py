"""Halves of a flight differ by more than its parts do, or it is motion."""

import numpy as np
import pytest

from rotorfit.checks.motors.changed_thrust import LEAST_CHANGE, half_change


def squares_of_circles(*, period, change=0.0, seconds=60.0):
    """Return squared speeds of a flight that leans to one side for half of each circle.

    `change`: of rotors 1 and 3 against the others in the second half.
    """
    time = np.arange(0.0, seconds, 0.01)
    lean = 0.3 * np.sin(2.0 * np.pi * time / period)[:, None] * [1.0, 1.0, -1.0, -1.0]
    late = (time >= 0.5 * seconds)[:, None] * [1.0, -1.0, 1.0, -1.0]
    return 1.0 + lean + change * late


@pytest.mark.parametrize("period", [50.0, 55.0])
def test_slow_circles_are_no_change_of_a_rotor(period):
    squares = squares_of_circles(period=period)
    first, second = (half.mean(axis=0) / half.mean() / 4.0 for half in np.array_split(squares, 2))
    assert np.abs(second - first).max() > LEAST_CHANGE
    assert half_change(squares) is None


def test_a_small_change_is_not_said():
    assert half_change(squares_of_circles(change=0.1, period=0.5)) is None


@pytest.mark.parametrize(("seconds", "count"), [(60.0, 12), (9.0, 4)])
def test_a_battery_that_shifts_is_more_than_its_parts_differ_by(seconds, count):
    found = half_change(squares_of_circles(change=0.2, period=0.5, seconds=seconds), count)
    assert found.after - found.before == pytest.approx(
        0.05 * np.sign(found.after - found.before), rel=0.1
    )
    assert found.moment == 0.5
