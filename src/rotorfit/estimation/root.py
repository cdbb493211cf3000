"""Find the zero of a function of one variable.

As `scipy.optimize.brentq`, which takes longer to import than the fit of a short flight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

PRECISION: Final = 1e-14
"""Share of the interval within which the zero is found."""
MOST_STEPS: Final = 200


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Find a zero of a continuous function between two points where its signs differ.

    Raises `ValueError` where the signs are the same.
    """
    a, b, at_a, at_b = low, high, function(low), function(high)
    if at_a == 0.0:
        return a
    # Signs, not products: those of two small numbers are zero.
    if at_b != 0.0 and (at_a < 0.0) == (at_b < 0.0):
        raise ValueError(f"no change of sign between {low:g} and {high:g}")
    width = PRECISION * abs(high - low)
    for step in range(MOST_STEPS):
        if at_b == 0.0 or abs(b - a) <= width:
            return b
        # Regula falsi with the Illinois rule (Dowell and Jarratt, BIT 11, 1971), which converges
        # faster than linearly; a halving at every third step bounds it.
        c = 0.5 * (a + b) if step % 3 == 2 or at_a == at_b else b - at_b * (b - a) / (at_b - at_a)
        at_c = function(c)
        if (at_c < 0.0) != (at_b < 0.0):
            a, at_a = b, at_b
        else:
            at_a *= 0.5  # keeps the other end from standing still
        b, at_b = c, at_c
    return b
