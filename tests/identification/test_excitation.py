"""How far disturbances can pull an estimate, by the axis' excitation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.identification.excitation import ATTENUATION, attenuation_allowance


@given(
    true=st.floats(0.1, 10.0),
    rho=st.floats(ATTENUATION * 1.01, 1e3),
    share=st.floats(0.0, 1.0),
    axis=st.sampled_from(["roll", "pitch", "yaw"]),
)
def test_the_allowance_holds_the_truth_under_any_pull_up_to_the_largest(true, rho, share, axis):
    pull = 1.0 - share * ATTENUATION / rho
    # Roll and pitch: the response kt / I is pulled down, its inverse is reported.
    found = true * pull if axis == "yaw" else true / pull
    assert abs(found - true) <= attenuation_allowance(axis, found, rho) * (1 + 1e-9)


def test_hardly_any_excitation_bounds_nothing_in_yaw():
    assert np.isinf(attenuation_allowance("yaw", 1.0, ATTENUATION))
    assert np.isinf(attenuation_allowance("yaw", 1.0, 0.0))
    assert attenuation_allowance("roll", 1.0, 1.0) > 1.0
    assert attenuation_allowance("roll", -2.0, 3.0) == pytest.approx(1.0)
