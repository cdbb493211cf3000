r"""The likelihood per frequency band, and its linearisation, by small matrices alone.

The equations are B(theta) z = 0; solved for the noisy signals, e = G z with G = M^-1 B. In a block
of triangular rows R the error of noisy signal k is R u_k with u_k the k-th row of G, and its slope
R d u_k / d phi: rows are needed once for the errors, and the information

.. math:: \sum_k \frac{\partial u_k}{\partial\phi}^T
    \Big(\sum_b R_b^T R_b / v_{bk}\Big) \frac{\partial u_k}{\partial\phi}

needs no more of the blocks than their Gram matrices, weighted and summed. `docs/theory.md`, "The
likelihood term by term", names the function of each term.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded_problem import (
    RUN_OFF,
    BandedProblem,
    power_of,
    solutions,
    solved_each,
    split_blocks,
)
from rotorfit.estimation.factors import Factors, borrowed_mean_square
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.estimation.banded_problem import Solution
    from rotorfit.estimation.feedback import Feedback

MOST_RESPONSE: Final = 10.0
"""Gain of log-likelihood by the autopilot's response for each row: of flights it is below zero, and
linear in the parameters, so that far off it would win without end."""
SMALLEST_PIVOT: Final = 1e-5
"""Smallest pivot of the column-scaled information for which its factor is used: its rounding
(1e-16 / pivot^2) is a millionth of a deviation. Below, the factor is made of the rows themselves:
what only a prior determines would drown beside exact flights."""


@frozen_dataclass
class State:
    """Where the equations are linearised.

    - `residual`: error of the noisy signals in the rows of every block's factor.
    - `variance`: of each noisy signal's error in each block, infinite if it does not count.
    """

    phi: Float[np.ndarray, " f"]
    residual: Float[np.ndarray, "b m k"]
    variance: Float[np.ndarray, "b k"]


@frozen_dataclass
class Evaluated(State):
    """The likelihood at such a point.

    - `cost`: minus twice the log-likelihood.
    - `squares`: of each block's errors, without what known noise of the regressors adds.
    - `rest`: what the prior and the responses of a controller add to the cost.
    """

    cost: float
    squares: Float[np.ndarray, "b k"]
    rest: float

    def over(self, variance: Float[np.ndarray, "b k"]) -> float:
        """Sum the squares over given variances, and the rest."""
        # Half its slope is the corrected score, in every block, so that a step along that lowers
        # it.
        return float((self.squares / variance).sum()) + self.rest


@frozen_dataclass
class CorrectedEquations:
    """The linearised equations of some blocks, and what known noise of the regressors adds.

    - `information`: of the blocks and of the prior.
    - `noise_information`: what of it is only the regressors' noise.
    - `reweighting`: what of it the variances take back that follow the errors; without what blocks
      borrow of each other exact, else the mean of it and its transpose.
    - `scores`: what each block asks for, corrected for that noise.
    - `prior_score`: what the prior asks for.
    """

    information: Float[np.ndarray, "f f"]
    noise_information: Float[np.ndarray, "f f"]
    reweighting: Float[np.ndarray, "f f"]
    scores: Float[np.ndarray, "b f"]
    prior_score: Float[np.ndarray, " f"]

    @property
    def score(self) -> Float[np.ndarray, " f"]:
        """Sum of all scores."""
        return self.scores.sum(axis=0) + self.prior_score


def evaluated(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Evaluated:
    """Evaluate residuals, variances and cost at `phi`; raise where nothing solves the equations."""
    found = solved_each(problem, phi)
    response = feedback_gain(problem, phi, found)
    rest = prior_cost(problem, phi) - 2.0 * response
    cost = rest
    # A controller answers to the errors as they are: its part above has G with their correlation.
    decorrelated = [problem.decorrelated(c, G) for c, G in enumerate(found)]
    residual = _block_errors(problem, phi, decorrelated)
    powers = split_blocks(power_of(residual), problem.factors)
    variances: list[Float[np.ndarray, "b k"]] = []
    squares: list[Float[np.ndarray, "b k"]] = []
    for c, (factors, G) in enumerate(zip(problem.factors, decorrelated, strict=True)):
        power, rows, floor = powers[c], factors.rows[:, None], problem.floors[c]
        # The variance at which the likelihood of these errors is largest: put in, minus twice its
        # logarithm is n log v of each block and a constant.
        own = borrowed_mean_square(power, factors)
        v, floored = np.maximum(own, floor), own < floor
        counted = problem.counted[c] if problem.counted else np.ones_like(v, dtype=bool)
        cost += float(np.sum(rows * np.log(v), where=counted))
        # At its floor a variance is no longer that of the errors: they have a cost of their own,
        # or the likelihood of exact flights would be flat.
        spare = np.minimum(power / v - rows, 0.0)
        cost += float(np.sum(spare, where=counted & floored))
        variances.append(np.where(counted, v, np.inf))
        # Noise of the regressors adds power that grows with the parameters: left in, a fit would
        # make them too small (attenuation; Fuller, Measurement Error Models, 1987, section 1.1).
        squares.append(power - rows * known_noise_variance(problem, c, G))
    if not np.isfinite(cost) or response > MOST_RESPONSE * _count_rows(problem):
        raise EstimationError(RUN_OFF)
    return Evaluated(
        phi=phi,
        residual=residual,
        variance=np.concatenate(variances),
        cost=cost,
        squares=np.concatenate(squares),
        rest=rest,
    )


def _count_rows(problem: BandedProblem) -> int:
    return sum(int(factors.rows.sum()) for factors in problem.factors)


def _block_errors(
    problem: BandedProblem,
    phi: Float[np.ndarray, " f"],
    found: Sequence[Float[np.ndarray, "_ k z"]],
) -> Float[np.ndarray, "b m k"]:
    """Compute the errors of all blocks; `found`: G of each part."""
    lifts = [factors.lift(problem.moves(phi)).T for factors in problem.factors]
    blocks = sum(len(factors) for factors in problem.factors)
    e = np.empty((blocks, problem.factors[0].columns.shape[1], len(problem.noisy)))
    for part in problem.every_part:
        c = part.configuration
        factors, G = problem.factors[c], found[c][part.place]
        columns, u = factors.columns[part.local], G @ lifts[c]
        for place, one in part.late.items():
            errors, by = list(one.errors), float(phi[place])
            u[errors] += by * G[errors] @ factors.slope_lifts[one.slope].T
        np.matmul(columns, u.T, out=e[part.blocks])
    return e


def known_noise_variance(
    problem: BandedProblem, c: int, G: Float[np.ndarray, "t k z"]
) -> Float[np.ndarray, "b k"]:
    """Compute the variance that known noise of the regressors adds to every block's errors."""
    noise = problem.factors[c].noise
    share = np.zeros((len(problem.factors[c]), G.shape[1]))
    for part in problem.every_part:
        if part.configuration == c and noise is not None:
            share[part.local] = noise[part.local] @ (G[part.place] ** 2).T
    return share


