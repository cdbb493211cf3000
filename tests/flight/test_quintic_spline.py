"""The quintic spline is that of scipy.interpolate."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from rotorfit.flight.quintic_spline import quintic_spline


@pytest.mark.parametrize("n", [6, 7, 8, 11, 12, 50, 3001])
def test_values_and_derivatives(n: int) -> None:
    rng = np.random.default_rng(n)
    values = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    rows = np.concatenate([[0.0, n - 1.0], np.arange(float(n)), rng.uniform(0.0, n - 1.0, 200)])
    spline = make_interp_spline(np.arange(float(n)), values, k=5)
    found = quintic_spline(values, rows, derivatives=2)
    for order in range(3):
        expected = np.asarray(spline(rows, nu=order))
        atol = 1e-12 * float(np.abs(expected).max())
        np.testing.assert_allclose(found[order], expected, rtol=0, atol=atol)
