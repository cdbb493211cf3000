r"""The default estimator: errors-in-variables likelihood per frequency band.

The equations are B(theta) z = 0 with B linear in theta. Of the signals z some are noisy (for a
flight: the six accelerations); M(theta) is B restricted to them. Solved for the noisy signals, the
residual of a row is their own error,

.. math:: e = M(\theta)^{-1} B(\theta) z,

which unlike B z cannot be made small by shrinking theta. Its variance in every block (stretch of
flight and frequency band) is estimated from the residuals themselves, and theta minimises
:math:`\sum_b n_b \sum_k \log v_{bk}(\theta)`, the likelihood with those variances put in. Since
:math:`|N^{-1/2} e| = |(M N M^T)^{-1/2} B z|`, this is structured errors in variables with the noise
of every band unknown. `docs/theory.md`, "The likelihood term by term", has all of it.

How the estimate moves without a part of the blocks is one Gauss-Newton step, no second fit. Two
estimates that share data do not scatter independently: the variance of their difference is taken
from the blocks' influences (one-step jackknife), and is at least the difference of the covariances
(Hausman, Econometrica 46(6), 1978), which is what the formal noise alone makes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded_equations import (
    Evaluated,
    State,
    corrected_equations,
    evaluated_or_none,
    feedback_scores,
    part_information,
    root_of,
    selected,
)
from rotorfit.estimation.banded_problem import BandedProblem as BandedProblem
from rotorfit.estimation.banded_problem import power_of, signal_power, solutions
from rotorfit.estimation.damped_steps import damped_step, reduced_damping
from rotorfit.estimation.estimate import Estimate, scaled_singular
from rotorfit.estimation.factors import borrowed_rows
from rotorfit.estimation.leaps import MOST_NOISE, Leaps, corrected_root
from rotorfit.estimation.reweighted import scatter_covariance
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

MOST_ITERATIONS = 400
SMALLEST_STEP = 5e-3
"""Convergence tolerance, in standard deviations of a parameter."""
LEAST_WIN = 0.02
"""Least gain of the cost, twice the log-likelihood, in `PATIENCE` steps: where they win less, the
iteration is at the bottom or goes round it; a parameter is known to a tenth of its deviation."""
PATIENCE = 8
NOISE_PATIENCE = 30
"""The same of steps with noise among the regressors: along a direction that the flights hardly show
they stay of one length for some forty, and end a deviation further."""
SHORTER = 0.7
"""Share to which such steps at least shorten the shortest one where the iteration settles."""
MOST_LOSS = 1.0
"""Largest rise of the cost by a leap, that of one deviation of one parameter: variances borrowed
from neighbours let the cost rise a little towards the end of an iteration, and no more."""
LARGEST_DAMPING = 1e9
"""Where the iteration ends, too: a step along the slope of which next to nothing is left."""
STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 1e-3)
UNKNOWN = 10.0
"""Factor on the deviation of such a direction."""


@frozen_dataclass
class BandedEstimate:
    """An estimate, and the influence of each block on it.

    - `estimate`: free parameters with the covariance of the fit.
    - `influence`: first-order change of each parameter if a block were counted twice; blocks of all
      configurations, one after the other.
    - `variance`: of each noisy signal's error in each block, infinite if it does not count.
    - `signal_power`, `residual_power`: sums of squares of noisy signals and their errors, by block.
    - `log_likelihood`: up to a constant; for comparing models and delays on the same flights.
    - `iterations`: until the steps were small.
    - `problem`: what was solved: for looking at parts of it afterwards.
    - `residual`: error of the noisy signals in the rows of each block's factor.
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


@frozen_dataclass
class NormalEquations:
    """The linearised equations of some blocks of an estimate, at the estimate.

    - `information`: of the free parameters, the prior's included.
    - `scores`: what each block asks for, zeros for blocks left out; last what the prior asks for.
    """

    information: Float[np.ndarray, "f f"]
    scores: Float[np.ndarray, "c f"]

    @property
    def step(self) -> Float[np.ndarray, " f"]:
        """The step of these blocks alone, zero in directions that are not known."""
        return pseudo_inverse(self.information) @ self.scores.sum(axis=0)


