"""The cubic spline through samples at any times, as `scipy.interpolate.CubicSpline`.

To import `scipy.interpolate`, which imports `scipy.optimize`, takes longer than to read a short
log. De Boor, "A Practical Guide to Splines", 1978, chapter IV.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float


def cubic_spline_slopes(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Compute the slope at each sample; the second and the last but one are no knots."""
    from scipy.linalg import lapack  # slow to import

    if len(time) < 4:
        raise ValueError(f"a cubic spline needs four samples, here are {len(time)}")
    h = np.diff(time)
    rise = np.diff(values) / h
    diagonal, above, below = np.empty(len(time)), np.empty(len(h)), np.empty(len(h))
    right = np.empty(len(time))
    diagonal[1:-1] = 2.0 * (h[:-1] + h[1:])
    above[1:], below[:-1] = h[:-1], h[1:]
    right[1:-1] = 3.0 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])
    diagonal[0], above[0], right[0] = _close_end(h[0], h[1], rise[0], rise[1])
    diagonal[-1], below[-1], right[-1] = _close_end(h[-1], h[-2], rise[-1], rise[-2])
    solve: Any = lapack.dgtsv
    return np.asarray(solve(below, diagonal, above, right)[3], dtype=float)


def _close_end(
    h: float, inner: float, rise: float, inner_rise: float
) -> tuple[float, float, float]:
    """Return the equation at an end whose neighbour is no knot: own, next slope, right side."""
    both = h + inner
    right = ((h + 2.0 * both) * inner * rise + h**2 * inner_rise) / both
    return inner, both, right


def cubic_spline_between(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, " n"],
    shares: Float[np.ndarray, " s"],
) -> Float[np.ndarray, "i s"]:
    """Evaluate the spline at the same shares of the way between samples, a row per interval."""
    slopes = cubic_spline_slopes(time, values)
    h = np.diff(time)
    left, right = slopes[:-1] * h, slopes[1:] * h
    rise = np.diff(values)
    # In Hermite's form, by the share t: v + t (a + t (b + t c)).
    b = 3.0 * rise - 2.0 * left - right
    c = left + right - 2.0 * rise
    t = shares
    coefficients = np.stack([values[:-1], left, b, c])
    return coefficients.T @ np.vstack([np.ones_like(t), t, t**2, t**3])
