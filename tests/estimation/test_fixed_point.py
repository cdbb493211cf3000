"""Extrapolation of iterations whose steps shrink by a share."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.estimation.fixed_point import LONGEST_LEAP, FixedPointRounds

STD = np.array([2.0, 0.5, 1.0])


def iterations(shares, *, accelerate, close=1e-6):
    """Count the steps of x <- x + (1 - shares) (end - x) in a turned basis to its end."""
    Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    A = np.diag(STD) @ Q @ np.diag(1.0 - np.array(shares)) @ Q.T @ np.diag(1.0 / STD)
    x, end, rounds = 0.3 * STD, np.zeros(3), FixedPointRounds()
    for count in range(1, 1000):
        step = A @ (end - x)
        if float(np.abs(step / STD).max()) <= close:
            return count, x
        leap = rounds.leap(x, step, STD) if accelerate else None
        x = x + (step if leap is None else leap)
    raise AssertionError("it comes to no end")


@given(st.tuples(*[st.floats(-0.6, 0.93)] * 3))
def test_a_linear_iteration_ends_where_it_would_have(shares):
    count, x = iterations(shares, accelerate=True)
    assert np.abs(x / STD).max() < 1e-4
    assert count <= iterations(shares, accelerate=False)[0] + 6


def test_slow_steps_take_few():
    plain, _ = iterations((0.9, 0.7, 0.3), accelerate=False)
    quick, _ = iterations((0.9, 0.7, 0.3), accelerate=True)
    assert plain > 80 and quick < 15


def test_long_steps_are_left_alone():
    rounds = FixedPointRounds()
    for k in range(5):
        assert rounds.leap(np.full(3, float(k)), 1.5 * STD, STD) is None


def test_no_leap_is_far_longer_than_its_step():
    rounds, point = FixedPointRounds(), np.zeros(3)
    for k in range(8):
        step = STD * (0.5 + 1e-4 * np.sin(k + np.arange(3.0)))
        leap = rounds.leap(point, step, STD)
        assert leap is None or np.abs(leap / STD).max() <= LONGEST_LEAP * np.abs(step / STD).max()
        point = point + step


def test_rounds_are_forgotten_where_a_leap_makes_steps_longer():
    rounds, point, share = FixedPointRounds(), np.zeros(3), 0.8
    for k in range(3):
        step = 0.2 * share**k * STD
        leap = rounds.leap(point, step, STD)
        point = point + step
    assert leap is not None
    assert rounds.leap(point, 0.9 * STD, STD) is None and rounds.points == []