def banded(
    problem: BandedProblem, start: Float[np.ndarray, " f"], *, close: float = SMALLEST_STEP
) -> BandedEstimate:
    """Maximise the likelihood by Levenberg-Marquardt steps; `close` ends it, in deviations.

    Raises `UnsettledError` where it does not end, or cannot begin. The damping follows Nielsen,
    Damping parameter in Marquardt's method, IMM-REP-1999-05, Technical University of Denmark, 1999.
    """
    state = evaluated_or_none(problem, start)
    if state is None:
        raise UnsettledError(
            "the equations have no solution where the fit begins; the flights hardly determine "
            "it: fly more motion",
            reached=dict(zip(problem.map.names, start.tolist(), strict=True)),
        )
    if any(factors.noise is not None for factors in problem.factors):
        return _complete_estimate(problem, *_settled_with_noise(problem, state, close))
    damping, rise, costs = 1e-3, 2.0, [state.cost]
    leaps = Leaps()
    for iteration in range(1, MOST_ITERATIONS + 1):
        equations = corrected_equations(problem, state)
        damped = damped_step(equations.information, equations.score, damping)
        size = float(np.abs(damped.step / damped.std).max())
        leap = leaps.from_state(state, equations, damped.root)
        trial = None if leap is None else _likely_or_none(problem, state, leap)
        if trial is not None:
            state = trial
        else:
            trial = evaluated_or_none(problem, state.phi + damped.step)
            # With the variances of the last point: where these squares fall, the likelihood rises,
            # for log x <= x - 1; and blocks that borrow their variance cannot hold up the last
            # steps.
            before = state.over(state.variance)
            won = -np.inf if trial is None else before - trial.over(state.variance)
            if trial is not None and won >= 0.0:
                state, rise = trial, 2.0
                damping = reduced_damping(damping, won, damped.predicted_gain)
            else:
                damping, rise = damping * rise, rise * 2.0
        costs.append(state.cost)
        stalled = iteration > 2 * PATIENCE and min(costs[:-PATIENCE]) - min(costs) < LEAST_WIN
        if size <= close or stalled or damping > LARGEST_DAMPING:
            return _complete_estimate(problem, state, iteration)
    raise UnsettledError(
        f"the fit did not settle in {MOST_ITERATIONS} steps; the flights hardly determine it: "
        "remove a term, or fly more motion",
        reached=dict(zip(problem.map.names, state.phi.tolist(), strict=True)),
    )


def _likely_or_none(
    problem: BandedProblem, state: Evaluated, leap: Float[np.ndarray, " f"]
) -> Evaluated | None:
    """Evaluate where a leap leads; None where nothing is solved, or too much likelihood lost."""
    trial = evaluated_or_none(problem, state.phi + leap)
    return None if trial is None or trial.cost > state.cost + MOST_LOSS else trial


def log_likelihood(problem: BandedProblem, phi: Float[np.ndarray, " f"]) -> float:
    """Evaluate the log-likelihood at `phi`, minus infinity where nothing solves the equations."""
    state = evaluated_or_none(problem, phi)
    return -np.inf if state is None else -0.5 * state.cost


def _settled_with_noise(
    problem: BandedProblem, state: Evaluated, close: float
) -> tuple[Evaluated, int]:
    """Iterate to where the regressors' known noise adds no bias; count the steps."""
    sizes: list[float] = []
    leaps = Leaps()
    for iteration in range(1, MOST_ITERATIONS + 1):
        # Noise n of the regressors makes J^T e differ from zero at the truth by its own product n_b
        # dG N G^T; the corrected score takes that off (errors in variables with known N).
        equations = corrected_equations(problem, state)
        root = corrected_root(equations)
        step: Float[np.ndarray, " f"] = root @ (root.T @ equations.score)
        sizes.append(float(np.max(np.abs(step) * np.sqrt(np.diagonal(equations.information)))))
        if sizes[-1] <= close or _goes_round(sizes):
            return state, iteration
        leap = leaps.from_state(state, equations, root)
        trial = None if leap is None else evaluated_or_none(problem, state.phi + leap)
        if trial is not None and _is_no_worse(trial, state):
            state = trial
            continue
        # The likelihood itself, with a variance free in every block, would rather have no response
        # at all than a noisy one: calm flights beside a lively one would win. So every step must
        # lower the squares over the variances of the last point, without the regressors' share.
        before = state.over(state.variance)
        for fraction in STEP_FRACTIONS:
            trial = evaluated_or_none(problem, state.phi + fraction * step)
            if trial is not None and trial.over(state.variance) < before:
                state = trial
                break
        else:
            return state, iteration  # no step lowers them: this is the bottom
    return state, MOST_ITERATIONS


