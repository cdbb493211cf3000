"""Quantiles, tails and densities of Student's t, the normal, F and chi-square distributions.

As `scipy.stats` computes them, but from `scipy.special`: to import `scipy.stats` takes longer than
to identify a short flight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float


def student_quantile(probability: float | int, degrees: Any) -> Any:
    """Compute the quantile of Student's t for degrees of freedom; NaN if there are none."""
    from scipy import special  # slow to import

    nu: Float[np.ndarray, "..."] = np.asarray(degrees, dtype=float)
    finite = np.where(np.isinf(nu), 1.0, np.where(nu > 0.0, nu, np.nan))
    quantile: Any = special.stdtrit(finite, probability)
    return np.where(np.isinf(nu), float(special.ndtri(probability)), quantile)[()]


def student_tail(t: Any, degrees: Any) -> Any:
    """Compute the probability that a number of Student's t exceeds t; of the normal for inf."""
    from scipy import special  # slow to import

    nu: Float[np.ndarray, "..."] = np.asarray(degrees, dtype=float)
    finite = np.where(np.isinf(nu), 1.0, nu)
    normal: Float[np.ndarray, "..."] = np.asarray(special.ndtr(-t), dtype=float)
    tail: Float[np.ndarray, "..."] = np.asarray(special.stdtr(finite, -t), dtype=float)
    return np.where(np.isinf(nu), normal, tail)[()]


def student_density(t: Any, degrees: float | int) -> Any:
    """Compute the density of Student's t."""
    from scipy import special  # slow to import

    if np.isinf(degrees):
        return normal_density(t)
    square = np.asarray(t, dtype=float) ** 2
    peak = special.poch(0.5 * degrees, 0.5) / np.sqrt(degrees * np.pi)
    return peak * np.exp(-0.5 * (degrees + 1.0) * np.log1p(square / degrees))


def normal_quantile(probability: float | int) -> float:
    """Compute the quantile of the standard normal distribution."""
    from scipy import special  # slow to import

    return float(special.ndtri(probability))


def normal_tail(x: float | int) -> float:
    """Compute the probability that a standard normal number exceeds x."""
    from scipy import special  # slow to import

    return float(special.ndtr(-x))


def normal_density(x: Any, std: float | int = 1.0) -> Any:
    """Compute the density of a normal number of mean zero."""
    z: Float[np.ndarray, "..."] = np.asarray(x, dtype=float) / std
    return np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * std)


def f_quantile(probability: float | int, degrees: float | int, degrees_below: float | int) -> float:
    """Compute the quantile of F for the degrees of numerator and denominator."""
    from scipy import special  # slow to import

    return float(special.fdtri(degrees, degrees_below, probability))


def f_tail(ratio: float | int, degrees: float | int, degrees_below: float | int) -> float:
    """Compute the probability that a ratio of two mean squares exceeds one that was seen."""
    from scipy import special  # slow to import

    return float(special.fdtrc(degrees, degrees_below, ratio))


def chi_square_tail(chi2: float | int, degrees: float | int) -> float:
    """Compute the probability that a chi-square exceeds one that was seen."""
    from scipy import special  # slow to import

    return float(special.chdtrc(degrees, chi2))
