"""The smoothing spline is that of scipy.interpolate."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from rotorfit.flight.smoothing_spline import smoothing_spline_derivatives


@pytest.mark.parametrize("penalty", [1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("count", [5, 6, 40, 300])
def test_derivatives(count: int, penalty: float) -> None:
    rng = np.random.default_rng(count)
    time = np.cumsum(rng.uniform(0.05, 0.2, count))
    values = np.cumsum(rng.normal(size=count))
    at = np.concatenate([time, rng.uniform(time[0] - 0.1, time[-1] + 0.1, 200)])
    spline = make_smoothing_spline(time, values, lam=penalty)
    found = smoothing_spline_derivatives(time, values, at, penalty=penalty)
    for order in (1, 2):
        expected = np.asarray(spline(at, order))
        atol = 1e-10 * float(np.abs(expected).max())
        np.testing.assert_allclose(found[order - 1], expected, rtol=0, atol=atol)