def evaluated_or_none(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Evaluated | None:
    """Evaluate at `phi`; None if nothing solves the equations."""
    try:
        return evaluated(problem, phi)
    except EstimationError:
        return None


def prior_cost(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    """Compute minus twice the logarithm of the prior."""
    mean, std = problem.prior
    known = np.isfinite(std)
    return float(np.sum(((phi - mean)[known] / std[known]) ** 2))


def feedback_gain(
    problem: BandedProblem,
    phi: Float[np.ndarray, " f"],
    found: Sequence[Float[np.ndarray, "_ k z"]],
) -> float:
    """Compute the controller's part of the log-likelihood; `found`: G of each configuration."""
    if problem.feedback is None:
        return 0.0
    gain = 0.0
    for number, part in enumerate(problem.every_part):
        gain += problem.feedback.gain(number, found[part.configuration][part.place])
        slopes = problem.feedback.responses[number].gain_slopes.sum(axis=(0, 1))
        gain += float(slopes @ phi[list(part.moving)])
    return gain


def feedback_scores(
    problem: BandedProblem, feedback: Feedback, found: Sequence[Solution]
) -> Float[np.ndarray, "b e f"]:
    """Differentiate the gain by the free parameters, by block and error."""
    blocks = sum(len(factors) for factors in problem.factors)
    scores = np.zeros((blocks, len(feedback.errors), len(problem.map.names)))
    for number, part in enumerate(problem.every_part):
        scores[part.blocks][:, :, part.moved] = _response_scores(problem, feedback, number, found)
    return scores


def _response_scores(
    problem: BandedProblem, feedback: Feedback, number: int, found: Sequence[Solution]
) -> Float[np.ndarray, "b e q"]:
    """Differentiate the gain of one part by the parameters that move it."""
    part = problem.every_part[number]
    G, dG = (each[part.place] for each in found[part.configuration])
    scores = feedback.slope(number, G, dG.transpose(1, 0, 2))
    scores[:, :, part.at(part.moving)] += feedback.responses[number].gain_slopes
    return scores


def decorrelated_solutions(problem: BandedProblem, found: Sequence[Solution]) -> list[Solution]:
    """Subtract the correlated part of each error from G and its slope."""
    return [
        (problem.decorrelated(c, G), problem.decorrelated(c, dG)) for c, (G, dG) in enumerate(found)
    ]


def lifted_slopes(
    problem: BandedProblem, phi: Float[np.ndarray, " f"], found: Sequence[Solution]
) -> list[Float[np.ndarray, "k a _"]]:
    """Compute d u / d phi of each part, by the columns of its factors and its moving parameters.

    `found`: G and slope of the errors in question (`decorrelated_solutions`).
    """
    lifts = [factors.lift(problem.moves(phi)) for factors in problem.factors]
    each = [dG @ lift.T for lift, (_, dG) in zip(lifts, found, strict=True)]
    slopes: list[Float[np.ndarray, "k a _"]] = []
    for part in problem.every_part:
        own = each[part.configuration][part.place].transpose(0, 2, 1)
        by = problem.factors[part.configuration].slope_lifts
        G, dG = (each[part.place] for each in found[part.configuration])
        # u = G lift: where a parameter moves the signals (lag, delay), the lift has a slope, too.
        for at, lift in zip(part.at(problem.places), by, strict=True):
            own[:, :, at] += G @ lift.T
        for at, (place, one) in zip(part.at([*part.late]), part.late.items(), strict=True):
            errors, lift, size = list(one.errors), by[one.slope].T, float(phi[place])
            own[errors] += size * (dG[errors] @ lift).transpose(0, 2, 1)
            own[errors, :, at] += G[errors] @ lift
        slopes.append(own)
    return slopes


def corrected_equations(problem: BandedProblem, state: State) -> CorrectedEquations:
    """Linearise the equations at a state."""
    responding = solutions(problem, state.phi)
    found = decorrelated_solutions(problem, responding)
    slopes = lifted_slopes(problem, state.phi, found)
    mean, std = problem.prior
    # A deviation that is infinite beforehand adds nothing.
    information = np.diag(std**-2.0)
    noise_information, reweighting = np.zeros_like(information), np.zeros_like(information)
    scores = np.zeros((len(state.variance), len(information)))
    for number, (part, dU) in enumerate(zip(problem.every_part, slopes, strict=True)):
        factors, w = problem.factors[part.configuration], 1.0 / state.variance[part.blocks]
        square = np.ix_(part.moved, part.moved)
        information[square] += _block_information(factors.gram[part.local], w, dU)
        each = _error_scores(factors.columns[part.local], state.residual[part.blocks], w, dU)
        # At its floor a variance stays where it is when the errors change.
        follows = w * (state.variance[part.blocks] > problem.floors[part.configuration])
        changes = _variance_changes(each, follows, factors, part.local)
        if factors.noise is not None:
            G, dG = (one[part.place] for one in found[part.configuration])
            noise, rows = factors.noise[part.local], factors.rows[part.local, None]
            by_noise = rows * noise @ (dG * G[:, None]).transpose(0, 2, 1)
            each = each + w.T[:, :, None] * by_noise
            noise_information[square] += _noise_information(noise, rows * w, dG)
        turned = np.tensordot(each, changes, axes=([0, 1], [0, 1]))
        reweighting[square] += 0.5 * (turned + turned.T)
        own = each.sum(axis=0)
        if problem.feedback is not None:
            own += _response_scores(problem, problem.feedback, number, responding).sum(axis=1)
        scores[part.blocks, part.moved] = own
    return CorrectedEquations(
        information=information,
        noise_information=noise_information,
        reweighting=reweighting,
        scores=scores,
        prior_score=(mean - state.phi) * std**-2.0,
    )


def _error_scores(
    columns: Float[np.ndarray, "b m a"],
    residual: Float[np.ndarray, "b m k"],
    weight: Float[np.ndarray, "b k"],
    dU: Float[np.ndarray, "k a q"],
) -> Float[np.ndarray, "k b q"]:
    """Compute what each error of every block of one part asks for."""
    asked = (residual * weight[:, None, :]).transpose(0, 2, 1)
    scores: Float[np.ndarray, "k b q"] = -(asked @ columns).transpose(1, 0, 2) @ dU
    return scores


def part_information(
    problem: BandedProblem,
    state: State,
    chosen: Sequence[Bool[np.ndarray, " b"]],
    *,
    corrected: bool = True,
) -> Float[np.ndarray, "p f f"]:
    """Compute the information of choices of blocks, without the prior's.

    `corrected`: less the part that is only known noise of the regressors.
    """
    found = decorrelated_solutions(problem, solutions(problem, state.phi))
    slopes = lifted_slopes(problem, state.phi, found)
    size = len(problem.map.names)
    out = np.zeros((len(chosen), size, size))
    for part, dU in zip(problem.every_part, slopes, strict=True):
        factors, w = problem.factors[part.configuration], 1.0 / state.variance[part.blocks]
        square = np.ix_(part.moved, part.moved)
        for p, blocks in enumerate(chosen):
            own = np.flatnonzero(blocks[part.blocks])
            if not len(own):
                continue
            out[p][square] += _block_information(factors.gram[part.local][own], w[own], dU)
            if factors.noise is not None and corrected:
                dG, rows = found[part.configuration][1], factors.rows[part.local, None]
                noise = factors.noise[part.local][own]
                out[p][square] -= _noise_information(noise, (rows * w)[own], dG[part.place])
    return out


def _noise_information(
    noise: Float[np.ndarray, "b z"],
    weight: Float[np.ndarray, "b k"],
    dG: Float[np.ndarray, "k q z"],
) -> Float[np.ndarray, "q q"]:
    """Compute the part of blocks' information that is only the regressors' known noise."""
    weighed: Float[np.ndarray, "k z"] = weight.T @ noise
    found: Float[np.ndarray, "q q"] = (dG * weighed[:, None] @ dG.transpose(0, 2, 1)).sum(axis=0)
    return found


def _block_information(
    gram: Float[np.ndarray, "b a a"],
    weight: Float[np.ndarray, "b k"],
    dU: Float[np.ndarray, "k a q"],
) -> Float[np.ndarray, "q q"]:
    """Compute the information of blocks of one part, by their Gram matrices."""
    S = np.tensordot(weight, gram, axes=(0, 0))
    found: Float[np.ndarray, "q q"] = (dU.transpose(0, 2, 1) @ S @ dU).sum(axis=0)
    return found


def _variance_changes(
    scores: Float[np.ndarray, "k b q"],
    weight: Float[np.ndarray, "b k"],
    factors: Factors,
    part: slice,
) -> Float[np.ndarray, "k b q"]:
    r"""Differentiate minus the logarithm of every variance of one part, which follows the errors.

    With w the share of one block's squares in what another one borrows,

    .. math:: -\frac{1}{v_{bk}} \frac{\partial v_{bk}}{\partial\phi}
        = \frac{2}{v_{bk}} \sum_c w_{bc} v_{ck} s_{ck} .

    `scores`: of the errors alone. `weight`: 1 / v, zero where the variance does not follow.
    """
    w = weight.T[:, :, None]
    squares = np.divide(scores, w, out=np.zeros_like(scores), where=w > 0.0)
    follow = borrowed_mean_square(squares.transpose(1, 0, 2), factors, part).transpose(1, 0, 2)
    return 2.0 * w * follow


def root_of(
    problem: BandedProblem, state: State, information: Float[np.ndarray, "f f"]
) -> Float[np.ndarray, "f f"]:
    """Factor the information of all blocks into R^T R, R upper triangular."""
    if not (np.diagonal(information) > 0.0).all():
        raise EstimationError("the flights do not move a parameter at all; remove its term")
    lengths = np.sqrt(np.diagonal(information))
    try:
        R = np.linalg.cholesky(information / np.outer(lengths, lengths)).T
    except np.linalg.LinAlgError:
        return _root_of_rows(problem, state)
    accurate = np.diagonal(R).min() > SMALLEST_PIVOT
    return R * lengths if accurate else _root_of_rows(problem, state)


def _root_of_rows(problem: BandedProblem, state: State) -> Float[np.ndarray, "f f"]:
    """Compute that root from the rows: twice as many digits, at many times the cost."""
    parts = [np.diag(1.0 / problem.prior[1])]
    found = decorrelated_solutions(problem, solutions(problem, state.phi))
    slopes = lifted_slopes(problem, state.phi, found)
    for part, dU in zip(problem.every_part, slopes, strict=True):
        columns = problem.factors[part.configuration].columns[part.local]
        weights = 1.0 / np.sqrt(state.variance[part.blocks])
        for w, slope in zip(weights.T, dU, strict=True):
            rows = (columns * w[:, None, None]).reshape(-1, columns.shape[2])
            own = np.zeros((min(rows.shape), len(problem.map.names)))
            own[:, part.moved] = np.asarray(np.linalg.qr(rows, mode="r")) @ slope
            parts.append(own)
    return np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))


def selected(
    problem: BandedProblem, state: State, blocks: Bool[np.ndarray, " b"]
) -> tuple[BandedProblem, State]:
    """Select blocks of the problem and of the state, with the variances of all of them."""
    keep = split_blocks(blocks, problem.factors)
    each = [blocks[part.blocks] for part in problem.every_part]
    counts = [int(own.sum()) for own in each]
    feedback = problem.feedback
    chosen = replace(
        problem,
        factors=tuple(f.select(k) for f, k in zip(problem.factors, keep, strict=True)),
        parts=tuple(tuple(counts[own]) for own in problem.thetas),
        counted=tuple(c[k] for c, k in zip(problem.counted, keep, strict=False)),
        feedback=None if feedback is None else feedback.select(each),
    )
    return chosen, replace(state, residual=state.residual[blocks], variance=state.variance[blocks])
