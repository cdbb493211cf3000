"""Covariance of what is computed from estimated numbers."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float


def numerical_jacobian(
    function: Callable[[Float[np.ndarray, " f"]], Float[np.ndarray, " g"]],
    at: Float[np.ndarray, " f"],
    scale: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "g f"]:
    """Return d function / d argument by central differences over a small part of each scale.

    Parameters
    ----------
    function
        Smooth near `at`.
    at
        Where.
    scale
        A length of each argument over which the function changes little, such as its standard
        deviation; zeros are replaced by a part of the argument itself.
    """
    step = 1e-3 * np.where(scale > 0, scale, np.maximum(np.abs(at), 1.0))
    columns = [
        (function(at + shift) - function(at - shift)) / (2.0 * shift[i])
        for i, shift in enumerate(np.diag(step))
    ]
    return np.column_stack(columns)