def _is_no_worse(trial: Evaluated, state: Evaluated) -> bool:
    """Return whether a leap loses next to nothing of the likelihood or the corrected squares."""
    # With noise among the regressors the end of the iteration is the maximum of neither.
    squares = trial.over(state.variance) - state.over(state.variance)
    return min(trial.cost - state.cost, squares) <= MOST_LOSS


def _goes_round(sizes: Sequence[float]) -> bool:
    """Return whether the steps have become no shorter for long: where hardly anything moves."""
    if len(sizes) <= 2 * NOISE_PATIENCE:
        return False
    return min(sizes[-NOISE_PATIENCE:]) > SHORTER * min(sizes[:-NOISE_PATIENCE])


def _complete_estimate(problem: BandedProblem, state: Evaluated, iterations: int) -> BandedEstimate:
    """Complete the estimate at the minimum by covariance and influences."""
    equations = corrected_equations(problem, state)
    svd = scaled_singular(root_of(problem, state, equations.information), problem.map.names)
    root = svd.inverse_root
    share, V = np.linalg.eigh(root.T @ equations.noise_information @ root)
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
        ),
        influence=equations.scores @ inverse,
        variance=state.variance,
        signal_power=signal_power(problem),
        residual_power=power_of(state.residual),
        log_likelihood=-0.5 * state.cost,
        iterations=iterations,
        problem=problem,
        residual=state.residual,
    )


def normal_equations(fit: BandedEstimate, blocks: Bool[np.ndarray, " b"]) -> NormalEquations:
    """Linearise the chosen blocks, with the variances of the whole fit."""
    equations = corrected_equations(*selected(fit.problem, _state_of(fit), blocks))
    scores = np.zeros((len(blocks) + 1, len(equations.prior_score)))
    scores[:-1][blocks] = equations.scores
    scores[-1] = equations.prior_score
    return NormalEquations(
        information=equations.information - equations.noise_information, scores=scores
    )


def _state_of(fit: BandedEstimate) -> State:
    return State(
        phi=fit.estimate.values,
        residual=fit.residual,
        variance=fit.variance,
    )


def part_equations(
    fit: BandedEstimate, parts: Sequence[Bool[np.ndarray, " b"]]
) -> tuple[Float[np.ndarray, "p f f"], Float[np.ndarray, "p f"], Float[np.ndarray, " f"]]:
    """Compute each part's information and score, without the prior, and the prior's score."""
    equations = corrected_equations(fit.problem, _state_of(fit))
    scores = np.array([equations.scores[part].sum(axis=0) for part in parts])
    return information_of_parts(fit, parts), scores, equations.prior_score


def information_of_parts(
    fit: BandedEstimate, parts: Sequence[Bool[np.ndarray, " b"]]
) -> Float[np.ndarray, "p f f"]:
    """Compute the information of each part of the blocks, without the prior's."""
    return part_information(fit.problem, _state_of(fit), parts)


def steps_without(
    fit: BandedEstimate, parts: Sequence[Bool[np.ndarray, " b"]]
) -> Float[np.ndarray, "p f"]:
    """Compute the parameters' first-order step without each part of the blocks."""
    information, scores, prior_score = part_equations(fit, parts)
    prior = np.diag(fit.problem.prior[1] ** -2.0)
    rest = zip(_sums_of_others(information), _sums_of_others(scores), strict=True)
    return np.array(
        [
            NormalEquations(information=H + prior, scores=np.array([s, prior_score])).step
            for H, s in rest
        ]
    )


def _sums_of_others(parts: Float[np.ndarray, "p ..."]) -> Float[np.ndarray, "p ..."]:
    """Sum all other parts for each part, without subtracting."""
    nothing = np.zeros_like(parts[:1])
    before = np.concatenate([nothing, np.cumsum(parts, axis=0)[:-1]])
    behind = np.concatenate([np.cumsum(parts[::-1], axis=0)[:-1][::-1], nothing])
    return before + behind


def parameter_scale(information: Float[np.ndarray, "f f"]) -> Float[np.ndarray, " f"]:
    """Take the root of each parameter's own information, to scale a matrix to order one."""
    # Less than nothing may be left of a parameter that the flight does not move, after what the
    # noise of its signals makes up: that is as little.
    size = np.sqrt(np.abs(np.diagonal(information)))
    return np.where(size > 0.0, size, 1.0)


def pseudo_inverse(information: Float[np.ndarray, "f f"]) -> Float[np.ndarray, "f f"]:
    """Invert an information of parameters of any units; unknown directions become zero."""
    size = parameter_scale(information)
    scale = np.outer(size, size)
    return np.linalg.pinv(information / scale, hermitian=True) / scale


