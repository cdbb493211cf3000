from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.simulation.body import (
    accelerations,
    derivative,
    quaternion_from_euler,
    rigid_body,
    rotation,
    step,
    with_drag,
)
from rotorfit.simulation.experiments import paper_vehicle
from rotorfit.simulation.truth import GRAVITY, Truth, steiner, tensor_elements

number = st.floats(-3.0, 3.0)
vector = st.tuples(number, number, number)
B = paper_vehicle("B").truth
NOTHING = (0.0,) * 9
TUMBLING = (1.2, -2.0, 3.0, *quaternion_from_euler(0.4, -0.3, 1.0), 0.5, -1.0, 2.0, 1.0, 2.0, 3.0)


def wrench_of(force, torque, spin=(0.0, 0.0, 0.0)):
    return (*force, *torque, *spin)


def fly(truth: Truth, wrench, *, seconds: float, steps: int, state=TUMBLING):
    body = rigid_body(truth)
    for _ in range(steps):
        state = step(body, [wrench] * 3, state, seconds / steps)
    return state


def com_position(truth: Truth, state) -> np.ndarray:
    return np.array(state[10:]) + np.array(rotation(state[3:7])) @ truth.center_of_mass


@given(vector, vector, vector, vector)
def test_accelerations_satisfy_newton_euler(force, torque, spin, w):
    a, dw = map(np.array, accelerations(rigid_body(B), wrench_of(force, torque, spin), w))
    I, ms, w = B.inertia_tensor, np.array(B.first_moments), np.array(w)
    f = B.mass * a + np.cross(dw, ms) + np.cross(w, np.cross(w, ms))
    tau = I @ dw + np.cross(w, I @ w + spin) + np.cross(ms, a)
    np.testing.assert_allclose(f, force, atol=1e-13)
    np.testing.assert_allclose(tau, torque, atol=1e-13)


def test_free_rotation_conserves_angular_momentum_and_energy():
    end = fly(B, NOTHING, seconds=5.0, steps=4000)
    I = B.com_inertia

    def invariants(state):
        w = np.array(state[:3])
        return [*np.array(rotation(state[3:7])) @ I @ w, w @ I @ w / 2]

    np.testing.assert_allclose(invariants(end), invariants(TUMBLING), rtol=1e-8)


def test_a_falling_body_feels_nothing_at_its_centre_of_mass():
    a, dw = map(np.array, accelerations(rigid_body(B), NOTHING, TUMBLING[:3]))
    w, c = np.array(TUMBLING[:3]), B.center_of_mass
    np.testing.assert_allclose(a + np.cross(dw, c) + np.cross(w, np.cross(w, c)), 0, atol=1e-14)
    assert np.linalg.norm(a) > 0.1


def test_the_centre_of_mass_of_a_falling_body_follows_a_parabola():
    t = 1.5
    end = fly(B, NOTHING, seconds=t, steps=1200)
    R, w = np.array(rotation(TUMBLING[3:7])), np.array(TUMBLING[:3])
    v = R @ (np.array(TUMBLING[7:10]) + np.cross(w, B.center_of_mass))
    expected = com_position(B, TUMBLING) + v * t - [0, 0, GRAVITY * t**2 / 2]
    np.testing.assert_allclose(com_position(B, end), expected, atol=1e-9)


def test_parallel_axis_another_origin_flies_the_same_path():
    shift = np.array([0.05, -0.08, 0.03])  # of the new origin from the old one
    c = B.center_of_mass - shift
    moved = replace(
        B,
        first_moments=tuple((B.mass * c).tolist()),
        inertia=tensor_elements(B.com_inertia + B.mass * steiner(c)),
    )
    force, torque = np.array([0.4, -0.3, 11.0]), np.array([0.02, -0.03, 0.01])
    there = wrench_of(force, torque - np.cross(shift, force))
    w, R = np.array(TUMBLING[:3]), np.array(rotation(TUMBLING[3:7]))
    v = np.array(TUMBLING[7:10]) + np.cross(w, shift)
    start = (*TUMBLING[:7], *v, *(np.array(TUMBLING[10:]) + R @ shift))
    one = fly(B, wrench_of(force, torque), seconds=1.0, steps=1000)
    other = fly(moved, there, seconds=1.0, steps=1000, state=start)
    np.testing.assert_allclose(other[:7], one[:7], atol=1e-10)
    np.testing.assert_allclose(com_position(moved, other), com_position(B, one), atol=1e-10)


