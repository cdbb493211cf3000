"""How far disturbances can pull an estimate, by the axis' excitation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.identification.excitation import (
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
    assert found - true <= attenuation_allowance(name, found, rho) * (1 + 1e-9)


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(NO_EXCITATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    name=st.sampled_from(["kd_over_Izz", "Jr_over_Izz", "Jr", "kd"]),
)
def test_the_allowance_holds_the_truth_of_a_number_pulled_down(true, rho, share, name):
    found = true * (1.0 - share * RATIO_PULL / rho)
    assert true - found <= attenuation_allowance(name, found, rho) * (1 + 1e-9)


@pytest.mark.parametrize("name", sorted(AXIS_OF))
def test_without_excitation_nothing_is_bounded(name):
    assert np.isinf(attenuation_allowance(name, 1.0, NO_EXCITATION))
    assert np.isinf(attenuation_allowance(name, 1.0, 0.0))
    assert attenuation_allowance(name, -2.0, 3.0) == 2 * attenuation_allowance(name, 1.0, 3.0)
    assert attenuation_allowance(name, 1.0, 1e6) < 1e-5
