"""Zeros of functions of one variable."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from rotorfit.estimation.root import root_between


@given(st.floats(0.01, 50.0), st.floats(-3.0, 3.0), st.floats(0.0, 2.0))
def test_the_zero_is_that_of_brentq(steepness: float, middle: float, slope: float) -> None:
    def bent(x: float) -> float:
        return math.tanh(steepness * (x - middle)) + slope * (x - middle) * 2.0 ** (x - middle)

    assert root_between(bent, -3.5, 3.5) == pytest.approx(brentq(bent, -3.5, 3.5), abs=1e-9)


def test_a_zero_at_an_end_is_found() -> None:
    assert root_between(lambda x: x, 0.0, 1.0) == 0.0
    assert root_between(lambda x: x - 1.0, 0.0, 1.0) == 1.0


def test_few_steps_suffice() -> None:
    seen: list[float] = []

    def counted(x: float) -> float:
        seen.append(x)
        return math.exp(x) - 2.0

    assert root_between(counted, 0.0, 3.0) == pytest.approx(math.log(2.0), abs=1e-12)
    assert len(seen) < 30


def test_equal_signs_are_refused() -> None:
    with pytest.raises(ValueError, match="no change of sign"):
        root_between(lambda x: 1.0 + x * x, -1.0, 1.0)
