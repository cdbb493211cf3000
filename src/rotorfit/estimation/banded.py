r"""The default estimator: errors-in-variables likelihood per frequency band.

The equations are B(theta) z = 0 with B linear in theta. Of the signals z some are noisy (for a
flight: the six accelerations); M(theta) is B restricted to them. Solved for the noisy signals, the
residual of a row is their own error,

.. math:: e = M(\theta)^{-1} B(\theta) z,

which unlike B z cannot be made small by shrinking theta. Its variance in every block (stretch of
flight and frequency band) is estimated from the residuals themselves, and theta minimises
:math:`\sum_b n_b \sum_k \log v_{bk}(\theta)`, the likelihood with those variances put in. Since
:math:`|N^{-1/2} e| = |(M N M^T)^{-1/2} B z|`, this is structured errors in variables with the noise
of every band unknown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.errors import EstimationError, UnsettledError
from rotorfit.estimation.damped_steps import damped_step, eased, extrapolated
from rotorfit.estimation.estimate import Estimate, scaled_singular
from rotorfit.estimation.factors import Factors, borrowed_mean_square
from rotorfit.estimation.feedback import Feedback
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.estimation.solved import solved, solved_jacobian

MOST_ITERATIONS = 100
SMALLEST_STEP = 1e-3
"""The iteration ends when no parameter moves by more than this share of its deviation."""
LEAST_WIN = 0.02
"""Of the cost, twice the log-likelihood, in `PATIENCE` steps: where they win less, the iteration is
at the bottom, too, or goes round it; a parameter there is known to a tenth of its deviation."""
PATIENCE = 15
FEW_STEPS = 12
"""After which crawling steps are extrapolated."""
LARGEST_DAMPING = 1e9
"""Where the iteration ends, too: a step along the slope of which next to nothing is left."""
RELATIVE_FLOOR = 1e-9
"""Smallest variance, relative to the noisy signal's own: far under any sensor's, but a simulation
may be exact, and without a floor its likelihood is a valley that the iteration crawls along."""


MOST_NOISE = 0.7
"""Share of the regressors' noise in the information on a direction, over which the correction for
it is larger than what it corrects: nothing is known there."""
STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 1e-3)
UNKNOWN = 10.0
"""Factor on the deviation of such a direction."""
BLOCKS_AT_ONCE = 256
"""In the products of a long flight's rows."""


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

    def moves(self, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, " t"]:
        """Return how far the signals are moved at `phi`."""
        return phi[[self.map.names.index(name) for name in self.moving]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BandedEstimate:
    """An estimate, and what each block had to say to it.

    Attributes
    ----------
    estimate
        Free parameters with the covariance of the fit.
    influence
        First-order change of each parameter if a block were counted twice; blocks of all
        configurations, one after the other.
    variance
        Of each noisy signal's error in each block, infinite where it does not count.
    signal_power, residual_power
        Sum of squares of each noisy signal, and of its error, in each block.
    log_likelihood
        Up to a constant; for comparing models and delays on the same flights.
    iterations
        Until the steps were small.
    problem
        What was solved: for looking at parts of it afterwards.
    residual
        Error of the noisy signals in the rows of each block's factor.
    """

    estimate: Estimate
    influence: Float[np.ndarray, "b f"]
    variance: Float[np.ndarray, "b k"]
    signal_power: Float[np.ndarray, "b k"]
    residual_power: Float[np.ndarray, "b k"]
    log_likelihood: float
    iterations: int
    problem: BandedProblem
    residual: Float[np.ndarray, "b m k"]


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalEquations:
    """The linearised equations of some blocks of an estimate, at the estimate.

    Attributes
    ----------
    information
        Of the free parameters, the prior's included.
    scores
        What each block asks for, zeros for blocks left out; last what the prior asks for. The
        step of these blocks alone is information^-1 times their sum.
    """

    information: Float[np.ndarray, "f f"]
    scores: Float[np.ndarray, "c f"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _State:
    """The likelihood and its linearisation at one point."""

    phi: Float[np.ndarray, " f"]
    residual: Float[np.ndarray, "b m k"]
    variance: Float[np.ndarray, "b k"]
    cost: float


def banded(problem: BandedProblem, start: Float[np.ndarray, " f"]) -> BandedEstimate:
    """Return the estimate, by Levenberg-Marquardt steps on the likelihood.

    The damping follows how much of the foretold gain each step makes (Nielsen, Damping parameter
    in Marquardt's method, IMM-REP-1999-05, Technical University of Denmark, 1999).

    Parameters
    ----------
    problem
        Factors, tensors, map.
    start
        Free parameters to begin with; a crude guess is enough.

    Raises
    ------
    EstimationError
        If the equations cannot be solved for the noisy signals, or the iteration does not settle.
    """
    state = _evaluate(problem, start)
    if any(factors.noise is not None for factors in problem.factors):
        return _finished(problem, *_settled_with_noise(problem, state))
    damping, rise, costs = 1e-3, 2.0, [state.cost]
    path: tuple[Float[np.ndarray, " f"], ...] = ()
    for iteration in range(1, MOST_ITERATIONS + 1):
        A, b = _linearised(problem, state)
        extra = _feedback_scores(problem, state.phi).sum(axis=0)
        taken = damped_step(A, b, damping, extra)
        trial = _evaluate_or_none(problem, state.phi + taken.step)
        # With the variances of the last point: where these squares fall, the likelihood rises,
        # for log x <= x - 1; and blocks that borrow their variance cannot hold up the last steps.
        before = _squares(problem, state, state.variance)
        won = -np.inf if trial is None else before - _squares(problem, trial, state.variance)
        if trial is not None and won >= 0.0:
            state, rise = trial, 2.0
            damping = eased(damping, won, taken.foretold)
        else:
            damping, rise = damping * rise, rise * 2.0
        small = bool(np.all(np.abs(taken.step) <= SMALLEST_STEP * taken.std))
        costs.append(state.cost)
        if len(costs) > FEW_STEPS and iteration % 3 == 0:
            state = _leapt(problem, state, path, taken.std)
        path = (*path[-1:], state.phi)
        still = iteration > 2 * PATIENCE and min(costs[:-PATIENCE]) - min(costs) < LEAST_WIN
        if small or still or damping > LARGEST_DAMPING:
            return _finished(problem, state, iteration)
    raise UnsettledError(
        f"the fit did not settle in {MOST_ITERATIONS} steps; the flights hardly determine it: "
        "remove a term, or fly more motion",
        reached=dict(zip(problem.map.names, state.phi.tolist(), strict=True)),
    )


def _leapt(
    problem: BandedProblem,
    state: _State,
    path: Sequence[Float[np.ndarray, " f"]],
    std: Float[np.ndarray, " f"],
) -> _State:
    """Return the point to which crawling steps lead, where it is likelier."""
    phi = extrapolated((*path, state.phi), std)
    trial = None if phi is None else _evaluate_or_none(problem, phi)
    return state if trial is None or trial.cost >= state.cost else trial


def error_power(
    problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> tuple[Float[np.ndarray, "b k"], Float[np.ndarray, "b k"]]:
    """Return the sums of squares of each noisy signal, and of its error at `phi`, per block."""
    return _signal_power(problem), _power(_evaluate(problem, phi).residual)


def _signal_power(problem: BandedProblem) -> Float[np.ndarray, "b k"]:
    noisy = list(problem.noisy)
    return np.concatenate([_power(factors.R[:, :, noisy]) for factors in problem.factors])


def _power(rows: Float[np.ndarray, "b m k"]) -> Float[np.ndarray, "b k"]:
    """Return the sum of squares of every column of each block."""
    return np.einsum("bmk,bmk->bk", rows, rows)


def log_likelihood(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    """Return the log-likelihood at `phi`, minus infinity where the equations have no solution."""
    state = _evaluate_or_none(problem, phi)
    return -np.inf if state is None else -0.5 * state.cost


def _evaluate_or_none(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> _State | None:
    try:
        return _evaluate(problem, phi)
    except EstimationError:
        return None


def _evaluate(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> _State:
    """Return residuals, variances and cost at `phi`."""
    theta = problem.map.theta(phi)
    residuals: list[Float[np.ndarray, "b m k"]] = []
    variances: list[Float[np.ndarray, "b k"]] = []
    cost = _prior_cost(problem, phi)
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        G, _ = solved(tensor, theta[c], problem.noisy)
        e = factors.moved(problem.moves(phi)) @ G.T
        power = _power(e)
        v, floored = _variance(power, factors, problem.noisy)
        counted = problem.counted[c] if problem.counted else np.ones_like(v, dtype=bool)
        cost += float(np.sum(factors.rows[:, None] * np.log(v), where=counted))
        # At its floor a variance is no longer that of the errors: they have a cost of their own,
        # or the likelihood of exact flights would be flat.
        spare = np.minimum(power / v - factors.rows[:, None], 0.0)
        cost += float(np.sum(spare, where=counted & floored))
        v = np.where(counted, v, np.inf)
        residuals.append(e)
        variances.append(v)
    cost -= 2.0 * _feedback_gain(problem, phi)
    if not np.isfinite(cost):
        raise EstimationError("the likelihood is not finite here")
    return _State(
        phi=phi,
        residual=np.concatenate(residuals),
        variance=np.concatenate(variances),
        cost=cost,
    )


def _feedback_gain(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    """Return what the answers of a controller add to the log-likelihood."""
    if problem.feedback is None:
        return 0.0
    theta, moves = problem.map.theta(phi), problem.moves(phi)
    gain = 0.0
    for c, (tensor, own) in enumerate(zip(problem.tensors, theta, strict=True)):
        G, _ = solved(tensor, own, problem.noisy)
        gain += problem.feedback.gain(c, G)
        gain += float(problem.feedback.answers[c].drift.sum(axis=(0, 1)) @ moves)
    return gain


def _feedback_scores(
    problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "b f"]:
    """Return the derivative of the same by the free parameters, block by block."""
    if problem.feedback is None:
        return np.zeros((sum(len(factors) for factors in problem.factors), len(phi)))
    parts: list[Float[np.ndarray, "b f"]] = []
    theta, dtheta = problem.map.theta(phi), problem.map.jacobian(phi)
    places = [problem.map.names.index(name) for name in problem.moving]
    for c, tensor in enumerate(problem.tensors):
        G, dG = solved_jacobian(tensor, theta[c], dtheta[c], problem.noisy)
        own = problem.feedback.slope(c, G, dG).sum(axis=1)
        own[:, places] += problem.feedback.answers[c].drift.sum(axis=1)
        parts.append(own)
    return np.concatenate(parts)


def _variance(
    power: Float[np.ndarray, "b k"], factors: Factors, noisy: Sequence[int]
) -> tuple[Float[np.ndarray, "b k"], Bool[np.ndarray, "b k"]]:
    """Return each block's mean square error per noisy signal, and where it is at its floor.

    Blocks of few rows borrow from their neighbours.
    """
    signal = np.einsum("bmk,bmk->k", factors.R[:, :, list(noisy)], factors.R[:, :, list(noisy)])
    floor = RELATIVE_FLOOR * signal / factors.rows.sum() + np.finfo(float).tiny
    own = borrowed_mean_square(power, factors)
    return np.maximum(own, floor), own < floor


def _prior_cost(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    mean, std = _prior(problem)
    known = np.isfinite(std)
    return float(np.sum(((phi - mean)[known] / std[known]) ** 2))


def _prior(
    problem: BandedProblem,
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, " f"]]:
    names = problem.map.names
    mean = np.array([problem.prior_mean.get(name, 0.0) for name in names])
    std = np.array([problem.prior_std.get(name, np.inf) for name in names])
    return mean, std


def _linearised(
    problem: BandedProblem, state: _State
) -> tuple[Float[np.ndarray, "n f"], Float[np.ndarray, " n"]]:
    """Return the weighted equations A step = b, the prior's below them."""
    J = _jacobian(problem, state.phi)
    weight = 1.0 / np.sqrt(state.variance)
    f = J.shape[-1]
    mean, std = _prior(problem)
    J *= weight[:, None, :, None]
    A = np.concatenate([J.reshape(-1, f), np.diag(1.0 / std)])
    del J
    b = np.concatenate(
        [-(state.residual * weight[:, None, :]).reshape(-1), (mean - state.phi) / std]
    )
    return A, b


def _jacobian(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, "b m k f"]:
    """Return d e / d phi: d (M^-1 B) = M^-1 (dB - dM M^-1 B)."""
    theta, dtheta = problem.map.theta(phi), problem.map.jacobian(phi)
    noisy = list(problem.noisy)
    parts: list[Float[np.ndarray, "b m k f"]] = []
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        G, dG = solved_jacobian(tensor, theta[c], dtheta[c], noisy)
        rows = factors.moved(problem.moves(phi))
        flat = rows @ dG.transpose(2, 1, 0).reshape(dG.shape[2], -1)
        J = flat.reshape(len(factors), rows.shape[1], len(noisy), len(phi))
        for t, name in enumerate(problem.moving):
            assert factors.slopes is not None
            J[..., problem.map.names.index(name)] = factors.slopes[:, t] @ G.T
        parts.append(J)
    return np.concatenate(parts)


def _settled_with_noise(problem: BandedProblem, state: _State) -> tuple[_State, int]:
    """Return the point where the regressors' known noise no longer pulls, and after how many steps.

    Noise n of the regressors makes J^T e differ from zero at the truth by its own product
    n_b dG N G^T; the corrected score takes that off (errors in variables with known N). The
    likelihood itself, with a variance free in every block, would rather have no response at all
    than a noisy one: calm flights beside a lively one would win. So every step must lower the
    squares over the variances of the last point, without the regressors' share.
    """
    for iteration in range(1, MOST_ITERATIONS + 1):
        taken, scores, plain = _corrected_equations(problem, state)
        step = _corrected_step(plain, taken, scores.sum(axis=0))
        if float(np.max(np.abs(step) * np.sqrt(np.diagonal(plain)))) <= SMALLEST_STEP:
            return state, iteration
        before = _squares(problem, state, state.variance)
        for fraction in STEP_FRACTIONS:
            trial = _evaluate_or_none(problem, state.phi + fraction * step)
            if trial is not None and _squares(problem, trial, state.variance) < before:
                state = trial
                break
        else:
            return state, iteration  # no step lowers them: this is the bottom
    return state, MOST_ITERATIONS


def _known_share(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, "b k"]:
    """Return what the regressors' known noise adds to the variance of every block's errors."""
    theta = problem.map.theta(phi)
    parts: list[Float[np.ndarray, "b k"]] = []
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        G, _ = solved(tensor, theta[c], problem.noisy)
        parts.append(factors.known_noise @ (G * G).T)
    return np.concatenate(parts)


def _squares(problem: BandedProblem, state: _State, variance: Float[np.ndarray, "b k"]) -> float:
    """Return the squared errors over given variances, without what known noise adds to them.

    Half its slope is the corrected score, in every block, so that a step along that lowers it.
    """
    rows = np.concatenate([factors.rows for factors in problem.factors])
    own = _power(state.residual) - rows[:, None] * _known_share(problem, state.phi)
    gain = _feedback_gain(problem, state.phi)
    return float((own / variance).sum()) + _prior_cost(problem, state.phi) - 2.0 * gain


def _corrected_step(
    plain: Float[np.ndarray, "f f"], taken: Float[np.ndarray, "f f"], score: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " f"]:
    """Return (plain - taken)^-1 score, at rest where the information is mostly noise."""
    scale = 1.0 / np.sqrt(np.diagonal(plain))
    strength, Q = np.linalg.eigh(plain * np.outer(scale, scale))
    strength = np.maximum(strength, np.finfo(float).eps * strength[-1])
    root = scale[:, None] * Q / np.sqrt(strength)
    share, V = np.linalg.eigh(root.T @ taken @ root)
    gain = np.where(share < MOST_NOISE, 1.0 / (1.0 - np.minimum(share, MOST_NOISE)), 0.0)
    return root @ (V @ (gain * (V.T @ (root.T @ score))))


def _corrected_equations(
    problem: BandedProblem, state: _State
) -> tuple[Float[np.ndarray, "f f"], Float[np.ndarray, "b f"], Float[np.ndarray, "f f"]]:
    """Return the information that is only noise, each block's corrected score, and all of it."""
    J = _jacobian(problem, state.phi)
    weight = 1.0 / state.variance
    f = J.shape[-1]
    plain, scores = np.zeros((f, f)), np.empty((len(J), f))
    for first in range(0, len(J), BLOCKS_AT_ONCE):
        some = slice(first, first + BLOCKS_AT_ONCE)
        part, w = J[some], weight[some]
        plain += np.einsum("bmkf,bk,bmkg->fg", part, w, part, optimize=True)
        scores[some] = -np.einsum("bmkf,bk,bmk->bf", part, w, state.residual[some], optimize=True)
    del J
    scores += _feedback_scores(problem, state.phi)
    mean, std = _prior(problem)
    plain += np.diag(std**-2.0)
    taken = np.zeros_like(plain)
    theta, dtheta = problem.map.theta(state.phi), problem.map.jacobian(state.phi)
    first = 0
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        rows = slice(first, first + len(factors))
        first += len(factors)
        G, dG = solved_jacobian(tensor, theta[c], dtheta[c], problem.noisy)
        N = factors.rows[:, None] * factors.known_noise
        w = weight[rows]
        scores[rows] += np.einsum("bk,fkz,bz,kz->bf", w, dG, N, G, optimize=True)
        taken += np.einsum("bk,fkz,bz,gkz->fg", w, dG, N, dG, optimize=True)
    pull = (mean - state.phi) * std**-2.0
    return taken, np.concatenate([scores, pull[None]]), plain


def _finished(problem: BandedProblem, state: _State, iterations: int) -> BandedEstimate:
    """Return the estimate at the minimum, with covariance and influences."""
    # The rows of a long flight are many: of them R is kept, with the same singular values.
    rows = np.asarray(np.linalg.qr(_linearised(problem, state)[0], mode="r"))
    svd = scaled_singular(rows, problem.map.names)
    taken, scores, _ = _corrected_equations(problem, state)
    # From the rows, not from their squares: what only a prior determines would drown beside
    # what exact flights do.
    root = svd.inverse_root
    share, V = np.linalg.eigh(root.T @ taken @ root)
    widening = np.where(share < MOST_NOISE, 1.0 / (1.0 - np.minimum(share, MOST_NOISE)), UNKNOWN)
    kept = (V * widening) @ V.T
    inverse = root @ kept @ root.T
    covariance = root @ (kept @ kept.T) @ root.T
    return BandedEstimate(
        estimate=Estimate(
            names=problem.map.names,
            values=state.phi,
            covariance=covariance,
            condition_number=svd.condition_number,
            weak_directions=svd.Vt[::-1][:3],
            weak_strengths=(svd.s[::-1] / svd.s[0])[:3],
        ),
        influence=scores[:-1] @ inverse,
        variance=state.variance,
        signal_power=_signal_power(problem),
        residual_power=_power(state.residual),
        log_likelihood=-0.5 * state.cost,
        iterations=iterations,
        problem=problem,
        residual=state.residual,
    )


def normal_equations(fit: BandedEstimate, blocks: Bool[np.ndarray, " b"]) -> NormalEquations:
    """Return the equations of the chosen blocks, with the variances of the whole fit."""
    # Infinite variance is no weight: the block stays in its place and says nothing.
    state = _State(
        phi=fit.estimate.values,
        residual=fit.residual,
        variance=np.where(blocks[:, None], fit.variance, np.inf),
        cost=0.0,
    )
    taken, scores, plain = _corrected_equations(fit.problem, state)
    scores[:-1][~blocks] = 0.0
    return NormalEquations(information=plain - taken, scores=scores)


def answer_shifts(fit: BandedEstimate) -> Float[np.ndarray, "e f"]:
    """Return how far the estimate hangs on what is assumed of the controller, error by error.

    The step of the parameters that its answer to each error alone asks for: by so much an estimate
    is off where the controller does not answer that error, or twice as much as assumed.
    """
    problem, phi = fit.problem, fit.estimate.values
    if problem.feedback is None:
        return np.zeros((0, len(phi)))
    theta, dtheta = problem.map.theta(phi), problem.map.jacobian(phi)
    scores = np.zeros((len(problem.feedback.errors), len(phi)))
    places = [problem.map.names.index(name) for name in problem.moving]
    doubtful = problem.feedback.doubtful()
    for c, tensor in enumerate(problem.tensors):
        G, dG = solved_jacobian(tensor, theta[c], dtheta[c], problem.noisy)
        scores += doubtful.slope(c, G, dG).sum(axis=0)
        scores[:, places] += doubtful.answers[c].drift.sum(axis=0)
    return scores @ fit.estimate.covariance
