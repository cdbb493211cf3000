"""The problem of the banded estimator, and its equations solved for their noisy signals."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int, Shaped

    from rotorfit.estimation.factors import Factors
    from rotorfit.estimation.feedback import Feedback
    from rotorfit.estimation.parameter_map import ParameterMap

    Solution = tuple[Float[np.ndarray, "_ k z"], Float[np.ndarray, "_ k _ z"]]
    """G = M^-1 B of each part of a configuration, and its slope by the parameters that move it."""

RELATIVE_FLOOR: Final = 1e-9
"""Smallest variance, relative to the noisy signal's own: far under any sensor's, but a simulation
may be exact, and without a floor its likelihood is a valley that the iteration crawls along."""


RUN_OFF: Final = (
    "the flights move as no vehicle would, and their fit runs off without an end; look at the logs "
    "with rotorfit inspect, and leave bad parts out (start, end)"
)


@frozen_dataclass
class LateErrors:
    """A free parameter that moves the signals of one part, in some of its equations only.

    - `part`: which part, of all configurations.
    - `errors`: the equations, by their noisy signals.
    - `slope`: place of its slopes among those of the factors.
    """

    name: str
    part: int
    errors: tuple[int, ...]
    slope: int


@frozen_dataclass
class Part:
    """Blocks in succession that have a theta of their own.

    - `configuration`, `place`: whose they are, and which of its parts.
    - `local`, `blocks`: the blocks among those of their configuration, and among all.
    - `moved`: free parameters that move their theta or their signals.
    - `moving`: places of those that move their signals: first the problem's, then `late`.
    - `late`: those that move them in some of the equations only, by their places.
    """

    configuration: int
    place: int
    local: slice
    blocks: slice
    moved: Int[np.ndarray, " q"]
    moving: tuple[int, ...] = ()
    late: Mapping[int, LateErrors] = field(default_factory=dict[int, LateErrors])

    def at(self, places: Sequence[int]) -> list[int]:
        """Locate some parameters among those that move it."""
        return [int(np.flatnonzero(self.moved == place)[0]) for place in places]


@dataclass(frozen=True, kw_only=True)
class BandedProblem:
    """The problem of the banded estimator: factors, map and priors.

    - `factors`: one per configuration, a block per stretch and frequency band.
    - `tensors`: A_p of each configuration.
    - `map`: from the free parameters to theta of each configuration, or of each of its parts.
    - `parts`: how many blocks in succession have a theta of their own, of each configuration; none:
      all of each configuration have one.
    - `noisy`: which signals carry the noise, as many as there are equations.
    - `prior_mean`, `prior_std`: of free parameters that are known beforehand.
    - `counted`: which errors of each block count, one array per configuration; None: all.
    - `feedback`: where a controller responds to the errors, by the same parts.
    - `moving`: free parameters that move the signals, in the order of the factors' slopes.
    - `late`: free parameters that move those of one part, in some of its equations.
    - `error_correlation`: how much of each error (row) comes with the others (column), and is taken
      off it: strictly lower triangular up to the order of the errors, one per configuration.
    - `error_correlation_std`: deviation of these shares about zero before the flight.
    """

    factors: tuple[Factors, ...]
    tensors: tuple[Float[np.ndarray, "p j z"], ...]
    map: ParameterMap
    noisy: tuple[int, ...]
    prior_mean: Mapping[str, float]
    prior_std: Mapping[str, float]
    parts: tuple[tuple[int, ...], ...] = ()
    counted: tuple[Bool[np.ndarray, "_ k"], ...] = ()
    feedback: Feedback | None = None
    moving: tuple[str, ...] = ()
    late: tuple[LateErrors, ...] = ()
    error_correlation: tuple[Float[np.ndarray, "k k"], ...] = ()
    error_correlation_std: tuple[float, ...] = ()

    @cached_property
    def every_part(self) -> list[Part]:
        """The parts of all configurations; theta and responses are in their order."""
        counts = self.parts or [(len(factors),) for factors in self.factors]
        owners = [(c, t) for c, own in enumerate(counts) for t in range(len(own))]
        ends = pairwise(accumulate((n for own in counts for n in own), initial=0))
        firsts = [0, *accumulate(len(factors) for factors in self.factors)]
        moved = [places for own in self.moved for places in own]
        place = self.map.names.index
        late = [
            {place(one.name): one for one in self.late if one.part == k} for k in range(len(owners))
        ]
        return [
            Part(
                configuration=c,
                place=t,
                local=slice(first - firsts[c], last - firsts[c]),
                blocks=slice(first, last),
                moved=moved[number],
                moving=(*self.places, *late[number]),
                late=late[number],
            )
            for number, ((c, t), (first, last)) in enumerate(zip(owners, ends, strict=True))
        ]

    @cached_property
    def thetas(self) -> list[slice]:
        """The thetas of each configuration's parts."""
        counts = [len(own) for own in self.parts] or [1] * len(self.factors)
        return [slice(*ends) for ends in pairwise(accumulate(counts, initial=0))]

    @cached_property
    def moved(self) -> list[Int[np.ndarray, "_ _"]]:
        """The free parameters that move each part of each configuration, in their order."""
        moves = self.map.moves.copy()
        moves[:, self.places] = True
        for one in self.late:
            moves[one.part, self.map.names.index(one.name)] = True
        each = [moves[own] for own in self.thetas]
        # As many for all parts of one: others, which move nothing there, fill up.
        return [np.argsort(~m, axis=1, kind="stable")[:, : m.sum(axis=1).max()] for m in each]

    @cached_property
    def floors(self) -> list[Float[np.ndarray, " k"]]:
        """Smallest variance of each noisy signal in each configuration."""
        signals = split_blocks(signal_power(self), self.factors)
        return [
            RELATIVE_FLOOR * signal.sum(axis=0) / max(factors.rows.sum(), 1) + np.finfo(float).tiny
            for signal, factors in zip(signals, self.factors, strict=True)
        ]

    @property
    def places(self) -> list[int]:
        """Places among the free parameters of those that move all signals."""
        return [self.map.names.index(name) for name in self.moving]

    @property
    def prior(self) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, " f"]]:
        """Mean and deviation of every free parameter before the flight."""
        mean = [self.prior_mean.get(name, 0.0) for name in self.map.names]
        std = [self.prior_std.get(name, np.inf) for name in self.map.names]
        return np.array(mean), np.array(std)

    def moves(self, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, " t"]:
        """Select from `phi` how far the signals are moved."""
        return phi[self.places]

    def decorrelated(self, c: int, G: Float[np.ndarray, "t k *f"]) -> Float[np.ndarray, "t k *f"]:
        """Subtract from `G` of configuration `c` the correlated part of each error."""
        if not self.error_correlation:
            return G
        rows = G.reshape(*G.shape[:2], -1)
        return (rows - self.error_correlation[c] @ rows).reshape(G.shape)


