"""Linear problems and their estimates: singular values, free directions, numerical slopes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.estimation.parameter_map import ParameterMap


@frozen_dataclass
class LinearProblem:
    """Equations B(theta) z = 0 for every row z of every configuration's signals.

    - `factors`: one per configuration.
    - `tensors`: A_p of each configuration: equation j of parameter p is row ``tensors[c][p, j]``.
    - `map`: from the free parameters to theta.
    - `weights`: of each equation of each configuration.
    """

    factors: tuple[Factors, ...]
    tensors: tuple[Float[np.ndarray, "p j z"], ...]
    map: ParameterMap
    weights: Float[np.ndarray, "c j"]

    @property
    def rows(self) -> int:
        """Number of scalar equations in all: samples times equations that have weight."""
        counts = [int(part.rows.sum()) for part in self.factors]
        used = np.count_nonzero(self.weights, axis=1)
        return int(np.dot(counts, used))


@frozen_dataclass
class Estimate:
    """Free parameters with their covariance, and how well the equations determine them.

    - `names`, `values`, `covariance`: of the free parameters.
    - `condition_number`: of the equations with every column scaled to unit length.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " f"]
    covariance: Float[np.ndarray, "f f"]
    condition_number: float

    @property
    def std(self) -> Float[np.ndarray, " f"]:
        """Standard deviation of each free parameter."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def by_name(self) -> dict[str, float]:
        """The values by the names of the free parameters."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def value(self, name: str) -> float:
        """Look up the value of one free parameter."""
        return float(self.values[self.names.index(name)])


def equation_rows(
    R: Float[np.ndarray, "b z z"],
    tensor: Float[np.ndarray, "p j z"],
    parameter_map: tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p f"]],
    weights: Float[np.ndarray, " j"],
) -> Float[np.ndarray, "b m g"]:
    """Reduce the equations [d/d phi | constant] of each block to j z rows."""
    constant, matrix = parameter_map
    columns = np.concatenate([matrix, constant[:, None]], axis=1)
    used = np.flatnonzero(weights)
    B = np.einsum("pjz,pg->jzg", tensor[:, used], columns) * weights[used, None, None]
    # An orthogonal transform of the block's dense rows padded with zeros: same singular values,
    # same solutions.
    stacked = R @ B.transpose(1, 0, 2).reshape(R.shape[2], -1)
    return stacked.reshape(len(R), R.shape[1] * len(used), columns.shape[1])


def problem_rows(problem: LinearProblem) -> Float[np.ndarray, "m g"]:
    """Reduce the weighted equations [d/d phi | constant] of the whole problem."""
    parts = [
        equation_rows(
            factors.total[None],
            tensor,
            (problem.map.constant[c], problem.map.matrix[c]),
            problem.weights[c],
        )[0]
        for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True))
    ]
    rows = np.concatenate(parts)
    if not np.isfinite(rows).all():
        raise EstimationError("the equations hold NaN or infinity; check the signals' units")
    return rows


@frozen_dataclass
class ScaledSingular:
    """Singular values of equations whose columns are scaled to unit length."""

    lengths: Float[np.ndarray, " f"]
    U: Float[np.ndarray, "m f"]
    s: Float[np.ndarray, " f"]
    Vt: Float[np.ndarray, "f f"]

    @property
    def condition_number(self) -> float:
        """Largest over smallest; 10 is good, 255 is one axis flown at a time."""
        return float(self.s[0] / max(self.s[-1], np.finfo(float).tiny))

    @property
    def inverse_root(self) -> Float[np.ndarray, "f f"]:
        """A matrix G with G G^T the inverse of the normal equations' matrix, in given units."""
        return (self.Vt.T / self.s) / self.lengths[:, None]


def scaled_singular(rows: Float[np.ndarray, "m f"], names: tuple[str, ...]) -> ScaledSingular:
    """Decompose column-scaled equations; raise if too few or if a column is zero."""
    if rows.shape[0] < rows.shape[1]:
        raise EstimationError(
            f"{rows.shape[0]} equations cannot determine {rows.shape[1]} parameters; "
            "give a longer flight"
        )
    lengths = np.linalg.norm(rows, axis=0)
    if (lengths == 0).any():
        dead = ", ".join(name for name, n in zip(names, lengths, strict=True) if n == 0)
        raise EstimationError(f"the flight does not move {dead} at all; remove it or excite it")
    U, s, Vt = np.linalg.svd(rows / lengths, full_matrices=False)
    return ScaledSingular(lengths=lengths, U=U, s=s, Vt=Vt)


def refuse_free_direction(svd: ScaledSingular, names: tuple[str, ...]) -> None:
    """Raise an error if a direction of the parameters is known to no more than rounding."""
    if svd.s[-1] > svd.s[0] * 1e-13:
        return
    worst = names[int(np.argmax(np.abs(svd.Vt[-1])))]
    raise EstimationError(
        f"the equations leave a combination of parameters free (most of it {worst}); "
        "remove it, or fly a motion that separates it"
    )


def numerical_jacobian(
    function: Callable[[Float[np.ndarray, " f"]], Float[np.ndarray, " g"]],
    at: Float[np.ndarray, " f"],
    scale: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "g f"]:
    """Differentiate a function by central differences over a thousandth of each scale.

    A scale is a length over which the function changes little, such as a standard deviation; zeros
    are replaced by the size of the argument.
    """
    return jacobian_of_rows(lambda rows: np.array([function(row) for row in rows]), at, scale)


def jacobian_of_rows(
    function: Callable[[Float[np.ndarray, "m f"]], Float[np.ndarray, "m g"]],
    at: Float[np.ndarray, " f"],
    scale: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "g f"]:
    """Differentiate as `numerical_jacobian` a function that is called once, for many points."""
    step = 1e-3 * np.where(scale > 0, scale, np.maximum(np.abs(at), 1.0))
    shifts = np.diag(step)
    above, below = np.split(function(np.concatenate([at + shifts, at - shifts])), 2)
    return (above - below).T / (2.0 * step)
