"""The equations B(theta) z = 0 solved for their noisy signals, and the slope of the solution."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rotorfit.errors import EstimationError


def solved(
    tensor: Float[np.ndarray, "p j z"], theta: Float[np.ndarray, " p"], noisy: Sequence[int]
) -> tuple[Float[np.ndarray, "k z"], Float[np.ndarray, "k j"]]:
    """Return M^-1 B and M^-1."""
    B: Float[np.ndarray, "k z"] = np.einsum("p,pjz->jz", theta, tensor)
    both = np.concatenate([B, np.eye(len(B))], axis=1)
    try:
        both_solved: Float[np.ndarray, "k g"] = np.linalg.solve(B[:, list(noisy)], both)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise EstimationError("the equations cannot be solved for the noisy signals") from error
    return both_solved[:, : B.shape[1]], both_solved[:, B.shape[1] :]


def solved_jacobian(
    tensor: Float[np.ndarray, "p j z"],
    theta: Float[np.ndarray, " p"],
    dtheta: Float[np.ndarray, "p f"],
    noisy: Sequence[int],
) -> tuple[Float[np.ndarray, "k z"], Float[np.ndarray, "f k z"]]:
    """Return G = M^-1 B and d G / d phi = M^-1 (dB - dM G)."""
    G, inverse = solved(tensor, theta, noisy)
    # Of what many flights share out among them, each is moved by its own.
    own = np.flatnonzero(dtheta.any(axis=0))
    dB = np.einsum("pjz,pf->fjz", tensor, dtheta[:, own])
    dG = np.zeros((dtheta.shape[1], *G.shape))
    dG[own] = inverse @ (dB - dB[:, :, list(noisy)] @ G)
    return G, dG
