"""Terms of fast flight against vector sums over the rotors, and momentum theory by its root."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import newton_euler as ne
from rotorfit.flight.airborne import GRAVITY
from rotorfit.logs.flight_log import AIRLESS_ROTORS, SIH
from rotorfit.model.air_force import air_force
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.model.terms.air import (
    LEAST_LOAD,
    hover_inflow,
    induced_velocity,
    thrust_over_weight,
    wake_columns,
)
from rotorfit.model.terms.registry import added_signals
from rotorfit.model.vehicle import Vehicle

SEEDS = st.integers(0, 2**32 - 1)
ROTORS = st.integers(3, 8)
SAMPLES = 4
FAST = ("drag", "rotor_drag", "inflow", "wake_moment")
TILTED_OR_LEVEL = st.sampled_from(["tilted", "upright", "level"])


def drawn_vehicle(rng, rotors, kind):
    """Return rotors with tilted axes, with upright ones at any height, or all at one height."""
    vehicle = ne.random_vehicle(rng, rotors, tilted=kind == "tilted")
    if kind != "level":
        return vehicle
    flat = tuple(replace(r, position=(*r.position[:2], 0.0)) for r in vehicle.rotors)
    return Vehicle(rotors=flat)


def drawn_flight(rng, rotors, hover):
    """Return a random motion at up to 15 m/s with the induced velocity of hover."""
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    v = rng.normal(size=(SAMPLES, 3)) * [8.0, 8.0, 4.0]
    flight = ne.flight_of(alpha, w, dw, O, dO, velocity=v)
    return replace(flight, hover_inflow=hover)


def wrench_of(flight, vehicle, values):
    """Return the wrench that terms give at these values: the regressor's residual, negative."""
    added = added_signals(FAST)
    A = regressor(vehicle, added=added)
    Z = signal_matrix(flight, vehicle, 0, SAMPLES, added=added)
    return -A.residual(Z, values)


def still_air(flight):
    """Return the induced velocity of each sample's thrust in still air: by the root of thrust."""
    squares = (flight.rotor_speed**2).sum(axis=1)
    load = squares / squares.mean() * flight.specific_force[:, 2].mean() / GRAVITY
    return flight.hover_inflow * np.sqrt(load)


def rotor_by_rotor(flight, vehicle, force_on):
    """Sum `force_on(speed, velocity of the rotor, axis, k)` and its torque, of each sample k."""
    total = np.zeros((SAMPLES, 6))
    for k in range(SAMPLES):
        v, w, O = flight.velocity[k], flight.angular_velocity[k], flight.rotor_speed[k]
        for rotor, speed in zip(vehicle.rotors, O, strict=True):
            r, n = np.array(rotor.position), np.array(rotor.axis)
            force = force_on(speed, v + np.cross(w, r), n, k)
            total[k] += np.concatenate([force, np.cross(r, force)])
    return total


def glauert(across, along, hover):
    """Return the induced velocity by the root of the momentum balance, not by halving."""
    u = max(along, -max(0.5 * hover, 2.0 * across))
    return brentq(
        lambda x: x * np.hypot(across, u + x) - hover**2,
        0.0,
        4.0 * hover,
        xtol=1e-13,
        rtol=1e-14,
    )


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, kind=TILTED_OR_LEVEL)
def test_drag_is_a_force_on_each_rotor_against_its_velocity(seed, rotors, kind):
    rng = np.random.default_rng(seed)
    vehicle, c = drawn_vehicle(rng, rotors, kind), rng.uniform(1e-5, 1e-3)
    flight = drawn_flight(rng, rotors, None)
    expected = rotor_by_rotor(
        flight, vehicle, lambda O, moving, n, _: c * O * np.cross(n, np.cross(n, moving))
    )
    actual = wrench_of(flight, vehicle, {"rotor_drag": c})
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, kind=TILTED_OR_LEVEL, hover=st.floats(2.0, 12.0))
def test_inflow_takes_thrust_by_the_air_beyond_that_in_still_air(seed, rotors, kind, hover):
    rng = np.random.default_rng(seed)
    vehicle, c = drawn_vehicle(rng, rotors, kind), rng.uniform(1e-5, 1e-3)
    flight = drawn_flight(rng, rotors, hover)
    still = still_air(flight)

    def lost_thrust(O, moving, n, k):
        u = moving @ n
        across = np.linalg.norm(moving - u * n)
        return -c * O * (u + glauert(across, u, still[k]) - still[k]) * n

    expected = rotor_by_rotor(flight, vehicle, lost_thrust)
    actual = wrench_of(flight, vehicle, {"inflow": c})
    np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, kind=TILTED_OR_LEVEL, hover=st.floats(2.0, 12.0))
def test_wakes_lift_the_side_towards_which_the_vehicle_moves(seed, rotors, kind, hover):
    rng = np.random.default_rng(seed)
    vehicle, (a, b) = drawn_vehicle(rng, rotors, kind), rng.uniform(1e-4, 1e-2, 2)
    flight = drawn_flight(rng, rotors, hover)
    expected, still = np.zeros((SAMPLES, 6)), still_air(flight)
    for k, v in enumerate(flight.velocity):
        found = []
        for rotor in vehicle.rotors:
            n = np.array(rotor.axis)
            moving = v + np.cross(flight.angular_velocity[k], rotor.position)
            across = np.linalg.norm(moving - (moving @ n) * n)
            found.append(glauert(across, moving @ n, still[k]))
        induced = np.mean(found)
        # About x, the left side rises for v_y > 0; about y, the nose for v_x > 0.
        expected[k, 3:5] = a * induced * v[1], -b * induced * v[0]
    actual = wrench_of(flight, vehicle, {"wake_moment_x": a, "wake_moment_y": b})
    np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@given(across=st.floats(0.0, 20.0), along=st.floats(-0.5, 3.0), hover=st.floats(0.5, 15.0))
