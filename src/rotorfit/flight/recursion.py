"""Recursions over the samples of a signal, solved by LAPACK as one linear system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float


def solve_recursion(
    bands: Float[np.ndarray, "d n"], right: Float[np.ndarray, "n *k"]
) -> Float[np.ndarray, "n *k"]:
    """Solve x_k + b_1 x_k-1 + b_2 x_k-2 + ... = f_k, each column of `right` being an f.

    `bands`: ones, then b_1 in the column of x_k-1, b_2 in that of x_k-2, ...; in Fortran's order.
    `right` may be overwritten.
    """
    from scipy.linalg import lapack  # slow to import

    # Triangular: a general banded solver takes five times as long.
    solve: Any = lapack.dtbtrs
    solved: Float[np.ndarray, "n *k"] = solve(bands, right, uplo="L", diag="U", overwrite_b=1)[0]
    return solved
