"""A line through points with known noise in x: its closed solution, term by term."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.estimation.banded import (
    BandedProblem,
    banded,
    log_likelihood,
    normal_equations,
)
from rotorfit.estimation.banded_equations import (
    corrected_equations,
    evaluated,
    known_noise_variance,
)
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.estimation.leaps import Leaps
from rotorfit.estimation.parameter_map import parameter_map

ROWS, BLOCKS = 400, 5


def points(seed=0, *, noise=0.2, error=0.3):
    """y = 2 x + error, and x seen with noise; in blocks of 400."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(BLOCKS, ROWS))
    y = 2.0 * x + error * np.arange(1, BLOCKS + 1)[:, None] * rng.normal(size=x.shape)
    return y, x + noise * rng.normal(size=x.shape)


def slope_problem(y, x, *, noise=None, prior=None):
    """One equation y = slope x, y noisy; `noise` is the variance of x."""
    tensor = np.zeros((2, 1, 2))
    tensor[0, 0, 0] = 1.0
    tensor[1, 0, 1] = -1.0
    factors = Factors(
        R=triangular_factors(np.stack([y, x], axis=2)),
        rows=np.full(len(y), y.shape[1]),
        segment=np.arange(len(y)),
        band=np.tile([0.0, 1.0], (len(y), 1)),
        noise=None if noise is None else np.tile([0.0, noise], (len(y), 1)),
    )
    mean, std = prior or (0.0, None)
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("y", "slope"), {"slope": {(0, "slope"): 1.0}}, {(0, "y"): 1.0}),
        noisy=(0,),
        prior_mean={"slope": mean} if prior else {},
        prior_std={"slope": std} if prior else {},
    )


def sums(y, x, slope):
    """Return each block's x y, x x, and mean squared residual."""
    v = ((y - slope * x) ** 2).mean(axis=1)
    return (x * y).sum(axis=1), (x * x).sum(axis=1), v


def closed(y, x, slope, *, noise=0.0, weight=None, prior=None):
    """Return slope and information of consistent least squares at given variances of the blocks."""
    xy, xx, v = sums(y, x, slope)
    w = (1.0 if weight is None else weight) / v
    mean, std = prior or (0.0, np.inf)
    information = (w * (xx - y.shape[1] * noise)).sum() + std**-2.0
    return ((w * xy).sum() + mean * std**-2.0) / information, information


@pytest.mark.parametrize("noise", [None, 0.04])
@pytest.mark.parametrize("prior", [None, (2.05, 0.01)])
def test_the_slope_is_that_of_consistent_least_squares(noise, prior):
    """sum xy / v over sum (xx - n N) / v, a prior being one point more."""
    y, x = points()
    fit = banded(slope_problem(y, x, noise=noise, prior=prior), np.array([1.5]))
    slope = float(fit.estimate.values[0])
    expected, information = closed(y, x, slope, noise=noise or 0.0, prior=prior)
    assert slope == pytest.approx(expected, abs=2e-3 / information**0.5)
    every = normal_equations(fit, np.ones(BLOCKS, dtype=bool))
    np.testing.assert_allclose(every.information, [[information]], rtol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.04])
def test_the_deviation_is_that_of_consistent_least_squares(noise):
    """Variance sum xx / v over the square of sum (xx - n N) / v; 1 over it without noise."""
    y, x = points()
    fit = banded(slope_problem(y, x, noise=noise), np.array([1.5]))
    slope = float(fit.estimate.values[0])
    _, xx, v = sums(y, x, slope)
    _, information = closed(y, x, slope, noise=noise)
    np.testing.assert_allclose(fit.estimate.covariance, (xx / v).sum() / information**2, rtol=1e-6)


@pytest.mark.parametrize("noise", [None, 0.04])
@pytest.mark.parametrize("prior", [None, (2.05, 0.01)])
def test_an_influence_is_the_change_if_a_block_counted_twice(noise, prior):
    """As seen by solving again with one block at 1 + 1e-6 of its weight."""
    y, x = points()
    fit = banded(slope_problem(y, x, noise=noise, prior=prior), np.array([1.5]))
    slope = float(fit.estimate.values[0])
    more = {"noise": noise or 0.0, "prior": prior}
    base, information = closed(y, x, slope, **more)
    for block in range(BLOCKS):
        weight = np.ones(BLOCKS)
        weight[block] += 1e-6
        moved = (closed(y, x, slope, weight=weight, **more)[0] - base) / 1e-6
        expected = pytest.approx(moved, abs=5e-3 / information**0.5)
        if noise is None or prior is None:
            assert fit.influence[block, 0] == expected
        else:  # a prior is no noise: its information is no larger for it
            assert fit.influence[block, 0] == pytest.approx(moved, rel=0.2, abs=0.01)


