"""A controller that answers the errors: without its term the response comes out too small."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import (
    BandedProblem,
    banded,
    log_likelihood,
    normal_equations,
    response_sensitivity,
)
from rotorfit.estimation.banded_equations import (
    corrected_equations,
    evaluated,
    feedback_gain,
    feedback_scores,
)
from rotorfit.estimation.banded_problem import solutions, solved_each
from rotorfit.estimation.factors import Factors, time_block_factors, triangular_factors
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.estimation.parameter_map import parameter_map

ROWS = 4000
BLOCK = 200
SEEDS = 40


def complex_normal(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def two_axes(seed):
    """Two noisy equations in two inputs that two times move, nonlinear through M(theta).

    Both errors are answered, with any phase.
    """
    rng = np.random.default_rng(seed)
    tensor = rng.normal(size=(4, 2, 5))
    tensor[0, :, :2] += 3.0 * np.eye(2)
    moved = np.zeros((4, 2, 12, 5))
    moved[..., 2:4] = rng.normal(size=(4, 2, 12, 2))
    factors = Factors(
        R=triangular_factors(rng.normal(size=(4, 30, 5))),
        rows=np.full(4, 30),
        segment=np.array([0, 0, 1, 1]),
        band=np.tile([0.0, 1.0], (4, 1)),
        slopes=moved,
    )
    names = ("m", "a", "b", "c")
    free = {"p": {(0, "a"): 1.0}, "q": {(0, "b"): 1.0}, "r": {(0, "c"): 1.0}}
    answers = ClosedLoopResponses(
        rows=rng.integers(0, 30, size=(4, 2)),
        moves=complex_normal(rng, 4, 2, 2),
        complementary_sensitivity=complex_normal(rng, 4, 2),
        uncertainty=complex_normal(rng, 4, 2),
        log_effect_slopes=complex_normal(rng, 4, 2, 2),
    )
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(names, {**free, "late": {}, "slow": {}}, {(0, "m"): 1.0}),
        noisy=(0, 1),
        prior_mean={"slow": 0.3},
        prior_std={"slow": 0.5},
        feedback=Feedback(errors=(0, 1), inputs=(2, 3), responses=(answers,)),
        moving=("slow", "late"),
    )


def slope_of(function, phi):
    """Return the derivative of a function of the free parameters."""
    steps = 1e-6 * np.eye(len(phi))
    return np.array([(function(phi + s) - function(phi - s)) / 2e-6 for s in steps])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_scores_of_the_responses_are_the_derivative_of_the_gain(seed):
    """By what scales the inputs and by what moves them, in that order of the names."""
    problem = two_axes(seed)
    phi = 0.1 * np.random.default_rng(seed + 1).normal(size=5)
    without = replace(problem, feedback=None)
    found = solutions(problem, phi)
    score = feedback_scores(problem, problem.feedback, found).sum(axis=(0, 1))

    def gained(at):
        return feedback_gain(problem, at, solved_each(problem, at))

    slope = slope_of(gained, phi)
    np.testing.assert_allclose(score, slope, rtol=1e-4, atol=1e-4 * np.abs(score).max())
    gain = log_likelihood(problem, phi) - log_likelihood(without, phi)
    assert gain == pytest.approx(gained(phi), rel=1e-6)


def test_a_response_that_wins_without_end_is_no_solution():
    """Its gain is linear in what moves the inputs: over 10 for each of 120 rows is nowhere."""
    problem = two_axes(3)
    phi = 0.1 * np.ones(5)
    late = problem.map.names.index("late")

    def gained(at):
        return feedback_gain(problem, at, solved_each(problem, at))

    one = np.eye(5)[late]
    slope = gained(phi + one) - gained(phi)
    ends = [phi + (1200.0 * share - gained(phi)) / slope * one for share in (0.99, 1.01)]
    assert np.isfinite(log_likelihood(problem, ends[0]))
    assert log_likelihood(problem, ends[1]) == -np.inf
    with pytest.raises(UnsettledError, match="no solution where the fit begins") as raised:
        banded(problem, ends[1])
    assert raised.value.reached == dict(zip(problem.map.names, ends[1].tolist(), strict=True))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), share=st.sampled_from([0.0, 0.7, -2.0]))
def test_all_scores_sum_to_the_derivative_of_the_likelihood(seed, share):
    """Of moved signals, their answers, what is known beforehand, errors that come together."""
    problem = replace(two_axes(seed), error_correlation=(np.array([[0.0, 0.0], [share, 0.0]]),))
    phi = 0.1 * np.random.default_rng(seed + 1).normal(size=5)
    score = corrected_equations(problem, evaluated(problem, phi)).score
    slope = slope_of(lambda at: log_likelihood(problem, at), phi)
    np.testing.assert_allclose(score, slope, rtol=1e-4, atol=1e-4 * np.abs(score).max())


def test_what_is_in_doubt_stands_for_what_is_responded_to():
    problem = two_axes(7)
    (own,) = problem.feedback.uncertain_part().responses
    (was,) = problem.feedback.responses
    np.testing.assert_array_equal(own.complementary_sensitivity, was.uncertainty)
    np.testing.assert_array_equal(own.moves, was.moves)


def closed_loop(seed, *, gain, pilot=2.0):
    """An axis whose controller drives a share `gain` of its errors out, inputs 2 u per unit.

    y = 2 u + v and u = (w - gain v) / 2, w being what the pilot asks for.
    """
    rng = np.random.default_rng(seed)
    w, v = pilot * rng.normal(size=ROWS), rng.normal(size=ROWS)
    u = 0.5 * (w - gain * v)
    return np.column_stack([2.0 * u + v, u])


def answers_of(factors, share, *, doubt=1.0, late=None):
    """Return one error, answered by one input."""
    b = len(factors)

    def column(value):
        return np.broadcast_to(np.asarray(value, dtype=complex).reshape(-1, 1), (b, 1)).copy()

    return ClosedLoopResponses(
        rows=factors.rows[:, None].copy(),
        moves=np.ones((b, 1, 1), dtype=complex),
        complementary_sensitivity=column(share),
        uncertainty=column(doubt),
        log_effect_slopes=np.zeros((b, 1, 0), dtype=complex)
        if late is None
        else late[:, None, None],
    )


AXIS = np.zeros((2, 1, 2))
AXIS[0, 0, 0], AXIS[1, 0, 1] = 1.0, -1.0


def axis_problem(Z, *, answered, doubt=1.0):
    """m y = u: the inertia m of one axis, half in truth."""
    factors = time_block_factors(Z, block_rows=BLOCK)
    return BandedProblem(
        factors=(factors,),
        tensors=(AXIS,),
        map=parameter_map(("m", "u"), {"m": {(0, "m"): 1.0}}, {(0, "u"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
        feedback=Feedback(
            errors=(0,), inputs=(1,), responses=(answers_of(factors, answered, doubt=doubt),)
        ),
    )


START = np.array([0.4])


def fits(gain, answered, **more):
    return [
        banded(axis_problem(closed_loop(seed, gain=gain, **more), answered=answered), START)
        for seed in range(SEEDS)
    ]


def estimates(gain, answered):
    found = fits(gain, answered)
    values = np.array([fit.estimate.values[0] for fit in found])
    inside = [abs(f.estimate.values[0] - 0.5) < 1.96 * f.estimate.std[0] for f in found]
    return values.mean(), values.std() / np.sqrt(len(values)), np.mean(inside)


@pytest.mark.parametrize("gain", [0.5, 1.0])
def test_the_bias_of_a_controller_is_taken_out(gain):
    """rho is 4: without the term, the inertia is a fifth of itself too large or so."""
    mean, error, _ = estimates(gain, answered=0.0)
    assert mean - 0.5 > 15.0 * error
    mean, error, inside = estimates(gain, answered=gain)
    assert abs(mean - 0.5) < 3.0 * error
    assert inside > 0.85


def test_without_a_controller_the_term_would_bias_the_other_way():
    mean, error, _ = estimates(0.0, answered=0.0)
    assert abs(mean - 0.5) < 3.0 * error
    mean, error, _ = estimates(0.0, answered=1.0)
    assert 0.5 - mean > 20.0 * error


@pytest.mark.parametrize("gain", [0.6, 0.9])
@pytest.mark.parametrize("off", [-0.1, 0.1])
def test_a_wrong_share_moves_the_estimate_by_the_stated_shift(gain, off):
    """By a tenth of the shift of all, beside the truth of many flights: to first order in 1 / rho.

    rho is 16. At 4 the curvature of the term itself matters: with a gain of 0.9 an estimate moves
    by 1.18 shifts.
    """
    found = fits(gain, gain + off, pilot=4.0)
    shifts = np.array([response_sensitivity(fit)[0, 0] for fit in found])
    values = np.array([fit.estimate.values[0] for fit in found])
    mean, error = values.mean(), values.std() / np.sqrt(len(values))
    assert -0.032 < shifts.mean() < -0.028  # of an inertia of a half: 1 / rho of it
    assert abs(mean - off * shifts.mean() - 0.5) < 3.0 * error
    assert abs(mean - 0.5) > 4.0 * error


def test_the_shift_is_that_of_what_is_in_doubt():
    Z = closed_loop(2, gain=0.8)
    (whole,), (half,) = (
        response_sensitivity(banded(axis_problem(Z, answered=0.8, doubt=doubt), np.array([0.4])))
        for doubt in (1.0, -0.5)
    )
    assert half == pytest.approx(-0.5 * whole)
    open_loop = replace(axis_problem(Z, answered=0.8), feedback=None)
    assert response_sensitivity(banded(open_loop, np.array([0.4]))).shape == (0, 1)


TURNS = np.array([4.0, 8.0, 14.0, 20.0])
"""[rad/s]; a band for each, of that frequency alone."""
LINES = 300
LAGGING = 1.0 / (1.0 + 1j * TURNS / 25.0)
"""T of a controller with a bandwidth of 25 rad/s."""


def late_problem(seed, share, *, assumed, doubt=1.0):
    """m y = u(t - late), half and none in truth, by lines of the spectrum; u = (w - T v) / 2."""
    rng = np.random.default_rng(seed)
    shape = (len(TURNS), LINES)
    w, v = 2.0 * complex_normal(rng, *shape), complex_normal(rng, *shape)
    u = 0.5 * (w - share[:, None] * v)
    lines = np.stack([2.0 * u + v, u, -1j * TURNS[:, None] * u], axis=2)
    R = triangular_factors(np.concatenate([lines.real, lines.imag], axis=1))
    slopes = np.zeros((len(TURNS), 1, 3, 2))
    slopes[:, 0, :, 1] = R[:, :, 2]
    factors = Factors(
        R=R[:, :2, :2],
        rows=np.full(len(TURNS), 2 * LINES),
        segment=np.zeros(len(TURNS), dtype=np.int64),
        band=np.column_stack([TURNS, TURNS]) / (2.0 * np.pi),
        slopes=slopes,
    )
    answers = answers_of(factors, assumed, doubt=doubt, late=-1j * TURNS)
    return BandedProblem(
        factors=(factors,),
        tensors=(AXIS,),
        map=parameter_map(("m", "u"), {"m": {(0, "m"): 1.0}, "late": {}}, {(0, "u"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
        feedback=Feedback(errors=(0,), inputs=(1,), responses=(answers,)),
        moving=("late",),
    )


def late_estimates(share, *, assumed, doubt=1.0):
    """Return inertia and lateness of many flights, and how far each hangs on the doubt."""
    fits = [
        banded(late_problem(seed, share, assumed=assumed, doubt=doubt), np.array([0.45, 0.0]))
        for seed in range(SEEDS)
    ]
    values = np.array([fit.estimate.values for fit in fits])
    shifts = np.array([response_sensitivity(fit)[0] for fit in fits])
    inside = np.abs(values - TRUE) < 1.96 * np.array([fit.estimate.std for fit in fits])
    return values.mean(axis=0), values.std(axis=0) / np.sqrt(SEEDS), shifts.mean(axis=0), inside


TRUE = np.array([0.5, 0.0])


def test_a_lagging_controllers_bias_of_inertia_and_delay_goes():
    mean, error, _, _ = late_estimates(LAGGING, assumed=np.zeros(4))
    assert (mean - TRUE > 15.0 * error).all()
    mean, error, _, _ = late_estimates(LAGGING, assumed=np.abs(LAGGING))
    assert mean[1] - TRUE[1] > 15.0 * error[1]  # a share without its phase
    mean, error, _, inside = late_estimates(LAGGING, assumed=LAGGING)
    assert (np.abs(mean - TRUE) < 3.0 * error).all()
    assert (inside.mean(axis=0) > 0.85).all()


@pytest.mark.parametrize("off", [0.1 * LAGGING, -0.1 * LAGGING, 0.1j * np.ones(4)])
def test_a_wrong_response_moves_inertia_and_delay_as_stated(off):
    mean, error, shift, _ = late_estimates(LAGGING, assumed=LAGGING + off, doubt=off)
    assert (np.abs(mean - shift - TRUE) < 3.0 * error).all()
    assert (np.abs(shift) > 4.0 * error).any()


def test_inputs_without_effect_change_nothing():
    """Where an estimate may run away to, of flights in which nobody steers."""
    problem = axis_problem(closed_loop(1, gain=1.0), answered=1.0)
    (own,) = problem.feedback.responses
    none = replace(problem.feedback, responses=(replace(own, moves=0.0 * own.moves),))
    one, other = (banded(replace(problem, feedback=f), START).estimate for f in (none, None))
    np.testing.assert_allclose(one.values, other.values, atol=2e-3 * float(one.std[0]))


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
    assert np.isinf(evaluated(problem, start).variance[3:, 1]).all()
