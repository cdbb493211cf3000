"""Plain matrices as problems for the estimators."""

import numpy as np

from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import time_block_factors
from rotorfit.estimation.parameter_map import ParameterMap


def plain_problem(A, y, *, block_rows=50, names=None):
    """Return A phi = y as a problem of one equation, whose signals are the columns of [A, -y].

    Parameter p moves signal p, and a last parameter, held at 1, moves y.
    """
    f = A.shape[1]
    Z = np.column_stack([A, -np.asarray(y)])
    return LinearProblem(
        factors=(time_block_factors(Z, block_rows=block_rows),),
        tensors=(np.eye(f + 1)[:, None, :],),
        map=ParameterMap(
            names=tuple(names or (f"p{i}" for i in range(f))),
            constant=np.eye(f + 1)[f:],
            matrix=np.eye(f + 1)[None, :, :f],
        ),
        weights=np.ones((1, 1)),
    )


def wrench_problem(Z, tensor, constant, *, weights, block_rows=50):
    """Return the equations of `tensor` with all parameters free beside `constant`, one dense set.

    `constant` is the value of the last parameter of the tensor.
    """
    p = len(tensor)
    known = np.zeros((1, p))
    known[0, -1] = constant
    return LinearProblem(
        factors=(time_block_factors(Z, block_rows=block_rows),),
        tensors=(tensor,),
        map=ParameterMap(
            names=tuple(f"p{i}" for i in range(p - 1)),
            constant=known,
            matrix=np.eye(p)[None, :, :-1],
        ),
        weights=np.asarray(weights, dtype=float)[None],
    )


def dense_rows(Z, tensor, constant, weights):
    """Return [A, b] of `wrench_problem`, sample by sample: A phi + b = 0."""
    rows = np.einsum("nz,pjz->njp", Z, tensor) * np.asarray(weights)[:, None]
    rows = rows.reshape(-1, len(tensor)).copy()
    rows[:, -1] *= constant
    return rows
