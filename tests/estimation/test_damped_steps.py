"""Steps of Levenberg and Marquardt, their damping, and where crawling ones lead."""

import numpy as np
import pytest

from rotorfit.estimation.damped_steps import damped_step, extrapolated, reduced_damping


def test_a_damped_step_solves_the_equations_with_a_given_score():
    rng = np.random.default_rng(5)
    A, b, extra = rng.normal(size=(30, 3)), rng.normal(size=30), 5.0 * rng.normal(size=3)
    taken = damped_step(A.T @ A, A.T @ b + extra, 0.0)
    step, std = taken.step, taken.std
    squares = [float((A @ x - b) @ (A @ x - b) - 2.0 * extra @ x) for x in (0.0 * step, step)]
    assert taken.predicted_gain == pytest.approx(squares[0] - squares[1], rel=1e-9)
    np.testing.assert_allclose(step, np.linalg.solve(A.T @ A, A.T @ b + extra), rtol=1e-9)
    np.testing.assert_allclose(std, np.sqrt(np.diag(np.linalg.inv(A.T @ A))), rtol=1e-9)


def test_damping_falls_to_a_third_at_the_predicted_gain():
    assert reduced_damping(3.0, 5.0, 5.0) == pytest.approx(1.0)
    assert reduced_damping(3.0, 50.0, 5.0) == pytest.approx(1.0)
    assert reduced_damping(3.0, 2.5, 5.0) == pytest.approx(3.0)
    assert reduced_damping(3.0, 0.0, 5.0) == pytest.approx(6.0)
    assert reduced_damping(1e-9, 5.0, 5.0) == 1e-9


def test_steps_that_shrink_by_one_ratio_are_followed_to_the_end():
    """A geometric series from 7 by steps of 2 and 1.8: 7 + 2 / (1 - 0.9)."""
    path = [np.array([7.0]), np.array([9.0]), np.array([10.8])]
    assert extrapolated(path, np.ones(1)) == pytest.approx([27.0])
    assert extrapolated(path, 100.0 * np.ones(1)) == pytest.approx([27.0])


def test_steps_that_are_small_already_are_not_extrapolated_back():
    assert extrapolated([np.zeros(1), np.ones(1)], np.ones(1)) is None
    assert extrapolated([np.array([k]) for k in (0.0, 1.0, 2.0)], np.ones(1)) is None
    there = extrapolated([np.array([k]) for k in (0.0, 1.0, 0.9)], np.ones(1))
    assert there == pytest.approx([0.9])
