"""Steps of Levenberg and Marquardt, their damping, and where crawling ones lead."""

import numpy as np
import pytest

from rotorfit.estimation.damped_steps import damped_step, reduced_damping


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
