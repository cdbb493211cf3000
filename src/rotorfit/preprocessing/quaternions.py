"""How axes turn with a body: quaternions, scalar first, many at a time."""

import numpy as np
from jaxtyping import Float

Vectors = Float[np.ndarray, "*m 3"]
Quaternions = Float[np.ndarray, "*m 4"]


def small_turns(angles: Vectors) -> Quaternions:
    """Return the quaternions of small rotation vectors [rad]."""
    half = 0.5 * np.linalg.norm(angles, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * angles * np.sinc(half / np.pi)], axis=-1)


def running_product(q: Quaternions) -> Quaternions:
    """Return q_1, q_1 q_2, q_1 q_2 q_3, ... in as many steps as the length has digits."""
    step = 1
    while step < len(q):
        q = np.concatenate([q[:step], _product(q[:-step], q[step:])])
        step *= 2
    return q


def rotated(q: Quaternions, v: Vectors) -> Vectors:
    """Return vectors of the body in the axes that q turns it from."""
    across = _cross(q[..., 1:], v)
    return v + 2.0 * (q[..., :1] * across + _cross(q[..., 1:], across))


def rotated_back(q: Quaternions, v: Vectors) -> Vectors:
    """Return vectors of those axes in the axes of the body."""
    return rotated(q * [1.0, -1.0, -1.0, -1.0], v)


def _product(p: Quaternions, q: Quaternions) -> Quaternions:
    a, b = p[..., 1:], q[..., 1:]
    scalar = p[..., :1] * q[..., :1] - (a * b).sum(axis=-1, keepdims=True)
    vector = p[..., :1] * b + q[..., :1] * a + _cross(a, b)
    return np.concatenate([scalar, vector], axis=-1)


def _cross(a: Vectors, b: Vectors) -> Vectors:
    """Return a x b; NumPy's own takes four times as long."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
