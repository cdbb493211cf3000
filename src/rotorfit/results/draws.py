"""Draws from a joint normal distribution, and the body about its CoM for each of them."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from rotorfit.model.parameters import COM, FIRST_MOMENTS, INERTIA, INERTIA_PLACES

Values = dict[str, Float[np.ndarray, " n"]]
"""Numbers by name, one for each draw."""


def normal_draws(
    covariance: Float[np.ndarray, "p p"], count: int, random: np.random.Generator
) -> Float[np.ndarray, "n p"]:
    """Return draws of mean zero; a covariance may be singular, as where kt is the mean of kt_i."""
    powers, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(powers, 0.0))
    return random.standard_normal((count, len(powers))) @ root.T


def about_com(values: Values) -> Values:
    """Return the values with the CoM and the inertia about it, of those at the origin.

    Parameters
    ----------
    values
        With ``mass``; first moments and inertia at the origin as far as they are known.
    """
    m, out = values["mass"], dict(values)
    out |= {
        name: values[moment] / m
        for name, moment in zip(COM, FIRST_MOMENTS, strict=True)
        if moment in values
    }
    if not all(name in out for name in COM):
        return out
    com = np.stack([out[name] for name in COM], axis=1)
    square = np.einsum("di,di->d", com, com)
    for name, (i, j) in zip(INERTIA, INERTIA_PLACES, strict=True):
        if name in values:
            moved = m * ((square if i == j else 0.0) - com[:, i] * com[:, j])
            out[f"{name}_com"] = values[name] - moved
    return out


def tensors(values: Mapping[str, Float[np.ndarray, " n"]]) -> Float[np.ndarray, "n 3 3"]:
    """Return the inertia about the CoM of each draw [kg m^2]."""
    columns = [values[f"{name}_com"] for name in INERTIA]
    out = np.empty((len(columns[0]), 3, 3))
    for column, (i, j) in zip(columns, INERTIA_PLACES, strict=True):
        out[:, i, j] = out[:, j, i] = column
    return out