def test_induced_velocity_balances_momentum(across, along, hover):
    u = along * hover
    found = float(induced_velocity(np.array([across]), np.array([u]), hover)[0])
    assert found * np.hypot(across, u + found) == pytest.approx(hover**2, rel=1e-6)


@given(hover=st.floats(0.5, 15.0), climb=st.floats(0.0, 3.0), fast=st.floats(20.0, 50.0))
def test_induced_velocity_has_the_limits_of_the_textbook(hover, climb, fast):
    """Climb: -u/2 + sqrt(u^2/4 + v_h^2); far forward: v_h^2 / v (Leishman 2006, 2.13 and 2.14)."""
    u, still = np.array([climb * hover]), np.zeros(1)
    expected = -u / 2.0 + np.sqrt(u**2 / 4.0 + hover**2)
    np.testing.assert_allclose(induced_velocity(still, u, hover), expected, rtol=1e-6)
    forward = induced_velocity(np.array([fast * hover]), still, hover)
    np.testing.assert_allclose(forward, hover / fast, rtol=1e-4)


def test_a_fast_descent_counts_as_half_the_velocity_of_hover():
    """Momentum theory has no sense in the vortex ring: thrust there is not made up."""
    down = np.array([-0.5, -1.0, -3.0]) * 6.0
    np.testing.assert_array_equal(np.diff(induced_velocity(np.zeros(3), down, 6.0)), 0.0)


def test_a_pull_up_at_two_g_induces_the_root_of_two():
    """Momentum theory: T = 2 rho A v_h^2, whatever the rotors weigh."""
    speeds = np.repeat([[800.0], [800.0 * 2.0**0.5]], 4, axis=1)
    still, force = np.zeros((2, 3)), np.array([[0.0, 0.0, 9.80665], [0.0, 0.0, 19.6133]])
    flight = ne.flight_of(force, still, still, speeds, 0.0 * speeds, velocity=still)
    flight = replace(flight, hover_inflow=6.0)
    np.testing.assert_allclose(thrust_over_weight(flight, slice(0, 2)), [1.0, 2.0], rtol=1e-12)
    v = np.array([[1e-3, 0.0, 0.0]] * 2)
    wake = wake_columns(replace(flight, velocity=v), slice(0, 2), ne.paper_vehicle())
    np.testing.assert_allclose(wake[:, 0] / v[:, 0], [6.0, 6.0 * 2.0**0.5], rtol=1e-6)


def test_rotors_without_thrust_have_an_induced_velocity():
    still, speeds = np.zeros((2, 3)), np.array([[0.0] * 4, [800.0] * 4])
    force = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.8]])
    flight = ne.flight_of(force, still, still, speeds, 0.0 * speeds, velocity=still)
    load = thrust_over_weight(replace(flight, hover_inflow=6.0), slice(0, 2))
    assert load[0] == LEAST_LOAD


def test_the_velocity_of_hover_is_that_of_momentum_theory():
    """.772 kg on four 5-inch propellers: 7.89 m/s in air of 1.2 kg/m^3."""
    vehicle = replace(ne.paper_vehicle(), propeller=0.127)
    area = 4.0 * np.pi * 0.0635**2
    assert vehicle.disk_area == pytest.approx(area)
    assert hover_inflow(0.772, vehicle) == pytest.approx((0.772 * 9.81 / 2.4 / area) ** 0.5, 1e-3)


def test_without_a_mass_only_the_climb_takes_thrust():
    rng = np.random.default_rng(5)
    vehicle = drawn_vehicle(rng, 4, "upright")
    flight = drawn_flight(rng, 4, None)
    expected = rotor_by_rotor(flight, vehicle, lambda O, moving, n, _: -1e-4 * O * (moving @ n) * n)
    actual = wrench_of(flight, vehicle, {"inflow": 1e-4, "wake_moment_x": 1.0})
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, kind=TILTED_OR_LEVEL)
def test_the_airs_force_is_the_force_of_the_terms_with_velocity(seed, rotors, kind):
    rng = np.random.default_rng(seed)
    vehicle = drawn_vehicle(rng, rotors, kind)
    flight = drawn_flight(rng, rotors, 6.0)
    values = {"rotor_drag": 4e-5, "inflow": 1e-4, "drag_x": 0.1, "drag_z": 0.2}
    layout = regressor(vehicle, added=added_signals(FAST)).layout
    found = air_force(flight, vehicle, layout, lambda _, name: values.get(name, 0.0))
    expected = wrench_of(flight, vehicle, values)[:, :3]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())


def test_a_simulator_without_air_at_its_rotors_has_no_signals():
    """PX4's SIH moves its rotors through no air: a term for that would take what is not there."""
    assert AIRLESS_ROTORS == (SIH,)
    assert {s.name for s in added_signals(FAST)} == {"velocity", "rotor_drag", "inflow", "wake"}
    assert {s.name for s in added_signals(FAST, rotor_air=False)} == {"velocity"}


def test_rotors_are_dragged_only_where_the_velocity_is_known():
    assert added_signals(["rotor_drag"]) == ()
    names = {s.name for s in added_signals(["rotor_drag", "drag"])}
    assert names == {"velocity", "rotor_drag"}
