"""The cubic spline between commands, against SciPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from rotorfit.flight.cubic_spline import cubic_spline_between, cubic_spline_slopes


@given(st.integers(4, 60), st.integers(0, 2**32 - 1))
def test_it_is_the_spline_of_scipy(count, seed):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.2, 3.0, count))
    values = rng.normal(size=count)
    shares = np.array([0.0, 0.1, 0.5, 0.95])
    spline = CubicSpline(time, values)
    at = time[:-1, None] + np.diff(time)[:, None] * shares
    scale = 1e-9 * np.abs(spline(at)).max()
    assert cubic_spline_between(time, values, shares) == pytest.approx(spline(at), abs=scale)
    assert cubic_spline_slopes(time, values) == pytest.approx(spline(time, 1), rel=1e-7, abs=1e-7)


def test_three_samples_are_refused():
    with pytest.raises(ValueError, match="four samples, here are 3"):
        cubic_spline_slopes(np.arange(3.0), np.ones(3))
