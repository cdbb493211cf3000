"""A parameter that moves the signals of one part in some of its equations: its likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from test_feedback import complex_normal, slope_of, two_axes

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import log_likelihood
from rotorfit.estimation.banded_equations import corrected_equations, evaluated
from rotorfit.estimation.banded_problem import LateErrors
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.estimation.parameter_map import parameter_map

NAMES = ("m", "a", "b", "c")
OWN = ("other", "one")
"""Of the second part and of the first: their order among the names is not that of the parts."""


def two_parts(seed, *, share=0.0):
    """Two axes over two parts of two blocks each, of which each has a late equation of its own."""
    problem, rng = two_axes(seed), np.random.default_rng(seed + 100)
    free = {name: {(t, name): 1.0 for t in range(2)} for name in ("a", "b", "c")}
    times = {name: {} for name in ("late", "slow", *OWN)}
    given = {(t, "m"): 1.0 for t in range(2)}
    answers = [
        ClosedLoopResponses(
            rows=rng.integers(0, 30, size=(2, 2)),
            moves=complex_normal(rng, 2, 2, 2),
            complementary_sensitivity=complex_normal(rng, 2, 2),
            uncertainty=complex_normal(rng, 2, 2),
            log_effect_slopes=complex_normal(rng, 2, 2, 3),
        )
        for _ in range(2)
    ]
    return replace(
        problem,
        map=parameter_map(NAMES, {**free, **times}, given, configurations=2),
        parts=((2, 2),),
        feedback=Feedback(errors=(0, 1), inputs=(2, 3), responses=tuple(answers)),
        late=(
            LateErrors(name="one", part=0, errors=(1,), slope=1),
            LateErrors(name="other", part=1, errors=(0,), slope=0),
        ),
        error_correlation=(np.array([[0.0, 0.0], [share, 0.0]]),),
        prior_std={"slow": 0.5, "one": 0.2},
    )


def plain_cost(problem, phi):
    """Sum minus twice the log-likelihood block by block and equation by equation."""
    (factors,), (tensor,) = problem.factors, problem.tensors
    at = dict(zip(problem.map.names, phi.tolist(), strict=True))
    cost = 0.0
    for b, rows in enumerate(factors.rows):
        part = b // 2
        theta = problem.map.constant[part] + problem.map.matrix[part] @ phi
        B = np.tensordot(theta, tensor, axes=1)
        G = np.linalg.solve(B[:, list(problem.noisy)], B)
        own = problem.feedback.responses[part]
        late = at["one"] if part == 0 else at["other"]
        times = np.array([at["slow"], at["late"], late])
        for j in range(2):
            moves = [at["slow"], at["late"]]
            if part == 0 and j == 1:
                moves[1] += late
            elif part == 1 and j == 0:
                moves[0] += late
            Z = np.zeros((factors.slopes.shape[2], G.shape[1]))
            Z[: len(factors.R[b])] = factors.R[b]
            Z += np.tensordot(moves, factors.slopes[b], axes=1)
            cost += rows * np.log(float(np.sum((Z @ G[j]) ** 2)) / rows)
            effect = own.moves[b % 2, j] @ G[j, list(problem.feedback.inputs)]
            effect = effect if effect.real >= 0 else -effect
            T = own.complementary_sensitivity[b % 2, j]
            gain = np.log(effect) + own.log_effect_slopes[b % 2, j] @ times
            cost -= 2.0 * own.rows[b % 2, j] * (T * gain).real
    for name, std in problem.prior_std.items():
        cost += ((at[name] - problem.prior_mean.get(name, 0.0)) / std) ** 2
    return cost


@pytest.mark.parametrize("seed", range(10))
def test_only_the_late_equations_of_their_part_are_moved(seed):
    problem = two_parts(seed)
    phi = 0.3 * np.random.default_rng(seed).normal(size=len(problem.map.names))
    assert evaluated(problem, phi).cost == pytest.approx(plain_cost(problem, phi), rel=1e-10)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("share", [0.0, -1.5])
def test_scores_with_late_equations_are_the_likelihoods_slope(seed, share):
    problem = two_parts(seed, share=share)
    phi = 0.1 * np.random.default_rng(seed + 1).normal(size=len(problem.map.names))
    score = corrected_equations(problem, evaluated(problem, phi)).score
    slope = slope_of(lambda at: log_likelihood(problem, at), phi)
    np.testing.assert_allclose(score, slope, rtol=1e-4, atol=1e-4 * np.abs(score).max())


@pytest.mark.parametrize("value", [np.nan, 1e200])
def test_where_a_fit_runs_off_its_error_says_what_to_do(value):
    problem = two_parts(1)
    with np.errstate(all="ignore"), pytest.raises(EstimationError, match="rotorfit inspect"):
        evaluated(problem, np.full(len(problem.map.names), value))


def test_a_part_is_moved_by_its_own_parameters_alone():
    one, other = two_parts(1).every_part
    names = two_parts(1).map.names
    assert [names[k] for k in one.moving] == ["slow", "late", "one"]
    assert [names[k] for k in other.moving] == ["slow", "late", "other"]
    assert {names[k] for k in one.moved} & set(OWN) == {"one"}
