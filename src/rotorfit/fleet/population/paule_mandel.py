"""How far values scatter beside what each states of itself.

References
----------
Paule and Mandel, J. of Research of the National Bureau of Standards 87, 1982.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float

HALVINGS: Final = 60


def scatter_beside(
    chi2: Callable[[Float[np.ndarray, "*s"]], Float[np.ndarray, "*s"]],
    freedom: Float[np.ndarray, "*s"],
    values: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "*s"]:
    """Return the variance with which chi^2 is what it should be; 0 where it is less without any.

    Solved by halving, for all sets of values at once.

    Parameters
    ----------
    chi2
        Of each set about its means, a variance for each set added to the stated ones.
    freedom
        What it should be.
    values
        All of them: their range bounds the answer.
    """
    low = np.zeros_like(freedom)
    high = np.full_like(freedom, 4.0 * float(np.ptp(values)) ** 2 + np.finfo(float).tiny)
    for _ in range(HALVINGS):
        middle = np.asarray(0.5 * (low + high))
        more = chi2(middle) > freedom
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.where(low > 0.0, 0.5 * (low + high), 0.0)
