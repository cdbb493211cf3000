"""Pose to motion: against exact rotations, both ways, over gimbal lock and sign flips."""

import numpy as np
import pytest
from bryant import (
    bryant_angles,
    bryant_matrix,
    bryant_matrix_rate,
    motion_from_bryant,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError
from rotorfit.flight.kinematics import (
    continuous_quaternions,
    motion_from_quaternions,
    rotated,
    rotation_matrices,
)
from rotorfit.flight.signals import low_pass, smooth_motors, spline_derivatives

RATE = 200.0
TIME = np.arange(400) / RATE
INNER = slice(30, -30)
G = np.array([0.0, 0.0, 9.80665])

angles = st.tuples(st.floats(-3.0, 3.0), st.floats(-1.2, 1.2), st.floats(-3.0, 3.0))
vectors = st.tuples(*[st.floats(-4.0, 4.0)] * 3)
seeds = st.integers(0, 2**32 - 1)


def wxyz(rotations: Rotation) -> np.ndarray:
    return np.roll(rotations.as_quat(), 1, axis=1)


def swinging(seed, *, size=0.4):
    """Bryant angles and positions that are sums of slow sines, with their exact derivatives."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * rng.uniform(0.3, 2.0, size=(6, 1))
    phase, amount = rng.uniform(0, 6.3, size=(6, 1)), rng.uniform(0.3, 1.0, size=(6, 1)) * size
    x = amount * np.sin(w * TIME + phase)
    dx = amount * w * np.cos(w * TIME + phase)
    ddx = -amount * w**2 * np.sin(w * TIME + phase)
    return [(part[:3].T, part[3:].T) for part in (x, dx, ddx)]


@given(eta=angles, rate=vectors)
@settings(deadline=None)
def test_bryant_rates_turn_the_attitude(eta, rate):
    """exp(omega h) is the turn from R(eta) to R(eta + eta' h)."""
    eta, rate, h = np.array([eta]), np.array([rate]), 1e-4
    before = Rotation.from_euler("ZYX", eta - 0.5 * h * rate)
    after = Rotation.from_euler("ZYX", eta + 0.5 * h * rate)
    turn = (before.inv() * after).as_rotvec() / h
    omega = np.einsum("nij,nj->ni", bryant_matrix(eta), rate)
    np.testing.assert_allclose(turn, omega, atol=1e-5)


@given(eta=angles, rate=vectors)
@settings(deadline=None)
def test_rate_of_the_bryant_matrix_is_its_derivative(eta, rate):
    eta, rate, h = np.array([eta]), np.array([rate]), 1e-6
    difference = (bryant_matrix(eta + h * rate) - bryant_matrix(eta - h * rate)) / (2 * h)
    np.testing.assert_allclose(bryant_matrix_rate(eta, rate), difference, atol=1e-7)


@given(seed=seeds)
@settings(deadline=None, max_examples=20)
def test_both_forms_agree_with_the_exact_motion(seed):
    (eta, place), (deta, velocity), (ddeta, acceleration) = swinging(seed)
    R = Rotation.from_euler("ZYX", eta)
    T, dT = bryant_matrix(eta), bryant_matrix_rate(eta, deta)
    w = np.einsum("nij,nj->ni", T, deta)
    dw = np.einsum("nij,nj->ni", dT, deta) + np.einsum("nij,nj->ni", T, ddeta)
    q = continuous_quaternions(wxyz(R))
    for found in (motion_from_quaternions(place, q, RATE), motion_from_bryant(place, eta, RATE)):
        np.testing.assert_allclose(found.angular_velocity[INNER], w[INNER], atol=1e-6)
        np.testing.assert_allclose(found.angular_acceleration[INNER], dw[INNER], atol=1e-4)
        force = R.inv().apply(acceleration + G)
        np.testing.assert_allclose(found.specific_force[INNER], force[INNER], atol=1e-4)
        np.testing.assert_allclose(found.velocity[INNER], R.inv().apply(velocity)[INNER], atol=1e-6)


def test_bryant_angles_come_back():
    eta = np.array([[0.3, -0.4, 0.5], [0.31, -0.41, 0.52]])
    np.testing.assert_allclose(bryant_angles(wxyz(Rotation.from_euler("ZYX", eta))), eta)


def test_bryant_angles_do_not_jump_by_a_turn():
    eta = np.stack([4.0 * TIME, 0.1 * np.sin(TIME), 0.0 * TIME], axis=1)
    np.testing.assert_allclose(bryant_angles(wxyz(Rotation.from_euler("ZYX", eta))), eta, atol=1e-9)


def test_a_loop_through_gimbal_lock():
    """A pitch of a whole turn at a steady 2 pi rad/s: quaternions do not see the lock."""
    R = Rotation.from_euler("Y", 2 * np.pi * TIME[:, None] / 1.0)
    q = continuous_quaternions(wxyz(R))
    found = motion_from_quaternions(np.zeros((400, 3)), q, RATE)
    np.testing.assert_allclose(found.angular_velocity[INNER], [[0, 2 * np.pi, 0]] * 340, atol=1e-7)
    np.testing.assert_allclose(found.angular_acceleration[INNER], 0.0, atol=1e-4)
    with pytest.raises(FlightError, match="pitch reaches 90 degrees, where Bryant angles have no"):
        motion_from_bryant(np.zeros((400, 3)), bryant_angles(q), RATE)


@given(seed=seeds)
@settings(deadline=None, max_examples=20)
def test_flipped_signs_of_quaternions_change_nothing(seed):
    (eta, place), _, _ = swinging(seed)
    q = continuous_quaternions(wxyz(Rotation.from_euler("ZYX", eta)))
    rng = np.random.default_rng(seed)
    flipped = (
        q * rng.choice([-1.0, 1.0], size=(len(q), 1)) * rng.uniform(0.9, 1.1, size=(len(q), 1))
    )
    again = continuous_quaternions(flipped)
    np.testing.assert_allclose(again * np.sign(again[0] @ q[0]), q, atol=1e-14)
    one, two = (motion_from_quaternions(place, x, RATE) for x in (q, again))
    np.testing.assert_allclose(one.angular_acceleration, two.angular_acceleration, atol=1e-6)


@pytest.mark.parametrize(("frequency", "limit"), [(1.0, 1e-8), (5.0, 2e-6), (20.0, 4e-4)])
def test_spline_derivatives_of_a_sine(frequency, limit):
    w = 2 * np.pi * frequency
    first, second = spline_derivatives(np.sin(w * TIME)[:, None], RATE)
    assert np.abs(first[INNER, 0] / w - np.cos(w * TIME[INNER])).max() < limit
    assert np.abs(second[INNER, 0] / w**2 + np.sin(w * TIME[INNER])).max() < limit


def test_second_difference_is_numerovs_average_of_acceleration():
    """The rule of the docstring: [1 -2 1] / h^2 against [1 10 1] / 12, to the fourth order."""
    errors = []
    for h in (0.02, 0.01):
        t = np.arange(0, 2, h)
        x, ddx = np.sin(5 * t), -25 * np.sin(5 * t)
        seen = (x[2:] - 2 * x[1:-1] + x[:-2]) / h**2
        errors.append(np.abs(seen - (ddx[2:] + 10 * ddx[1:-1] + ddx[:-2]) / 12).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.02)


def test_low_pass_is_the_same_on_any_clock():
    """3 dB at the cut-off, nothing below, and at 100 Hz what it is at 1000 Hz."""
    for frequency, gain in ((1.0, 1.0), (10.0, 0.9984), (20.0, np.sqrt(0.5)), (40.0, 0.0093)):
        for rate in (100.0, 1000.0):
            t = np.arange(int(6 * rate)) / rate
            x = np.sin(2 * np.pi * frequency * t)[:, None]
            middle = slice(int(2 * rate), int(4 * rate))
            found = low_pass(x, rate, 20.0)[middle, 0] @ x[middle, 0]
            assert found / (x[middle, 0] @ x[middle, 0]) == pytest.approx(gain, abs=2e-4)


def test_low_pass_keeps_a_ramp():
    ramp = np.stack([3.0 + 2.0 * TIME, -TIME], axis=1)
    np.testing.assert_allclose(low_pass(ramp, RATE, 10.0), ramp, atol=1e-12)


def test_motors_are_moved_and_lagged_as_smooth_signals():
    w, lag, delay = 2 * np.pi * 2.0, 0.04, 0.0137
    u = 400 + 50 * np.sin(w * TIME)[:, None]
    gain, phase = 1 / np.hypot(1, w * lag), np.arctan(w * lag)
    value, slope = smooth_motors(u, RATE, lag=lag, delay=delay)
    late = slice(150, -10)
    expected = 400 + 50 * gain * np.sin(w * (TIME - delay) - phase)
    np.testing.assert_allclose(value[late, 0], expected[late], atol=0.02)
    expected = 50 * w * gain * np.cos(w * (TIME - delay) - phase)
    np.testing.assert_allclose(slope[late, 0], expected[late], atol=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_rotation_matrices_turn_as_the_quaternions_do(seed):
    rng = np.random.default_rng(seed)
    q, v = rng.standard_normal((20, 4)), rng.standard_normal((20, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    matrices = rotation_matrices(q)
    assert np.allclose(matrices, Rotation.from_quat(q, scalar_first=True).as_matrix(), atol=1e-14)
    assert np.allclose((matrices @ v[:, :, None])[:, :, 0], rotated(q, v), atol=1e-14)
