"""How far disturbances can pull an estimate, by the axis' excitation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.fit.excitation import (
    ANSWERED_PULL,
    AXIS_OF,
    INERTIA_PULL,
    NO_EXCITATION,
    RATIO_PULL,
    SCALE_PULL,
    attenuation_allowance,
)

PULLS = {"Ixx_com": INERTIA_PULL, "Iyy": INERTIA_PULL, "Izz": SCALE_PULL, "kd": SCALE_PULL}


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(sorted(PULLS)),
)
def test_the_allowance_holds_the_truth_of_a_number_pulled_up(true, rho, share, name):
    found = true * (1.0 + share * PULLS[name] / rho)
    allowed = attenuation_allowance(name, found, rho, answered=False)
    assert found - true <= allowed * (1 + 1e-9)


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(["kd_over_Izz", "Jr_over_Izz", "Jr", "kd"]),
    answered=st.booleans(),
)
def test_the_allowance_holds_the_truth_of_a_number_pulled_down(true, rho, share, name, answered):
    found = true * (1.0 - share * RATIO_PULL / rho)
    allowed = attenuation_allowance(name, found, rho, answered=answered)
    assert true - found <= allowed * (1 + 1e-9)


@pytest.mark.parametrize("answered", [False, True])
@pytest.mark.parametrize("name", sorted(AXIS_OF))
def test_without_excitation_nothing_is_bounded(name, answered):
    def allowed(size, rho):
        return attenuation_allowance(name, size, rho, answered=answered)

    assert np.isinf(allowed(1.0, NO_EXCITATION))
    assert np.isinf(allowed(1.0, 0.0))
    assert allowed(-2.0, 3.0) == 2 * allowed(1.0, 3.0)
    assert allowed(1.0, 1e6) < 1e-5


@given(rho=st.floats(3.01, 1e3), share=st.floats(0.0, 1.0), name=st.sampled_from(["Ixx", "Iyy"]))
def test_the_term_for_the_answer_leaves_less_to_allow_for(rho, share, name):
    found = 1.0 + share * ANSWERED_PULL / rho
    allowed = attenuation_allowance(name, found, rho, answered=True)
    assert found - 1.0 <= allowed * (1 + 1e-9)
    assert allowed < attenuation_allowance(name, found, rho, answered=False)


def test_where_no_band_is_flown_the_term_is_not_there():
    one, other = (attenuation_allowance("Ixx", 1.0, 2.9, answered=a) for a in (False, True))
    assert one == other
