"""The equations B(theta) z = 0 solved for their noisy signals, and the slope of the solution."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rotorfit.errors import EstimationError


def solved(
    tensor: Float[np.ndarray, "p j z"], theta: Float[np.ndarray, "*t p"], noisy: Sequence[int]
) -> tuple[Float[np.ndarray, "*t k z"], Float[np.ndarray, "*t k j"]]:
    """Return M^-1 B and M^-1, of every theta."""
    B: Float[np.ndarray, "*t k z"] = np.tensordot(theta, tensor, axes=1)
    unit = np.broadcast_to(np.eye(B.shape[-2]), (*B.shape[:-1], B.shape[-2]))
    both = np.concatenate([B, unit], axis=-1)
    try:
        both_solved: Float[np.ndarray, "*t k g"] = np.linalg.solve(B[..., list(noisy)], both)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise EstimationError("the equations cannot be solved for the noisy signals") from error
    return both_solved[..., : B.shape[-1]], both_solved[..., B.shape[-1] :]


def solved_jacobian(
    tensor: Float[np.ndarray, "p j z"],
    theta: Float[np.ndarray, "t p"],
    dtheta: Float[np.ndarray, "t p f"],
    noisy: Sequence[int],
) -> tuple[Float[np.ndarray, "t k z"], Float[np.ndarray, "t k f z"]]:
    """Return G = M^-1 B and d G / d phi = M^-1 (dB - dM G), of every theta."""
    G, inverse = solved(tensor, theta, noisy)
    t, k, z = G.shape
    A = np.ascontiguousarray(tensor.transpose(1, 0, 2))
    # First by theta: few large products of matrices in place of many small ones.
    left = A - (A[:, :, list(noisy)].reshape(-1, k) @ G).reshape(t, *A.shape)
    by_theta = (inverse @ left.reshape(t, k, -1)).reshape(t, k, -1, z)
    return G, dtheta.transpose(0, 2, 1)[:, None] @ by_theta