def test_hover_is_an_equilibrium_with_an_offset_centre_of_mass():
    x, y, _ = B.first_moments
    hover = wrench_of((0.0, 0.0, B.mass * GRAVITY), (y * GRAVITY, -x * GRAVITY, 0.0))
    rest = (0.0, 0.0, 0.0, 1.0, *(0.0,) * 9)
    np.testing.assert_allclose(derivative(rigid_body(B), hover, rest), 0, atol=1e-13)


@given(vector, vector, vector, vector)
def test_mirror_image_flies_the_mirror_path(force, torque, w, v):
    xx, yy, zz, xy, xz, yz = B.inertia
    x, y, z = B.first_moments
    mirrored = replace(B, first_moments=(x, -y, z), inertia=(xx, yy, zz, -xy, xz, -yz))
    polar, axial = np.array([1, -1, 1]), np.array([-1, 1, -1])  # vectors and pseudo-vectors
    q = np.array(quaternion_from_euler(0.2, 0.1, -0.4))
    image = np.array([*axial, 1, *axial, *polar, *polar])
    state = np.array([*w, *q, *v, 0.0, 0.0, 1.0])
    there = derivative(rigid_body(B), wrench_of(force, torque), tuple(state.tolist()))
    here = derivative(
        rigid_body(mirrored),
        wrench_of(polar * force, axial * torque),
        tuple((image * state).tolist()),
    )
    np.testing.assert_allclose(here, image * there, rtol=1e-12, atol=1e-12)


def test_halving_the_step_divides_the_error_by_sixteen():
    wrench = wrench_of((0.5, 0.2, 12.0), (0.1, -0.05, 0.02), (0.01, 0.0, 0.02))
    draggy = replace(B, drag=(0.3, 0.2, 0.1))
    ends = [
        np.array(fly(draggy, wrench, seconds=1.0, steps=steps)) for steps in (50, 100, 200, 6400)
    ]
    errors = [np.linalg.norm(end - ends[-1]) for end in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4, 4], abs=0.3)


def test_drag_opposes_the_velocity_along_each_axis():
    body = rigid_body(replace(B, drag=(0.1, 0.2, 0.3)))
    spinning = (*(0.0,) * 6, 0.1, 0.2, 0.3)
    slowed = with_drag(body, spinning, (1.0, -2.0, 3.0), (0.7, -0.8, 0.9))
    np.testing.assert_allclose(slowed[:3], [-0.1, 0.4, -0.9])
    assert slowed[3:] == spinning[3:]


def test_drag_acts_at_its_point_by_the_velocity_there():
    body = rigid_body(replace(B, drag=(0.1, 0.2, 0.3), drag_position=(0.0, 0.0, 0.5)))
    ahead = with_drag(body, NOTHING, (2.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(ahead[:3], [-0.2, 0.0, 0.0])
    np.testing.assert_allclose(ahead[3:6], [0.0, -0.1, 0.0])  # over the origin: nose up
    # Rolling to the right at 4 rad/s about the origin, it goes to the right at 2 m/s.
    rolling = with_drag(body, NOTHING, (0.0, 0.0, 0.0), (4.0, 0.0, 0.0))
    np.testing.assert_allclose(rolling[:3], [0.0, 0.4, 0.0])
    np.testing.assert_allclose(rolling[3:6], [-0.2, 0.0, 0.0])


@given(vector, vector, vector, vector, vector)
def test_drag_is_a_force_at_its_point(coefficients, place, velocity, w, force):
    body = rigid_body(replace(B, drag=coefficients, drag_position=place))
    slowed = with_drag(body, wrench_of(force, w), velocity, w)
    drag = -np.array(coefficients) * (np.array(velocity) + np.cross(w, place))
    expected = [*(force + drag), *(w + np.cross(place, drag)), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(slowed, expected, atol=1e-12)


def test_the_columns_of_many_samples_give_what_each_alone_gives():
    body = rigid_body(replace(B, drag=(0.1, 0.2, 0.3), drag_position=(0.1, -0.2, 0.5)))
    rows = np.random.default_rng(1).normal(size=(20, 15))
    x = rows.T
    together = accelerations(body, with_drag(body, x[:9], x[9:12], x[12:]), x[12:])
    alone = [
        accelerations(body, with_drag(body, row[:9], row[9:12], row[12:]), row[12:])
        for row in rows.tolist()
    ]
    np.testing.assert_allclose(np.transpose(together, (2, 0, 1)), alone, rtol=1e-12, atol=1e-12)
