r"""The likelihood per frequency band, and its linearisation, by small matrices alone.

The equations are B(theta) z = 0; solved for the noisy signals, e = G z with G = M^-1 B. In a block
of triangular rows R the error of noisy signal k is R u_k with u_k the k-th row of G, and its slope
R d u_k / d phi: rows are needed once for the errors, and the information

.. math:: \sum_k \frac{\partial u_k}{\partial\phi}^T
    \Big(\sum_b R_b^T R_b / v_{bk}\Big) \frac{\partial u_k}{\partial\phi}

needs no more of the blocks than their Gram matrices, weighted and summed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Shaped

from rotorfit.errors import EstimationError
from rotorfit.estimation.factors import Factors, borrowed_mean_square
from rotorfit.estimation.feedback import Feedback
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.estimation.solved import solved, solved_jacobian

RELATIVE_FLOOR: Final = 1e-9
"""Smallest variance, relative to the noisy signal's own: far under any sensor's, but a simulation
may be exact, and without a floor its likelihood is a valley that the iteration crawls along."""
SMALLEST_PIVOT: Final = 1e-4
"""Of the column-scaled information, under which its rounding (1e-16 / pivot^2) would show: it is
made of the rows themselves there. What only a prior determines would drown beside exact flights."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BandedProblem:
    """What the estimator is handed; it knows of no drone.

    Attributes
    ----------
    factors
        One per configuration, a block per stretch and frequency band.
    tensors
        A_p of each configuration.
    map
        From the free parameters to each configuration's theta.
    noisy
        Which signals carry the noise, as many as there are equations.
    prior_mean, prior_std
        Of free parameters that are known beforehand.
    counted
        Which errors of each block count, one array per configuration; all where there is none.
    feedback
        Where a controller answers the errors.
    moving
        Free parameters that move the signals, in the order of the factors' slopes.
    tied
        How much of each error (row) comes with the others (column), and is taken off it: strictly
        lower triangular up to the order of the errors, one per configuration; nothing by default.
    """

    factors: tuple[Factors, ...]
    tensors: tuple[Float[np.ndarray, "p j z"], ...]
    map: ParameterMap
    noisy: tuple[int, ...]
    prior_mean: Mapping[str, float]
    prior_std: Mapping[str, float]
    counted: tuple[Bool[np.ndarray, "_ k"], ...] = ()
    feedback: Feedback | None = None
    moving: tuple[str, ...] = ()
    tied: tuple[Float[np.ndarray, "k k"], ...] = ()

    @property
    def places(self) -> list[int]:
        """Places among the free parameters of those that move the signals."""
        return [self.map.names.index(name) for name in self.moving]

    @property
    def prior(self) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, " f"]]:
        """Mean and deviation of every free parameter before the flight."""
        mean = [self.prior_mean.get(name, 0.0) for name in self.map.names]
        std = [self.prior_std.get(name, np.inf) for name in self.map.names]
        return np.array(mean), np.array(std)

    def moves(self, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, " t"]:
        """Return how far the signals are moved at `phi`."""
        return phi[self.places]

    def untied(self, c: int, G: Float[np.ndarray, "*f k z"]) -> Float[np.ndarray, "*f k z"]:
        """Return what makes the errors of configuration `c` without what comes with the others."""
        return G - self.tied[c] @ G if self.tied else G


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Where the equations are linearised.

    Attributes
    ----------
    phi
        The point.
    residual
        Error of the noisy signals in the rows of every block's factor.
    variance
        Of each noisy signal's error in each block, infinite where it does not count.
    """

    phi: Float[np.ndarray, " f"]
    residual: Float[np.ndarray, "b m k"]
    variance: Float[np.ndarray, "b k"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluated(State):
    """The likelihood at such a point.

    Attributes
    ----------
    cost
        Minus twice the log-likelihood.
    squares
        Of the errors of each block, without what known noise of the regressors adds to them.
    rest
        What the prior and the answers of a controller add to the cost.
    """

    cost: float
    squares: Float[np.ndarray, "b k"]
    rest: float

    def over(self, variance: Float[np.ndarray, "b k"]) -> float:
        """Return the squares over given variances, and the rest.

        Half its slope is the corrected score, in every block, so that a step along that lowers it.
        """
        return float((self.squares / variance).sum()) + self.rest


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectedEquations:
    """The linearised equations of some blocks, and what known noise of the regressors adds.

    Attributes
    ----------
    plain
        The information of the blocks and of the prior.
    taken
        What of it is only the regressors' noise.
    scores
        What each block asks for, corrected for that noise.
    pull
        What the prior asks for.
    """

    plain: Float[np.ndarray, "f f"]
    taken: Float[np.ndarray, "f f"]
    scores: Float[np.ndarray, "b f"]
    pull: Float[np.ndarray, " f"]

    @property
    def score(self) -> Float[np.ndarray, " f"]:
        """What all of them ask for."""
        return self.scores.sum(axis=0) + self.pull


def evaluated(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Evaluated:
    """Return residuals, variances and cost at `phi`.

    Raises
    ------
    EstimationError
        If the equations cannot be solved for the noisy signals there.
    """
    found = solved_each(problem, phi)
    rest = prior_cost(problem, phi) - 2.0 * feedback_gain(problem, phi, found)
    cost = rest
    residuals: list[Float[np.ndarray, "b m k"]] = []
    variances: list[Float[np.ndarray, "b k"]] = []
    squares: list[Float[np.ndarray, "b k"]] = []
    for c, (factors, solved_G) in enumerate(zip(problem.factors, found, strict=True)):
        G = problem.untied(c, solved_G)
        e = factors.columns @ (factors.lift(problem.moves(phi)) @ G.T)
        power = power_of(e)
        v, floored = _variance(power, factors, problem.noisy)
        counted = problem.counted[c] if problem.counted else np.ones_like(v, dtype=bool)
        cost += float(np.sum(factors.rows[:, None] * np.log(v), where=counted))
        # At its floor a variance is no longer that of the errors: they have a cost of their own,
        # or the likelihood of exact flights would be flat.
        spare = np.minimum(power / v - factors.rows[:, None], 0.0)
        cost += float(np.sum(spare, where=counted & floored))
        residuals.append(e)
        variances.append(np.where(counted, v, np.inf))
        squares.append(power - factors.rows[:, None] * known_share(factors, G))
    if not np.isfinite(cost):
        raise EstimationError("the likelihood is not finite here")
    return Evaluated(
        phi=phi,
        residual=np.concatenate(residuals),
        variance=np.concatenate(variances),
        cost=cost,
        squares=np.concatenate(squares),
        rest=rest,
    )


def solved_each(
    problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> list[Float[np.ndarray, "k z"]]:
    """Return G of each configuration."""
    theta = problem.map.theta(phi)
    return [solved(A, theta[c], problem.noisy)[0] for c, A in enumerate(problem.tensors)]


def known_share(factors: Factors, G: Float[np.ndarray, "k z"]) -> Float[np.ndarray, "b k"]:
    """Return what the regressors' known noise adds to the variance of every block's errors."""
    return factors.known_noise @ (G * G).T


def evaluated_or_none(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Evaluated | None:
    """Return the same, None where the equations cannot be solved."""
    try:
        return evaluated(problem, phi)
    except EstimationError:
        return None


def power_of(rows: Float[np.ndarray, "b m k"]) -> Float[np.ndarray, "b k"]:
    """Return the sum of squares of every column of each block."""
    return np.einsum("bmk,bmk->bk", rows, rows)


def signal_power(problem: BandedProblem) -> Float[np.ndarray, "b k"]:
    """Return the sum of squares of each noisy signal in every block."""
    noisy = list(problem.noisy)
    return np.concatenate([power_of(factors.R[:, :, noisy]) for factors in problem.factors])


def _variance(
    power: Float[np.ndarray, "b k"], factors: Factors, noisy: Sequence[int]
) -> tuple[Float[np.ndarray, "b k"], Bool[np.ndarray, "b k"]]:
    """Return each block's mean square error per noisy signal, and where it is at its floor.

    Blocks of few rows borrow from their neighbours.
    """
    signal = power_of(factors.R[:, :, list(noisy)]).sum(axis=0)
    floor = RELATIVE_FLOOR * signal / factors.rows.sum() + np.finfo(float).tiny
    own = borrowed_mean_square(power, factors)
    return np.maximum(own, floor), own < floor


def prior_cost(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    """Return minus twice the logarithm of the prior."""
    mean, std = problem.prior
    known = np.isfinite(std)
    return float(np.sum(((phi - mean)[known] / std[known]) ** 2))


def feedback_gain(
    problem: BandedProblem, phi: Float[np.ndarray, " f"], found: Sequence[Float[np.ndarray, "k z"]]
) -> float:
    """Return what the answers of a controller add to the log-likelihood; `found` is G of each."""
    if problem.feedback is None:
        return 0.0
    moves = problem.moves(phi)
    gain = 0.0
    for c, G in enumerate(found):
        gain += problem.feedback.gain(c, G)
        gain += float(problem.feedback.answers[c].drift.sum(axis=(0, 1)) @ moves)
    return gain


Solution = tuple[Float[np.ndarray, "k z"], Float[np.ndarray, "f k z"]]
"""G = M^-1 B of a configuration, and its slope by the free parameters."""


def solutions(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> list[Solution]:
    """Return G and d G / d phi of each configuration: d (M^-1 B) = M^-1 (dB - dM M^-1 B)."""
    theta, dtheta = problem.map.theta(phi), problem.map.jacobian(phi)
    return [
        solved_jacobian(tensor, theta[c], dtheta[c], problem.noisy)
        for c, tensor in enumerate(problem.tensors)
    ]


def feedback_scores(
    problem: BandedProblem, feedback: Feedback, found: Sequence[Solution]
) -> Float[np.ndarray, "b e f"]:
    """Return the derivative of the gain by the free parameters, by block and answered error.

    `feedback` is that of the problem, or one with other answers.
    """
    parts: list[Float[np.ndarray, "b e f"]] = []
    for c, (G, dG) in enumerate(found):
        own = feedback.slope(c, G, dG)
        own[:, :, problem.places] += feedback.answers[c].drift
        parts.append(own)
    return np.concatenate(parts)


def split_blocks(
    blocks: Shaped[np.ndarray, "b ..."], factors: Sequence[Factors]
) -> list[Shaped[np.ndarray, "_ ..."]]:
    """Return what is told of every block, configuration by configuration."""
    return np.split(blocks, np.cumsum([len(f) for f in factors])[:-1])


def untied_solutions(problem: BandedProblem, found: Sequence[Solution]) -> list[Solution]:
    """Return what makes the errors without what comes with others, and its slope."""
    return [(problem.untied(c, G), problem.untied(c, dG)) for c, (G, dG) in enumerate(found)]


def lifted_slopes(
    problem: BandedProblem, phi: Float[np.ndarray, " f"], found: Sequence[Solution]
) -> list[Float[np.ndarray, "k a f"]]:
    """Return d u / d phi of each configuration, by the columns of its factors.

    `found` is of the errors that are looked at (`untied_solutions`).
    """
    parts: list[Float[np.ndarray, "k a f"]] = []
    for factors, (G, dG) in zip(problem.factors, found, strict=True):
        lift, moved = factors.lift(problem.moves(phi)), np.flatnonzero(dG.any(axis=(1, 2)))
        own = np.zeros((dG.shape[1], len(lift), len(dG)))
        own[:, :, moved] = lift @ dG[moved].transpose(1, 2, 0)
        for place, lift in zip(problem.places, factors.slope_lifts, strict=True):
            own[:, :, place] += G @ lift.T
        parts.append(own)
    return parts


def corrected_equations(problem: BandedProblem, state: State) -> CorrectedEquations:
    """Return the linearised equations at a state."""
    answered = solutions(problem, state.phi)
    found = untied_solutions(problem, answered)
    dU = lifted_slopes(problem, state.phi, found)
    mean, std = problem.prior
    plain = np.diag(std**-2.0)
    taken = np.zeros_like(plain)
    scores: list[Float[np.ndarray, "b f"]] = []
    weights = split_blocks(1.0 / state.variance, problem.factors)
    errors = split_blocks(state.residual, problem.factors)
    for c, (factors, w) in enumerate(zip(problem.factors, weights, strict=True)):
        plain += _information(factors, w, dU[c])
        asked = factors.columns.transpose(0, 2, 1) @ (errors[c] * w[:, None, :])
        moved = np.flatnonzero(dU[c].any(axis=(0, 1)))
        own = np.zeros((len(factors), len(plain)))
        own[:, moved] = -np.tensordot(asked, dU[c][:, :, moved], axes=((2, 1), (0, 1)))
        if factors.noise is not None:
            G, dG = found[c]
            N = factors.rows[:, None] * factors.known_noise
            shares = N @ (dG * G).transpose(1, 2, 0)
            own += (w.T[:, :, None] * shares).sum(axis=0)
            taken += _taken(factors, w, dG)
        scores.append(own)
    every = np.concatenate(scores)
    if problem.feedback is not None:
        every += feedback_scores(problem, problem.feedback, answered).sum(axis=1)
    return CorrectedEquations(
        plain=plain, taken=taken, scores=every, pull=(mean - state.phi) * std**-2.0
    )


def part_information(
    problem: BandedProblem, state: State, parts: Sequence[Bool[np.ndarray, " b"]]
) -> Float[np.ndarray, "p f f"]:
    """Return the information of parts of the blocks, corrected, without the prior's."""
    found = untied_solutions(problem, solutions(problem, state.phi))
    dU = lifted_slopes(problem, state.phi, found)
    weights = split_blocks(1.0 / state.variance, problem.factors)
    size = len(problem.map.names)
    out = np.zeros((len(parts), size, size))
    for p, part in enumerate(parts):
        chosen = split_blocks(part, problem.factors)
        for c, (factors, w, own) in enumerate(zip(problem.factors, weights, chosen, strict=True)):
            if own.any():
                out[p] += _of_gram(factors.gram[own], w[own], dU[c])
            if own.any() and factors.noise is not None:
                out[p] -= _taken(factors, w * own[:, None], found[c][1])
    return out


