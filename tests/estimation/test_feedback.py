"""A controller that answers the errors: without its term the response comes out too small."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.estimation.banded import (
    BandedProblem,
    _evaluate,
    _feedback_scores,
    banded,
    log_likelihood,
    normal_equations,
)
from rotorfit.estimation.factors import Factors, time_block_factors, triangular_factors
from rotorfit.estimation.feedback import Feedback
from rotorfit.estimation.parameter_map import parameter_map

ROWS = 4000
BLOCK = 200


def two_axes(seed, *, known_noise=False):
    """Two noisy equations in two inputs, nonlinear through M(theta), both answered."""
    rng = np.random.default_rng(seed)
    tensor = rng.normal(size=(4, 2, 5))
    tensor[0, :, :2] += 3.0 * np.eye(2)
    factors = Factors(
        R=triangular_factors(rng.normal(size=(4, 30, 5))),
        rows=np.full(4, 30),
        segment=np.array([0, 0, 1, 1]),
        band=np.tile([0.0, 1.0], (4, 1)),
        noise=np.tile([0.0, 0.0, 1e-3, 1e-3, 0.0], (4, 1)) if known_noise else None,
    )
    names = ("m", "a", "b", "c")
    free = {"p": {(0, "a"): 1.0}, "q": {(0, "b"): 1.0}, "r": {(0, "c"): 1.0}}
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(names, free, {(0, "m"): 1.0}),
        noisy=(0, 1),
        prior_mean={},
        prior_std={},
        feedback=Feedback(
            errors=(0, 1),
            inputs=(2, 3),
            mixer=rng.normal(size=(2, 2)),
            rows=(rng.uniform(0.0, 30.0, size=(4, 2)),),
        ),
    )


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_scores_are_the_derivative_of_the_likelihood(seed):
    problem = two_axes(seed)
    phi = 0.1 * np.random.default_rng(seed + 1).normal(size=3)
    without = replace(problem, feedback=None)
    score = _feedback_scores(problem, phi).sum(axis=0)
    for f in range(3):
        step = np.zeros(3)
        step[f] = 1e-6

        def gain(at):
            return log_likelihood(problem, at) - log_likelihood(without, at)

        slope = (gain(phi + step) - gain(phi - step)) / 2e-6
        assert score[f] == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.abs(score).max())


def closed_loop(seed, *, gain):
    """An axis whose controller drives a share `gain` of its errors out, inputs 2 u per unit.

    y = 2 u + v and u = (w - gain v) / 2, w being what the pilot asks for.
    """
    rng = np.random.default_rng(seed)
    w, v = 2.0 * rng.normal(size=ROWS), rng.normal(size=ROWS)
    u = 0.5 * (w - gain * v)
    return np.column_stack([2.0 * u + v, u])


def axis_problem(Z, *, answered):
    """m y = u: the inertia m of one axis, half in truth."""
    tensor = np.zeros((2, 1, 2))
    tensor[0, 0, 0] = 1.0
    tensor[1, 0, 1] = -1.0
    factors = time_block_factors(Z, block_rows=BLOCK)
    rows = (answered * factors.rows[:, None].astype(float),)
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("m", "u"), {"m": {(0, "m"): 1.0}}, {(0, "u"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
        feedback=Feedback(errors=(0,), inputs=(1,), mixer=np.ones((1, 1)), rows=rows),
    )


def estimates(gain, answered):
    fits = [
        banded(axis_problem(closed_loop(seed, gain=gain), answered=answered), np.array([0.4]))
        for seed in range(40)
    ]
    values = np.array([fit.estimate.values[0] for fit in fits])
    inside = [abs(f.estimate.values[0] - 0.5) < 1.96 * f.estimate.std[0] for f in fits]
    return values.mean(), values.std() / np.sqrt(len(values)), np.mean(inside)


def test_the_pull_of_a_controller_is_taken_out():
    """rho is 4: without the term, the inertia is a fifth of itself too large or so."""
    mean, error, _ = estimates(1.0, answered=0.0)
    assert mean - 0.5 > 20.0 * error
    mean, error, inside = estimates(1.0, answered=1.0)
    assert abs(mean - 0.5) < 3.0 * error
    assert inside > 0.85


def test_without_a_controller_the_term_would_pull_the_other_way():
    mean, error, _ = estimates(0.0, answered=0.0)
    assert abs(mean - 0.5) < 3.0 * error
    mean, error, _ = estimates(0.0, answered=1.0)
    assert 0.5 - mean > 20.0 * error


def test_known_noise_of_the_inputs_and_the_term_together():
    """The corrected score and the likelihood of the same problem settle at the same point."""
    Z = closed_loop(3, gain=1.0)
    plain = axis_problem(Z, answered=1.0)
    noise = np.zeros((len(plain.factors[0]), 2))
    silent = replace(plain, factors=(replace(plain.factors[0], noise=noise),))
    one, other = (banded(p, np.array([0.45])).estimate for p in (plain, silent))
    np.testing.assert_allclose(one.values, other.values, atol=2e-3 * float(one.std[0]))


def test_blocks_left_out_say_nothing():
    fit = banded(axis_problem(closed_loop(1, gain=1.0), answered=1.0), np.array([0.45]))
    kept = np.arange(len(fit.influence)) < 7
    scores = normal_equations(fit, kept).scores
    assert (scores[:-1][~kept] == 0.0).all()
    assert (scores[:-1][kept] != 0.0).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_errors_that_do_not_count_are_as_if_they_were_not_there(seed):
    """Of two axes without common parameters one is left out: the other is fitted alone."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(600, 2))
    y = x * [2.0, 3.0] + 0.1 * rng.normal(size=(600, 2))
    tensor = np.zeros((3, 2, 4))
    tensor[0] = np.eye(2, 4)
    tensor[1, 0, 2] = tensor[2, 1, 3] = -1.0
    factors = time_block_factors(np.column_stack([y, x]), block_rows=100)
    counted = np.ones((len(factors), 2), dtype=bool)
    counted[3:, 1] = False
    free = {"p": {(0, "p"): 1.0}, "q": {(0, "q"): 1.0}}
    problem = BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("y", "p", "q"), free, {(0, "y"): 1.0}),
        noisy=(0, 1),
        prior_mean={},
        prior_std={},
        counted=(counted,),
    )
    some = replace(problem, factors=(factors.select(np.arange(len(factors)) < 3),), counted=())
    whole = replace(problem, counted=())
    start = np.array([1.0, 1.0])
    found, part, all_ = (banded(p, start).estimate for p in (problem, some, whole))
    assert found.values[0] == pytest.approx(all_.values[0], abs=1e-3 * float(all_.std[0]))
    assert found.values[1] == pytest.approx(part.values[1], abs=1e-3 * float(part.std[1]))
    assert found.std[1] == pytest.approx(part.std[1], rel=1e-3)
    assert np.isinf(_evaluate(problem, start).variance[3:, 1]).all()