def test_scores_of_blocks_and_prior_are_what_each_asks_for():
    y, x = points()
    fit = banded(slope_problem(y, x, noise=0.04, prior=(2.05, 0.01)), np.array([1.5]))
    slope = float(fit.estimate.values[0])
    xy, xx, v = sums(y, x, slope)
    scores = normal_equations(fit, np.ones(BLOCKS, dtype=bool)).scores[:, 0]
    np.testing.assert_allclose(scores[:-1], (xy - slope * (xx - ROWS * 0.04)) / v, rtol=1e-6)
    assert scores[-1] == pytest.approx((2.05 - slope) / 0.01**2, rel=1e-9)


def test_the_log_likelihood_is_that_of_the_normal_distribution():
    """-1/2 sum n log v, v being the mean square, and -1/2 ((slope - mean) / std)^2."""
    y, x = points()
    problem = slope_problem(y, x, prior=(2.3, 0.1))
    for slope in (1.0, 1.7):
        _, _, v = sums(y, x, slope)
        expected = -0.5 * ROWS * np.log(v).sum() - 0.5 * ((slope - 2.3) / 0.1) ** 2
        assert log_likelihood(problem, np.array([slope])) == pytest.approx(expected, rel=1e-12)
    fit = banded(problem, np.array([1.5]))
    assert fit.log_likelihood == pytest.approx(log_likelihood(problem, fit.estimate.values))


def test_exact_flights_have_a_billionth_of_signal_as_variance():
    """y = 2 x exactly: with v at 1e-9 of y's mean square, -1/2 (n log v + squares / v - n)."""
    x = np.random.default_rng(1).normal(size=(3, 400))
    y = 2.0 * x
    problem = slope_problem(y, x)
    floor = 1e-9 * (y**2).mean()
    for off in (0.0, 1e-5, 3e-5):
        squares = off**2 * (x**2).sum(axis=1)
        assert (squares < 400 * floor).all()
        expected = -0.5 * (3 * 400 * np.log(floor) + squares.sum() / floor - 3 * 400)
        found = log_likelihood(problem, np.array([2.0 + off]))
        assert found == pytest.approx(expected, abs=1e-6 * abs(expected))
    start, end = (log_likelihood(problem, np.array([2.0 + off])) for off in (3e-5, 0.0))
    assert end - start == pytest.approx(0.5 * 9e-10 * (x**2).sum() / floor, rel=1e-6)
    fit = banded(problem, np.array([1.0]))
    np.testing.assert_allclose(fit.variance, floor, rtol=1e-9)
    np.testing.assert_allclose(fit.estimate.covariance, floor / (x**2).sum(), rtol=1e-6)


def noisy_share(share):
    """Return the fit where so much of the information is the noise of x, and its plain slope."""
    y, x = points(2, noise=0.0, error=0.1)
    y, x = y[:1], x[:1]
    noise = share * float((x**2).mean())
    fit = banded(slope_problem(y, x, noise=noise), np.array([1.9]))
    _, xx, v = sums(y, x, float(fit.estimate.values[0]))
    return fit, float(np.sqrt(v[0] / xx[0]))


@pytest.mark.parametrize(
    ("share", "factor"), [(0.5, 2.0), (0.69, 1 / 0.31), (0.71, 10.0), (0.9, 10.0)]
)
def test_a_deviation_widens_with_noise_tenfold_beyond_70_percent(share, factor):
    fit, plain = noisy_share(share)
    assert float(fit.estimate.std[0]) == pytest.approx(factor * plain, rel=1e-6)


def test_where_most_is_noise_nothing_moves_from_its_start():
    fit, _ = noisy_share(0.71)
    assert fit.estimate.values[0] == 1.9


def test_noise_adds_its_variance_times_the_squared_slope():
    y, x = points()
    problem = slope_problem(y, x, noise=0.25)
    found = known_noise_variance(problem, 0, np.array([[[1.0, -3.0]]]))
    np.testing.assert_allclose(found, np.full((BLOCKS, 1), 2.25))


def answered(problem, rows):
    """Return the problem with as many rows of each block answered through x."""
    answers = ClosedLoopResponses(
        rows=np.full((BLOCKS, 1), rows),
        moves=np.ones((BLOCKS, 1, 1), dtype=complex),
        complementary_sensitivity=np.ones((BLOCKS, 1), dtype=complex),
        uncertainty=np.ones((BLOCKS, 1), dtype=complex),
        log_effect_slopes=np.zeros((BLOCKS, 1, 0), dtype=complex),
    )
    return replace(problem, feedback=Feedback(errors=(0,), inputs=(1,), responses=(answers,)))


def test_squares_are_without_what_known_noise_adds():
    """0.25 * 3^2 in every row; the prior's square; twice ln 3 in 7 rows a block."""
    y, x = points()
    problem = answered(slope_problem(y, x, noise=0.25, prior=(2.0, 0.5)), 7)
    own = ((y - 3.0 * x) ** 2).sum() - 2.25 * y.size
    expected = own / 2.0 + 4.0 - 2.0 * 7.0 * BLOCKS * np.log(3.0)
    found = evaluated(problem, np.array([3.0])).over(np.full((BLOCKS, 1), 2.0))
    assert found == pytest.approx(expected)


