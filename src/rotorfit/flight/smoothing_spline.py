"""The natural cubic smoothing spline, as `scipy.interpolate.make_smoothing_spline` makes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float


def smoothing_spline_derivatives(
    time: Float[np.ndarray, " m"],
    values: Float[np.ndarray, " m"],
    at: Float[np.ndarray, " n"],
    *,
    penalty: float,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    r"""Compute the first and second derivative of a smoothing spline.

    The spline minimises :math:`\sum (y_i - f(t_i))^2 + penalty \int f''^2`. With its second
    derivatives g at the inner times, :math:`(R + penalty\, Q^T Q) g = Q^T y` and
    :math:`f = y - penalty\, Q g` (Reinsch, Numerische Mathematik 10, 1967; R and Q as in Green and
    Silverman, "Nonparametric Regression and Generalized Linear Models", 1994, section 2.1). The
    first and last pieces continue beyond the ends.
    """
    from scipy.linalg import lapack  # slow to import

    h = np.diff(time)
    # The three diagonals of Q: second differences of values at unequal steps.
    before, after = 1.0 / h[:-1], 1.0 / h[1:]
    middle = -before - after
    bands = np.zeros((3, len(h) - 1))
    bands[0] = (h[:-1] + h[1:]) / 3.0 + penalty * (before**2 + middle**2 + after**2)
    bands[1, :-1] = h[1:-1] / 6.0 + penalty * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[2, :-2] = penalty * after[:-2] * before[2:]
    differences = before * values[:-2] + middle * values[1:-1] + after * values[2:]
    solve: Any = lapack.dpbsv
    bend = np.zeros(len(time))
    bend[1:-1] = solve(bands, differences, lower=1)[1]
    smooth = np.array(values, dtype=float)
    smooth[:-2] -= penalty * before * bend[1:-1]
    smooth[1:-1] -= penalty * middle * bend[1:-1]
    smooth[2:] -= penalty * after * bend[1:-1]
    i = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(h) - 1)
    right = (at - time[i]) / h[i]
    left = 1.0 - right
    slope = (smooth[i + 1] - smooth[i]) / h[i]
    slope += h[i] / 6.0 * ((3.0 * right**2 - 1.0) * bend[i + 1] - (3.0 * left**2 - 1.0) * bend[i])
    return slope, left * bend[i] + right * bend[i + 1]
