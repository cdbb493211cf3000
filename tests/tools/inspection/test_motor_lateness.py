"""Shares of the turns that shifted motor data explain, and the lag of commands."""

import numpy as np
import pytest

from rotorfit.tools.inspection.motor_lateness import explained_shares


def explained_by_regression(turn, squares, shift, reach):
    """Return the mean share by ordinary least squares, column by column."""
    n = len(turn)
    y = turn[reach : n - reach]
    x = np.column_stack([squares[reach - shift : n - reach - shift], np.ones(n - 2 * reach)])
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return float((1.0 - left.var(axis=0) / y.var(axis=0)).mean())


def test_shares_are_those_of_a_regression_at_each_shift():
    chance = np.random.default_rng(1)
    squares = 1e6 + 1e4 * np.cumsum(chance.normal(size=(900, 4)), axis=0)
    turn = np.roll(squares, 7, axis=0)[:, :2] * [1e-3, -2e-3] + 20.0 * chance.normal(size=(900, 2))
    shifts = range(-20, 21, 4)
    found = explained_shares(turn, squares, shifts, 20)
    expected = [explained_by_regression(turn, squares, shift, 20) for shift in shifts]
    assert found == pytest.approx(expected, abs=1e-9)
    assert shifts[int(np.argmax(found))] == 8  # the nearest to the 7 samples that it is late


def test_motors_that_stand_still_explain_nothing():
    turn = np.random.default_rng(2).normal(size=(400, 2))
    assert explained_shares(turn, np.full((400, 4), 9e5), range(-4, 5, 2), 4) == pytest.approx(0.0)