def test_half_the_slope_of_the_squares_is_the_corrected_score():
    """In blocks, too, in which nearly all is known noise: 0.04 * 2^2 of 0.17."""
    y, x = points(error=0.1)
    problem = answered(slope_problem(y, x, noise=0.04, prior=(2.0, 0.5)), 7)
    state = evaluated(problem, np.array([1.9]))
    score = corrected_equations(problem, state).score
    ends = [evaluated(problem, np.array([1.9 + off])).over(state.variance) for off in (-1e-5, 1e-5)]
    assert -0.5 * (ends[1] - ends[0]) / 2e-5 == pytest.approx(score[0], rel=1e-6)


@pytest.mark.parametrize("noise", [None, 0.04])
@pytest.mark.parametrize("seed", range(4))
def test_the_score_turns_by_what_newton_steps_solve_with(noise, seed):
    """Of a linear equation nothing else turns it; rows are too many to borrow of neighbours."""
    y, x = points(seed)
    problem = slope_problem(y, x, noise=noise, prior=(2.0, 0.5))
    at, off = np.array([2.7]), 1e-5

    def score(phi):
        return float(corrected_equations(problem, evaluated(problem, phi)).score[0])

    equations = corrected_equations(problem, evaluated(problem, at))
    expected = equations.information - equations.noise_information - equations.reweighting
    assert abs(equations.reweighting[0, 0]) > 0.01 * expected[0, 0]
    turned = (score(at + off) - score(at - off)) / (2.0 * off)
    assert -turned == pytest.approx(float(expected[0, 0]), rel=1e-6)


def test_blocks_of_nearly_only_noise_do_not_stop_the_iteration():
    y, x = points(error=0.1)
    fit = banded(slope_problem(y, x, noise=0.04), np.array([1.5]))
    slope = float(fit.estimate.values[0])
    expected, information = closed(y, x, slope, noise=0.04)
    assert slope == pytest.approx(expected, abs=1e-3 / information**0.5)


@pytest.mark.parametrize("noise", [None, 0.0])
def test_a_response_adds_its_rows_times_ln_of_the_slope(noise):
    """Then the score is rows / slope a block; both ways of solving settle where all is zero."""
    y, x = points(3, noise=0.0)
    problem = slope_problem(y, x, noise=noise)
    with_answer = answered(problem, 40)
    gain = log_likelihood(with_answer, np.array([3.0])) - log_likelihood(problem, np.array([3.0]))
    assert gain == pytest.approx(40.0 * BLOCKS * np.log(3.0))
    fit = banded(with_answer, np.array([1.5]))
    slope = float(fit.estimate.values[0])
    xy, xx, v = sums(y, x, slope)
    scores = (xy - slope * xx) / v + 40.0 / slope
    assert scores.sum() == pytest.approx(0.0, abs=5e-3 * (xx / v).sum() ** 0.5)
    found = normal_equations(fit, np.ones(BLOCKS, dtype=bool)).scores[:-1, 0]
    np.testing.assert_allclose(found, scores, rtol=1e-6)
    np.testing.assert_allclose(fit.influence[:, 0], scores / (xx / v).sum(), rtol=1e-6)


def test_a_crawling_fit_ends_at_the_same_place_in_half_the_steps(monkeypatch):
    """A hundred blocks of three rows show four slopes, weighted by their own residuals."""
    rng = np.random.default_rng(4)
    x = rng.normal(size=(100, 3, 4))
    x[:, :, 3] = x[:, :, 2] + x[:, :, 3]
    error = 10.0 ** rng.uniform(-1.0, 1.0, size=(100, 1))
    y = x @ np.array([2.0, 1.0, -1.0, 0.5]) + error * rng.standard_t(2.0, size=(100, 3))
    seen = x + 0.05 * rng.normal(size=x.shape)
    tensor = np.eye(5)[:, None]
    names = ("y", "a", "b", "c", "d")
    problem = BandedProblem(
        factors=(
            Factors(
                R=triangular_factors(np.concatenate([y[:, :, None], seen], axis=2)),
                rows=np.full(100, 3),
                segment=np.arange(100),
                band=np.tile([0.0, 1.0], (100, 1)),
                noise=np.tile([0.0, 0.0025, 0.0025, 0.0025, 0.0025], (100, 1)),
            ),
        ),
        tensors=(tensor,),
        map=parameter_map(names, {n: {(0, n): -1.0} for n in names[1:]}, {(0, "y"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
    )
    start = np.zeros(4)
    quick = banded(problem, start)
    monkeypatch.setattr(Leaps, "from_state", lambda *_: None)
    plain = banded(problem, start)
    assert quick.iterations <= 0.5 * plain.iterations
    np.testing.assert_allclose(
        quick.estimate.values, plain.estimate.values, atol=0.02 * plain.estimate.std.min()
    )
