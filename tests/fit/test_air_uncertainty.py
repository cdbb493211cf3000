"""What a term of the air that has not the whole form of its effect leaves open of every number."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.intervals.allowances import air_uncertainty
from rotorfit.fit.intervals.excitation import flown_ratio
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import added_signals

NAMES = ("kt", "Ixx_com@A", "rotor_drag", "inflow")
VALUES = np.array([1.5e-6, 3e-3, 4e-5, 1e-4])
STD = np.array([1e-8, 5e-5, 2e-6, 1e-5])
KNOWN_TO = STD * 3.0


def widened(correlation, *, terms=("rotor_drag", "inflow"), std=STD):
    """Return the half-widths that a flight whose model has these terms appends, zeros if none."""
    model = regressor(made_fit.QUAD, added=added_signals(terms))
    body = replace(made_fit.configuration(factors=made_fit.blocks([])), model=model)
    numbers = Numbers(
        names=NAMES,
        values=VALUES,
        terms=made_fit.known_to(KNOWN_TO),
        correlation=correlation,
        excitation={},
    )
    own = [t for t in air_uncertainty(numbers, [body], std).terms if t.name == "air at speed"]
    return own[0].half_width if own else np.zeros(len(NAMES))


def correlated(**by_pair):
    """Return correlations, of pairs written as A__B."""
    places = {name.partition("@")[0]: i for i, name in enumerate(NAMES)}
    matrix = np.eye(len(NAMES))
    for pair, value in by_pair.items():
        i, j = (places[name] for name in pair.split("__"))
        matrix[i, j] = matrix[j, i] = value
    return matrix


def test_each_coefficient_is_open_by_what_flights_differ_by():
    """Rotor drag by 5 %, inflow by 20 %, as deviations; nothing else moves."""
    found = widened(np.eye(4))
    np.testing.assert_allclose(found, 1.96 * np.array([0.0, 0.0, 0.05 * 4e-5, 0.2 * 1e-4]))


def test_other_numbers_move_as_far_as_they_go_together():
    """Inflow is off by two of its deviations: so is kt, times their correlation."""
    found = widened(correlated(kt__inflow=0.8, Ixx_com__rotor_drag=-0.5))
    assert found[0] == pytest.approx(1.96 * 0.8 * 2.0 * 1e-8)
    assert found[1] == pytest.approx(1.96 * 0.5 * 1.0 * 5e-5)


def test_several_coefficients_add_in_quadrature():
    found = widened(correlated(kt__inflow=0.8, kt__rotor_drag=0.6))
    assert found[0] == pytest.approx(1.96 * np.hypot(0.8 * 2.0, 0.6 * 1.0) * 1e-8)


@pytest.mark.parametrize("slower", [10.0, 100.0])
def test_a_slow_flight_which_hardly_shows_them_opens_nothing(slower):
    """The prior keeps the coefficient: its form error is a small part of its deviation."""
    std = STD * [1.0, 1.0, slower, slower]
    matrix = correlated(kt__inflow=0.8, kt__rotor_drag=0.6)
    assert widened(matrix, std=std)[0] == pytest.approx(widened(matrix)[0] / slower)


def test_without_a_velocity_the_term_is_zero():
    """The drag of a turn alone, in yaw, has no form of fast flight to be wrong about."""
    assert not widened(correlated(kt__inflow=0.8), terms=("rotor_drag",)).any()


def test_a_coefficient_that_was_not_fitted_opens_nothing():
    assert not widened(correlated(kt__inflow=0.8), std=STD * [1.0, 1.0, 0.0, 0.0]).any()


def flown(with_response, signal, left, *, bands=((0.0, 0.3), (1.0, 2.0), (8.0, 16.0))):
    """Return the ratio over three bands of one flight."""
    fast = regressor(made_fit.QUAD, added=added_signals(("rotor_drag", "inflow")))
    body = replace(made_fit.configuration(factors=made_fit.blocks(bands)), model=fast)
    if with_response is not None:
        body = replace(body, with_response=np.array(with_response))
    return flown_ratio(body, (np.array(signal, dtype=float), np.array(left, dtype=float)))


SIGNAL = [(9.0, 9.0, 9.0), (4.0, 6.0, 8.0), (40.0, 60.0, 0.5)]
LEFT = [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0), (2.0, 4.0, 1.0)]


def test_only_flown_bands_count_wherever_they_are():
    """Roll is flown in the pilot's band, pitch above it, yaw nowhere."""
    moved = [(True, True, True), (True, False, False), (False, True, False)]
    np.testing.assert_allclose(flown(moved, SIGNAL, LEFT), [1.0, 14.0, 0.0])


def test_flown_bands_are_weighed_by_their_power():
    moved = [(False,) * 3, (True,) * 3, (True,) * 3]
    np.testing.assert_allclose(flown(moved, SIGNAL, LEFT), [40 / 4, 60 / 6, 5.5 / 3])


def test_the_mean_is_no_motion_and_less_than_is_left_none():
    everything = [(True,) * 3, (False,) * 3, (False, False, True)]
    np.testing.assert_array_equal(flown(everything, SIGNAL, LEFT), 0.0)


def test_without_bands_that_answer_nothing_is_flown():
    np.testing.assert_array_equal(flown(None, SIGNAL, LEFT), 0.0)