def _taken(
    factors: Factors, weight: Float[np.ndarray, "b k"], dG: Float[np.ndarray, "f k z"]
) -> Float[np.ndarray, "f f"]:
    """Return what of one configuration's information is only the regressors' known noise."""
    slope = dG.transpose(1, 0, 2)
    noise = (weight * factors.rows[:, None]).T @ factors.known_noise
    found: Float[np.ndarray, "f f"] = (slope * noise[:, None] @ slope.transpose(0, 2, 1)).sum(
        axis=0
    )
    return found


def _information(
    factors: Factors, weight: Float[np.ndarray, "b k"], dU: Float[np.ndarray, "k a f"]
) -> Float[np.ndarray, "f f"]:
    """Return the information of one configuration's blocks, by their Gram matrices."""
    return _of_gram(factors.gram, weight, dU)


def _of_gram(
    gram: Float[np.ndarray, "b a a"],
    weight: Float[np.ndarray, "b k"],
    dU: Float[np.ndarray, "k a f"],
) -> Float[np.ndarray, "f f"]:
    S = np.tensordot(weight, gram, axes=(0, 0))
    moved = np.flatnonzero(dU.any(axis=(0, 1)))
    own = dU[:, :, moved]
    found = np.zeros((dU.shape[2], dU.shape[2]))
    found[np.ix_(moved, moved)] = (own.transpose(0, 2, 1) @ S @ own).sum(axis=0)
    return found


