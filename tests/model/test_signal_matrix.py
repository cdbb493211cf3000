"""Signals: which column is what, and the [1 4 1]/6 that central differences ask for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import newton_euler as ne
from rotorfit.errors import FlightError
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import (
    DERIVATIVES,
    rotor_columns,
    rotor_signals,
    signal_layout,
    signal_matrix,
    yaw_signals,
)

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("tilted", [False, True])
def test_columns_are_what_their_names_say(tilted):
    rng = np.random.default_rng(1)
    vehicle = ne.random_vehicle(rng, 5, tilted=tilted)
    alpha, w, dw, O, dO = ne.random_motion(rng, 7, 5)
    Z = signal_matrix(ne.flight_of(alpha, w, dw, O, dO), vehicle, 0, 7)
    x, y, z = w.T
    signs = np.array([1.0 if r.spin == "ccw" else -1.0 for r in vehicle.rotors])
    spin = signs[:, None] * np.array([r.axis for r in vehicle.rotors])
    H, dH = O @ spin, dO @ spin
    wxH = np.cross(w, H)
    columns = dict(zip(("ax", "ay", "az", "dwx", "dwy", "dwz"), [*alpha.T, *dw.T], strict=True))
    columns |= {"wxwx": x * x, "wywy": y * y, "wzwz": z * z}
    columns |= {"wxwy": x * y, "wxwz": x * z, "wywz": y * z, "one": np.ones(7)}
    columns |= {f"O2_{i + 1}": O[:, i] ** 2 for i in range(5)}
    columns |= {"dHx": dH[:, 0], "dHy": dH[:, 1], "dHz": dH[:, 2]}
    columns |= {"wxH_x": wxH[:, 0], "wxH_y": wxH[:, 1], "wxH_z": wxH[:, 2]}
    arms = [np.hypot(r.position[0], r.position[1]) for r in vehicle.rotors]
    columns |= {"wzO": sum(z * O[:, i] * arm**2 for i, arm in enumerate(arms))}
    columns |= {"wx": x, "wy": y, "wz": z}
    layout = signal_layout(vehicle)
    assert len(layout) == 12 + 5 + (6 if tilted else 3) + 5
    for i, name in enumerate(layout.names):
        np.testing.assert_allclose(Z[:, i], columns[name], rtol=1e-12, atol=1e-9, err_msg=name)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, tilted=st.booleans(), start=st.integers(1, 5), length=st.integers(1, 20))
def test_central_averages_every_column_but_the_derivatives(seed, tilted, start, length):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, 4, tilted=tilted)
    motion = ne.random_motion(rng, 30, 4)
    stop = start + length
    exact = signal_matrix(ne.flight_of(*motion), vehicle, 0, 30)
    central = signal_matrix(ne.flight_of(*motion, differentiation="central"), vehicle, start, stop)
    before, here, after = (
        exact[start - 1 : stop - 1],
        exact[start:stop],
        exact[start + 1 : stop + 1],
    )
    for i, name in enumerate(signal_layout(vehicle).names):
        if name in DERIVATIVES:
            np.testing.assert_array_equal(central[:, i], here[:, i])
        else:
            mean = (before[:, i] + 4 * here[:, i] + after[:, i]) / 6
            size = np.abs(exact[:, i]).max()
            np.testing.assert_allclose(central[:, i], mean, atol=1e-14 * size, err_msg=name)


def polynomial_flight(rng, vehicle, degree, *, rate=20.0, n=40):
    """Return rates and rotor speeds that are polynomials of time, exact and by differences."""
    t = (np.arange(n) - n / 2)[:, None] / rate
    N = len(vehicle.rotors)
    powers = t ** np.arange(degree + 1)
    slopes = np.arange(1, degree + 1) * powers[:, :-1]
    w_of, O_of = rng.normal(size=(degree + 1, 3)), 50.0 * rng.normal(size=(degree + 1, N))
    O_of[0] = 600.0
    w, O = powers @ w_of, powers @ O_of
    dw, dO = slopes @ w_of[1:], slopes @ O_of[1:]
    alpha = rng.normal(size=(n, 3))
    exact = ne.flight_of(alpha, w, dw, O, dO, rate=rate)
    inner = slice(1, -1)
    central_dw, central_dO = dw.copy(), dO.copy()
    central_dw[inner] = (w[2:] - w[:-2]) * (rate / 2)
    central_dO[inner] = (O[2:] - O[:-2]) * (rate / 2)
    central = replace(
        exact,
        angular_acceleration=central_dw,
        rotor_acceleration=central_dO,
        differentiation="central",
    )
    return exact, central


def averaging_error(seed, degree):
    """Return how far the central residual is from the mean of the exact one, and its size."""
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, 4, tilted=True)
    exact, central = polynomial_flight(rng, vehicle, degree)
    A = regressor(vehicle)
    theta = ne.theta_of(ne.random_body(rng, 4))
    n = len(exact.time)
    whole = A.residual(signal_matrix(exact, vehicle, 0, n), theta)
    mean = (whole[:-2] + 4 * whole[1:-1] + whole[2:]) / 6
    error = A.residual(signal_matrix(central, vehicle, 1, n - 1), theta) - mean
    return np.abs(error).max(axis=0), np.abs(whole).max(axis=0)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, degree=st.sampled_from([1, 2, 3, 4]))
def test_cubic_rates_leave_no_error_of_differentiation(seed, degree):
    """Simpson's mean of a derivative up to the third degree is the difference quotient."""
    error, size = averaging_error(seed, degree)
    assert (error <= 1e-12 * size.max()).all()


def test_the_error_of_differentiation_is_of_fourth_order():
    error, size = averaging_error(3, 5)
    assert (error[3:] > 1e-9 * size.max()).all()


@pytest.mark.parametrize(("start", "stop"), [(0, 10), (1, 30), (5, 31)])
def test_central_needs_a_row_on_both_sides(start, stop):
    rng = np.random.default_rng(0)
    vehicle = ne.paper_vehicle()
    flight = ne.flight_of(*ne.random_motion(rng, 30, 4), differentiation="central")
    with pytest.raises(FlightError, match="neighbour"):
        signal_matrix(flight, vehicle, start, stop)
    assert len(signal_matrix(flight, vehicle, 1, 29)) == 28


@pytest.mark.parametrize("differentiation", ["exact", "central"])
@pytest.mark.parametrize("tilted", [False, True])
def test_signals_of_the_rotors_and_of_yaw_are_columns_of_all(tilted, differentiation):
    rng = np.random.default_rng(7)
    vehicle = ne.random_vehicle(rng, 4, tilted=tilted)
    data = ne.flight_of(*ne.random_motion(rng, 30, 4), differentiation=differentiation)
    layout = signal_layout(vehicle)
    every = signal_matrix(data, vehicle, 1, 29)
    rotors = rotor_signals(data, vehicle, 1, 29)
    np.testing.assert_array_equal(rotors, every[:, rotor_columns(layout)])
    yaw = yaw_signals(data, 4, 1, 29)
    np.testing.assert_array_equal(yaw[:, 0], every[:, layout.index("dwz")])
    squares = [layout.index(f"O2_{i + 1}") for i in range(4)]
    np.testing.assert_allclose(yaw[:, 1:5], every[:, squares], rtol=1e-12)
    spin_up = yaw[:, 5:] @ (vehicle.spins * vehicle.axes[:, 2])
    np.testing.assert_allclose(spin_up, every[:, layout.index("dHz")], rtol=1e-9, atol=1e-9)