def covariance_with_noise_uncertainty(fit: BandedEstimate) -> Float[np.ndarray, "f f"]:
    r"""Add to the fit's covariance the uncertainty of the blocks' estimated variances.

    A variance from n rows is off by a share of sqrt(2 / n), so that blocks whose errors are small
    by chance count for too much, and claim too much: with the information J_k of block k,
    :math:`C + 2 C \big(\sum_k 2 J_k / n_k\big) C` (Meier, Biometrics 9, 1953; Kenward and Roger,
    Biometrics 53, 1997, where blocks with most of the information add less).
    """
    state = _state_of(fit)
    rows = np.concatenate([borrowed_rows(factors) for factors in fit.problem.factors])
    uncertain = replace(state, variance=state.variance * (rows / 2.0)[:, None])
    every = [np.ones(len(rows), dtype=bool)]
    added = part_information(fit.problem, uncertain, every, corrected=False)[0]
    covariance = fit.estimate.covariance
    # By a root, which keeps what hardly anything is known of from falling below zero by rounding.
    moved = covariance @ square_root(added)
    widened: Float[np.ndarray, "f f"] = covariance + 2.0 * moved @ moved.T
    return widened


def square_root(squares: Float[np.ndarray, "f f"]) -> Float[np.ndarray, "f f"]:
    """Factor an information or a covariance of parameters of any units into A A^T."""
    size = parameter_scale(squares)
    strength, V = np.linalg.eigh(squares / np.outer(size, size))
    root: Float[np.ndarray, "f f"] = size[:, None] * V * np.sqrt(np.maximum(strength, 0.0))
    return root


def response_sensitivity(fit: BandedEstimate) -> Float[np.ndarray, "e f"]:
    """Compute the parameters' step by the controller's uncertain response, error by error."""
    problem, phi = fit.problem, fit.estimate.values
    if problem.feedback is None:
        return np.zeros((0, len(phi)))
    # Where the controller does not respond to that error, or twice as much as assumed.
    uncertain = problem.feedback.uncertain_part()
    equations = feedback_scores(problem, uncertain, solutions(problem, phi)).sum(axis=0)
    return equations @ fit.estimate.covariance


UNDETERMINED = 1e-10
"""Eigenvalue of the unit-diagonal information under which a direction counts as lost."""


@frozen_dataclass
class Shift:
    """Shifts of numbers, and their covariance by chance.

    - `values`, `covariance`: of the shift.
    """

    values: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "q q"]

    @property
    def std(self) -> Float[np.ndarray, " q"]:
        """Standard deviation of each shift by chance alone."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))


def shift_without(fit: BandedEstimate, blocks: Bool[np.ndarray, " b"]) -> Shift:
    """Compute the shift of the free parameters when some blocks are left out, in one step."""
    whole = normal_equations(fit, np.ones_like(blocks))
    rest = normal_equations(fit, ~blocks)
    scale = parameter_scale(whole.information)
    inverse, inverse_rest = (
        _invert_information(whole.information, scale),
        _invert_information(rest.information, scale),
    )
    influence = (rest.scores @ inverse_rest - whole.scores @ inverse)[:-1]
    formal = inverse_rest - inverse
    return Shift(
        values=rest.scores.sum(axis=0) @ inverse_rest,
        covariance=raised_to(
            _scatter_of_influences(influence[blocks]) + _scatter_of_influences(influence[~blocks]),
            formal,
        ),
    )


def _scatter_of_influences(influence: Float[np.ndarray, "b f"]) -> Float[np.ndarray, "f f"]:
    """Estimate the covariance from the scatter within a group of blocks (jackknife)."""
    if len(influence) < 2:
        return influence.T @ influence
    # About their mean: the difference between the groups is the shift, not chance.
    return scatter_covariance(influence)


def _invert_information(
    H: Float[np.ndarray, "f f"], scale: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "f f"]:
    """Invert; directions that the equations lost become infinitely uncertain."""
    import scipy.linalg  # slow to import

    values, vectors = scipy.linalg.eigh(H / np.outer(scale, scale))
    values = np.maximum(values, UNDETERMINED)
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def raised_to(
    covariance: Float[np.ndarray, "q q"], floor: Float[np.ndarray, "q q"]
) -> Float[np.ndarray, "q q"]:
    """Scale a covariance up where its variances are under those of the floor."""
    variance = np.maximum(np.diagonal(covariance), np.finfo(float).tiny)
    factor = np.sqrt(np.maximum(np.diagonal(floor) / variance, 1.0))
    return covariance * np.outer(factor, factor)