def root_of(
    problem: BandedProblem, state: State, plain: Float[np.ndarray, "f f"]
) -> Float[np.ndarray, "f f"]:
    """Return an upper triangular R of which R^T R is the information `plain` of all blocks.

    Raises
    ------
    EstimationError
        If a parameter is not moved at all.
    """
    lengths = np.sqrt(np.diagonal(plain))
    if not (lengths > 0.0).all():
        raise EstimationError("the flights do not move a parameter at all; remove its term")
    try:
        R = np.linalg.cholesky(plain / np.outer(lengths, lengths)).T
    except np.linalg.LinAlgError:
        return _root_of_rows(problem, state)
    accurate = np.diagonal(R).min() > SMALLEST_PIVOT
    return R * lengths if accurate else _root_of_rows(problem, state)


def _root_of_rows(problem: BandedProblem, state: State) -> Float[np.ndarray, "f f"]:
    """Return the same, from the rows: twice as many digits, at many times the cost."""
    parts = [np.diag(1.0 / problem.prior[1])]
    weights = split_blocks(1.0 / np.sqrt(state.variance), problem.factors)
    found = untied_solutions(problem, solutions(problem, state.phi))
    slopes = lifted_slopes(problem, state.phi, found)
    for factors, w, dU in zip(problem.factors, weights, slopes, strict=True):
        for k in range(w.shape[1]):
            rows = (factors.columns * w[:, k, None, None]).reshape(-1, factors.columns.shape[2])
            parts.append(np.asarray(np.linalg.qr(rows, mode="r")) @ dU[k])
    return np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))


def selected(
    problem: BandedProblem, state: State, blocks: Bool[np.ndarray, " b"]
) -> tuple[BandedProblem, State]:
    """Return the problem and the state of some blocks, with the variances of all of them."""
    keep = split_blocks(blocks, problem.factors)
    feedback = problem.feedback
    chosen = replace(
        problem,
        factors=tuple(f.select(k) for f, k in zip(problem.factors, keep, strict=True)),
        counted=tuple(c[k] for c, k in zip(problem.counted, keep, strict=False)),
        feedback=None if feedback is None else feedback.select(keep),
    )
    return chosen, replace(state, residual=state.residual[blocks], variance=state.variance[blocks])
