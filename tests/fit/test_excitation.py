"""How far disturbances can pull an estimate, by the axis' excitation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.fit.intervals.numbers import (
    AXIS_OF,
    CLOSED_LOOP_BIAS,
    INERTIA_BIAS,
    LEAST_EXCITATION,
    NO_EXCITATION,
    RATIO_BIAS,
    SCALE_BIAS,
    attenuation_allowance,
    common_share,
    link_allowance,
    product_allowance,
)
from rotorfit.fit.reduction.frequency_bands import PILOT_BAND

PULLS = {"Ixx_com": INERTIA_BIAS, "Iyy": INERTIA_BIAS, "Izz": SCALE_BIAS, "kd": SCALE_BIAS}


@pytest.mark.parametrize(
    ("name", "rho", "with_response", "share"),
    [
        ("Ixx_com", 7.5, False, 0.25),  # 2.5 / (rho + 2.5)
        ("Iyy", 7.5, True, 1 / 8.5),  # 1 / (rho + 1)
        ("Ixx", 1.51, True, 1 / 2.51),
        ("kd_over_Izz", 16.5, True, 1 / 17.5),
        ("Jr", 3.0, True, 0.25),
        ("kd_over_Izz", 16.5, False, 0.1),  # 1.5 / (rho - 1.5)
        ("Jr_over_Izz", 3.0, False, 1.0),
        ("kd", 12.0, False, 0.2),  # 3 / (rho + 3), the larger of the two
        ("Izz_com", 27.0, False, 0.1),
        ("Jr", 3.0, False, 1.0),  # 1.5 / (rho - 1.5)
        ("Ixx", 1.49, False, np.inf),
        ("Ixx", 1.49, True, np.inf),
        ("Ixx", 1.51, False, 2.5 / 4.01),
    ],
)
def test_the_biases_are_those_of_the_method(name, rho, with_response, share):
    """In figures: a pull that is halved or doubled in the source is not what was measured."""
    assert attenuation_allowance(name, -2.0, rho, with_response=with_response) == pytest.approx(
        2 * share
    )


def test_what_depends_on_yaw_in_figures():
    assert product_allowance(2.0, 12.0) == pytest.approx(0.4)  # 3 / (12 + 3)
    assert product_allowance(2.0, 0.0) == product_allowance(2.0, -1.0) == 2.0


def test_what_depends_on_roll_and_pitch_in_figures():
    assert link_allowance(-2.0, 27.0) == pytest.approx(0.2)  # 3 / (27 + 3)
    assert link_allowance(2.0, 1.51) == pytest.approx(6.0 / 4.51)
    assert np.isinf(link_allowance(2.0, 1.5))


def test_below_a_rho_of_5_disturbances_are_what_limits():
    assert LEAST_EXCITATION == 5.0


def test_a_pilot_flies_between_a_third_and_three_hertz():
    assert PILOT_BAND == (0.3, 3.0)


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(sorted(PULLS)),
)
def test_the_allowance_holds_the_truth_of_a_number_biased_up(true, rho, share, name):
    found = true * (1.0 + share * PULLS[name] / rho)
    allowed = attenuation_allowance(name, found, rho, with_response=False)
    assert found - true <= allowed * (1 + 1e-9)


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(["kd_over_Izz", "Jr_over_Izz", "Jr", "kd"]),
)
def test_the_allowance_holds_the_truth_of_a_number_biased_down(true, rho, share, name):
    found = true * (1.0 - share * RATIO_BIAS / rho)
    allowed = attenuation_allowance(name, found, rho, with_response=False)
    assert true - found <= allowed * (1 + 1e-9)


@pytest.mark.parametrize("with_response", [False, True])
@pytest.mark.parametrize("name", sorted(AXIS_OF))
def test_without_excitation_nothing_is_bounded(name, with_response):
    def allowed(size, rho):
        return attenuation_allowance(name, size, rho, with_response=with_response)

    assert np.isinf(allowed(1.0, NO_EXCITATION))
    assert np.isinf(allowed(1.0, 0.0))
    assert allowed(-2.0, 3.0) == 2 * allowed(1.0, 3.0)
    assert allowed(1.0, 1e6) < 1e-5


@given(
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(sorted(AXIS_OF)),
)
def test_the_term_for_the_response_leaves_less_to_allow_for(rho, share, name):
    found = 1.0 + share * CLOSED_LOOP_BIAS / rho
    allowed = attenuation_allowance(name, found, rho, with_response=True)
    assert found - 1.0 <= allowed * (1 + 1e-9)
    assert allowed < attenuation_allowance(name, found, rho, with_response=False)


@pytest.mark.parametrize(
    ("name", "share"), [("kt", 0.005), ("Iyy_com", 0.005), ("kd_over_Izz", 0.015), ("com_x", 0.0)]
)
def test_what_many_flights_are_off_all_alike(name, share):
    assert common_share(name) == share
