"""What the air does to rotors that move through it: each effect by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.model.terms.air import induced_velocity
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.simulation.body import (
    derivative,
    quaternion_from_euler,
    rigid_body,
    rotation,
    rotor_air,
    solve_inflow,
    with_rotor_air,
)
from rotorfit.simulation.experiments import layout_vehicle, paper_vehicle

HOVER = 5.0
STILL = (0.0, 0.0, 0.0)
NOTHING = (0.0,) * 9
velocity = st.floats(-15.0, 15.0)


def acting(air, speeds, *, v=STILL, w=STILL):
    """Return force and torque of the air on rotors at these speeds."""
    return np.array(with_rotor_air(air, (*NOTHING, *speeds), v, w)[:6])


def two_rotors(**air):
    places = ((0.3, 0.4, 0.1), (-0.1, 0.0, 0.0))
    vehicle = Vehicle(rotors=tuple(Rotor(position=p, spin="cw") for p in places))
    return rotor_air(replace(paper_vehicle("A").truth, **air), vehicle)


def test_a_turn_is_held_back_by_rotors_far_out_and_fast():
    turned = acting(two_rotors(rotor_drag=2e-5), (500.0, 800.0), w=(0.0, 0.0, 3.0))
    # Force 2e-5 * 500 * w_z * 0.5 at 0.5 m, and 2e-5 * 800 * w_z * 0.1 at 0.1 m
    assert turned[5] == pytest.approx(-3.0 * (2.5e-3 + 1.6e-4), rel=1e-12)


def test_rotors_are_held_back_where_they_are():
    flown = acting(two_rotors(rotor_drag=2e-5), (500.0, 800.0), v=(4.0, 0.0, 7.0))
    forces = -2e-5 * np.array([500.0, 800.0]) * 4.0
    np.testing.assert_allclose(flown[:3], [forces.sum(), 0.0, 0.0], rtol=1e-12)
    # Rotor 1 is 0.1 m up: nose up is about -y; and 0.4 m to the left: the turn is to the left.
    np.testing.assert_allclose(flown[3:], [0.0, 0.1 * forces[0], -0.4 * forces[0]], rtol=1e-12)


def test_a_tilted_rotor_is_held_back_across_its_axis_alone():
    rotor = Rotor(position=(0.0, 0.0, 0.0), spin="cw", axis=(0.6, 0.0, 0.8))
    air = rotor_air(replace(paper_vehicle("A").truth, rotor_drag=1e-4), Vehicle(rotors=(rotor,)))
    along = acting(air, (500.0,), v=(6.0, 0.0, 8.0))
    np.testing.assert_allclose(along, 0.0, atol=1e-15)
    across = acting(air, (500.0,), v=(-8.0, 0.0, 6.0))
    np.testing.assert_allclose(across[:3], [0.4, 0.0, -0.3], rtol=1e-12)


def test_rotors_at_rest_in_the_air_lose_nothing():
    air = two_rotors(rotor_drag=2e-5, inflow=1e-4, wake_moment=(1e-3, 2e-3), propeller=0.25)
    np.testing.assert_allclose(acting(air, (500.0, 800.0)), 0.0, atol=1e-12)
    assert rotor_air(paper_vehicle("A").truth, paper_vehicle("A").vehicle) is None


def test_hover_is_that_of_momentum_theory():
    truth = replace(paper_vehicle("A").truth, mass=2.4, inflow=1e-4, propeller=0.2)
    air = rotor_air(truth, paper_vehicle("A").vehicle)
    disks = 4.0 * np.pi * 0.01
    # Thrust is the mass flow rho A v_h times twice v_h.
    assert 1.2 * disks * air.hover * 2.0 * air.hover == pytest.approx(2.4 * 9.80665, rel=1e-12)


@given(velocity, velocity)
def test_induced_velocity_solves_momentum_theory(across, along):
    along = max(along, -max(0.5 * HOVER, 2.0 * abs(across)))  # where there is one solution
    nu = solve_inflow(across**2, along, HOVER)
    assert nu * np.hypot(across, along + nu) == pytest.approx(HOVER**2, rel=1e-6)
    assert nu > 0.0


@given(st.floats(-2.5, 15.0))
def test_induced_velocity_in_a_climb_is_that_of_the_textbook(climb):
    expected = -climb / 2.0 + np.sqrt(climb**2 / 4.0 + HOVER**2)
    assert solve_inflow(0.0, climb, HOVER) == pytest.approx(expected, rel=1e-6)


def test_a_fast_descent_counts_as_half_of_the_hover_velocity():
    assert solve_inflow(0.0, -9.0, HOVER) == solve_inflow(0.0, -2.5, HOVER)
    assert solve_inflow(0.0, -2.4, HOVER) < solve_inflow(0.0, -2.5, HOVER)


def test_twice_the_thrust_induces_the_root_of_two():
    truth, vehicle = layout_vehicle("quad-x")
    air = rotor_air(replace(truth, wake_moment=(2e-3, 3e-3), propeller=0.25), vehicle)
    hover = air.hover_square**0.5
    one, two = (acting(air, (hover * k,) * 4, v=(1e-3, 0.0, 0.0))[4] for k in (1.0, 2.0**0.5))
    assert one == pytest.approx(-3e-3 * air.hover * 1e-3, rel=1e-6)
    assert two == pytest.approx(2.0**0.5 * one, rel=1e-6)
    assert 4.0 * truth.kt * air.hover_square == pytest.approx(truth.mass * 9.80665, rel=1e-12)
    np.testing.assert_allclose(acting(air, (0.0,) * 4, v=(3.0, 0.0, 0.0))[:3], 0.0, atol=1e-12)


def test_a_climb_costs_thrust_and_a_roll_that_of_one_side():
    truth, vehicle = layout_vehicle("quad-x")
    air = rotor_air(replace(truth, inflow=2e-4, propeller=0.25), vehicle)
    speeds, h = (air.hover_square**0.5,) * 4, air.hover
    climb = acting(air, speeds, v=(0.0, 0.0, 2.0))
    nu = -1.0 + np.sqrt(1.0 + h**2)
    np.testing.assert_allclose(
        climb[:3], [0, 0, -4.0 * 2e-4 * speeds[0] * (2.0 + nu - h)], rtol=1e-6
    )
    np.testing.assert_allclose(climb[3:], 0.0, atol=1e-12)
    rolled = acting(air, speeds, w=(1e-3, 0.0, 0.0))
    # In hover half of a small velocity is taken back by the induced one: d(u + nu)/du = 1/2.
    inertia = sum(y**2 for _, y, _ in air.places)
    assert rolled[3] == pytest.approx(-2e-4 * speeds[0] * 0.5 * 1e-3 * inertia, rel=1e-3)
    assert acting(air, speeds, v=(8.0, 0.0, 0.0))[2] > 0.5  # translational lift


def test_wakes_lift_the_side_towards_which_the_vehicle_moves():
    truth, vehicle = layout_vehicle("quad-x")
    air = rotor_air(replace(truth, wake_moment=(2e-3, 3e-3), propeller=0.25), vehicle)
    nu = solve_inflow(36.0, 0.0, air.hover)
    speeds = (air.hover_square**0.5,) * 4
    ahead = acting(air, speeds, v=(6.0, 0.0, 0.0))
    np.testing.assert_allclose(ahead, [0, 0, 0, 0, -3e-3 * nu * 6.0, 0], atol=1e-12)  # nose up
    left = acting(air, speeds, v=(0.0, 6.0, 0.0))
    np.testing.assert_allclose(left, [0, 0, 0, 2e-3 * nu * 6.0, 0, 0], atol=1e-12)  # left side up


def test_the_columns_of_many_samples_give_what_each_alone_gives():
    truth, vehicle = layout_vehicle("quad-x")
    truth = replace(truth, rotor_drag=2e-4, inflow=2e-4, wake_moment=(2e-3, 3e-3), propeller=0.25)
    air, rng = rotor_air(truth, vehicle), np.random.default_rng(1)
    speeds, motion = rng.uniform(300.0, 1200.0, (20, 4)), rng.normal(0.0, 6.0, (20, 6))
    x = motion.T
    together = np.column_stack(with_rotor_air(air, [*np.zeros((9, 20)), *speeds.T], x[:3], x[3:]))
    alone = [
        acting(air, O, v=tuple(row[:3]), w=tuple(row[3:]))
        for O, row in zip(speeds.tolist(), motion.tolist(), strict=True)
    ]
    np.testing.assert_allclose(together[:, :6], alone, rtol=1e-12, atol=1e-12)


def test_a_wind_acts_as_the_opposite_velocity():
    truth, vehicle = layout_vehicle("quad-x")
    truth = replace(truth, drag=(0.1, 0.2, 0.3), rotor_drag=2e-4, inflow=2e-4, propeller=0.25)
    wind, q, w = (4.0, -3.0, 1.0), quaternion_from_euler(0.4, -0.3, 1.0), (0.0, 0.0, 0.0)
    R, wrench = np.array(rotation(q)), (*NOTHING, 700.0, 800.0, 900.0, 1000.0)
    v = np.array([5.0, 1.0, -2.0])
    through = tuple((v - R.T @ wind).tolist())
    windy = derivative(
        rigid_body(replace(truth, wind=wind), vehicle), wrench, (*w, *q, *v.tolist(), 0, 0, 0)
    )
    calm = derivative(rigid_body(truth, vehicle), wrench, (*w, *q, *through, 0, 0, 0))
    np.testing.assert_allclose(windy[:10], calm[:10], atol=1e-12)
    np.testing.assert_allclose(windy[10:], np.array(calm[10:]) + wind, atol=1e-12)


def test_the_model_solves_the_same_equation_at_any_velocity():
    across, along = (
        a.ravel() for a in np.meshgrid(np.linspace(0, 20, 41), np.linspace(-15, 15, 61))
    )
    found = induced_velocity(across, along, HOVER)
    np.testing.assert_allclose(found, solve_inflow(across**2, along, HOVER), atol=1e-5)
