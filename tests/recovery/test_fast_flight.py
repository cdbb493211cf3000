"""The regressions of `benchmarks.fast_flight`: Glauert's velocity, and the drag of real rotors."""

import numpy as np
import pytest
from benchmarks.fast_flight import (
    FLIGHTS,
    FORCE_BAND,
    MODELS,
    filter_below,
    make_columns,
    read_flight,
    solve_induced_velocity,
)

HOVER = 6.0


def test_induced_velocity_solves_momentum_theory():
    rng = np.random.default_rng(3)
    across, along = rng.uniform(0.0, 15.0, 500), rng.uniform(-0.8 * HOVER, 10.0, 500)
    found = solve_induced_velocity(across, along, HOVER)
    np.testing.assert_allclose(found * np.hypot(across, along + found), HOVER**2, rtol=1e-9)


def test_induced_velocity_in_a_climb_is_that_of_the_textbook():
    u = np.linspace(0.0, 10.0, 21)
    expected = -u / 2.0 + np.sqrt(u**2 / 4.0 + HOVER**2)
    np.testing.assert_allclose(solve_induced_velocity(0.0 * u, u, HOVER), expected, rtol=1e-9)


@pytest.mark.flights
@pytest.mark.parametrize("name", FLIGHTS)
def test_each_flight_shows_the_same_rotor_drag(flight_data_dir, name):
    """4.2e-5 N s^2/(m rad) along both axes, within three times what six flights differ by (5 %)."""
    flight = read_flight(flight_data_dir / "neurobem" / f"{name}.csv")
    for axis in (0, 1):
        X = filter_below(make_columns(flight, MODELS[2])[axis], FORCE_BAND)
        y = filter_below(flight.force, FORCE_BAND)[:, axis]
        drag = -np.linalg.lstsq(X, y, rcond=None)[0][1]
        assert drag == pytest.approx(4.2e-5, rel=0.15)