def power_of(rows: Float[np.ndarray, "b m k"]) -> Float[np.ndarray, "b k"]:
    """Sum the squares of every column of each block."""
    return np.einsum("bmk,bmk->bk", rows, rows)


def signal_power(problem: BandedProblem) -> Float[np.ndarray, "b k"]:
    """Sum the squares of each noisy signal in every block."""
    noisy = list(problem.noisy)
    return np.concatenate([power_of(factors.R[:, :, noisy]) for factors in problem.factors])


def split_blocks(
    blocks: Shaped[np.ndarray, "b ..."], factors: Sequence[Factors]
) -> list[Shaped[np.ndarray, "_ ..."]]:
    """Split an array over all blocks by configuration."""
    return np.split(blocks, np.cumsum([len(f) for f in factors])[:-1])


def solved(
    tensor: Float[np.ndarray, "p j z"], theta: Float[np.ndarray, "*t p"], noisy: Sequence[int]
) -> tuple[Float[np.ndarray, "*t k z"], Float[np.ndarray, "*t k j"]]:
    """Compute M^-1 B and M^-1, of every theta."""
    B: Float[np.ndarray, "*t k z"] = np.tensordot(theta, tensor, axes=1)
    unit = np.broadcast_to(np.eye(B.shape[-2]), (*B.shape[:-1], B.shape[-2]))
    both = np.concatenate([B, unit], axis=-1)
    try:
        both_solved: Float[np.ndarray, "*t k g"] = np.linalg.solve(B[..., list(noisy)], both)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise EstimationError(RUN_OFF) from error
    return both_solved[..., : B.shape[-1]], both_solved[..., B.shape[-1] :]


def solved_jacobian(
    tensor: Float[np.ndarray, "p j z"],
    theta: Float[np.ndarray, "t p"],
    dtheta: Float[np.ndarray, "t p f"],
    noisy: Sequence[int],
) -> tuple[Float[np.ndarray, "t k z"], Float[np.ndarray, "t k f z"]]:
    """Compute G = M^-1 B and d G / d phi = M^-1 (dB - dM G), of every theta."""
    G, inverse = solved(tensor, theta, noisy)
    t, k, z = G.shape
    A = np.ascontiguousarray(tensor.transpose(1, 0, 2))
    # First by theta: few large products of matrices in place of many small ones.
    left = A - (A[:, :, list(noisy)].reshape(-1, k) @ G).reshape(t, *A.shape)
    by_theta = (inverse @ left.reshape(t, k, -1)).reshape(t, k, -1, z)
    return G, dtheta.transpose(0, 2, 1)[:, None] @ by_theta


def solved_each(
    problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> list[Float[np.ndarray, "_ k z"]]:
    """Compute G of the parts of each configuration."""
    theta = problem.map.theta(phi)
    each = zip(problem.tensors, problem.thetas, strict=True)
    return [solved(A, theta[own], problem.noisy)[0] for A, own in each]


def solutions(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> list[Solution]:
    """Compute G and d G / d phi of each configuration: d (M^-1 B) = M^-1 (dB - dM M^-1 B)."""
    theta, dtheta = problem.map.theta(phi), problem.map.jacobian(phi)
    return [
        solved_jacobian(
            tensor,
            theta[own],
            np.take_along_axis(dtheta[own], moved[:, None], axis=2),
            problem.noisy,
        )
        for tensor, own, moved in zip(problem.tensors, problem.thetas, problem.moved, strict=True)
    ]
