"""The banded likelihood: its Jacobian, its oracle, exactness, coverage."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import (
    BandedProblem,
    banded,
    covariance_with_noise_uncertainty,
    square_root,
)
from rotorfit.estimation.banded_equations import (
    State,
    corrected_equations,
    evaluated,
    lifted_slopes,
    part_information,
    root_of,
    selected,
)
from rotorfit.estimation.banded_problem import solutions
from rotorfit.estimation.factors import Factors, time_block_factors, triangular_factors
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.estimation.parameter_map import parameter_map


def line_problem(x, y, *, block_rows=50, prior_std=None):
    """The line y = slope x + offset with y noisy: one equation, signals (y, x, 1)."""
    Z = np.column_stack([y, x, np.ones_like(x)])
    tensor = np.zeros((3, 1, 3))
    tensor[0, 0, 0] = 1.0  # y itself
    tensor[1, 0, 1] = -1.0  # slope
    tensor[2, 0, 2] = -1.0  # offset
    mapped = parameter_map(
        ("y", "slope", "offset"),
        {"slope": {(0, "slope"): 1.0}, "offset": {(0, "offset"): 1.0}},
        {(0, "y"): 1.0},
    )
    return BandedProblem(
        factors=(time_block_factors(Z, block_rows=block_rows),),
        tensors=(tensor,),
        map=mapped,
        noisy=(0,),
        prior_mean={},
        prior_std=prior_std or {},
    )


def random_problem(seed, *, products=False):
    """Two noisy equations in five signals, nonlinear through M(theta)."""
    rng = np.random.default_rng(seed)
    tensor = rng.normal(size=(5, 2, 5))
    names = ("m", "a", "b", "c", "d")
    free = {"p": {(0, "a"): 1.0}, "q": {(0, "b"): 1.0, (0, "c"): 0.5}, "r": {(0, "d"): 1.0}}
    terms = {(0, "c"): [(0.3, "p", "q"), (-0.2, "r", "r")]} if products else {}
    R = triangular_factors(rng.normal(size=(4, 30, 5)))
    factors = Factors(
        R=R,
        rows=np.full(4, 30),
        segment=np.array([0, 0, 1, 1]),
        band=np.tile([0.0, 1.0], (4, 1)),
    )
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(names, free, {(0, "m"): 3.0}, products=terms),
        noisy=(0, 1),
        prior_mean={},
        prior_std={},
    )


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), products=st.booleans())
def test_jacobian_is_the_derivative_of_the_residual(seed, products):
    problem = random_problem(seed, products=products)
    phi = np.random.default_rng(seed + 1).normal(size=3) * 0.1
    (dU,) = lifted_slopes(problem, phi, solutions(problem, phi))
    J = np.einsum("bma,kaf->bmkf", problem.factors[0].columns, dU)
    for f in range(3):
        step = np.zeros(3)
        step[f] = 1e-6
        difference = (
            evaluated(problem, phi + step).residual - evaluated(problem, phi - step).residual
        ) / 2e-6
        scale = np.abs(J[..., f]).max() + np.abs(difference).max()
        np.testing.assert_allclose(J[..., f], difference, atol=2e-5 * scale)


def random_answers(rng, blocks):
    shape = (blocks, 2, 2)
    moves, share, doubt = (
        rng.normal(size=s) + 1j * rng.normal(size=s) for s in (shape, shape[:2], shape[:2])
    )
    return ClosedLoopResponses(
        rows=rng.integers(10, 30, size=(blocks, 2)),
        moves=moves,
        complementary_sensitivity=share,
        uncertainty=doubt,
        log_effect_slopes=np.zeros((blocks, 2, 0), dtype=complex),
    )


def in_parts_and_apart(seed, *, noise):
    """Return one configuration of two parts, and two configurations of one, of the same blocks."""
    rng = np.random.default_rng(seed)
    plain = random_problem(seed)
    factors = plain.factors[0]
    if noise:
        factors = replace(factors, noise=0.01 * rng.uniform(size=(4, 5)))
    each = [factors.select(np.arange(4) < 1), factors.select(np.arange(4) >= 1)]
    free = {
        "p": {(0, "a"): 1.0, (1, "a"): 1.0},
        "q": {(0, "b"): 1.0, (1, "c"): 0.5},
        "r": {(1, "d"): 1.0},
        "s": {(1, "b"): 1.0},
    }
    known = {(0, "m"): 3.0, (1, "m"): 3.0}
    terms = {(1, "c"): [(0.3, "p", "s")]}
    apart = replace(
        plain,
        factors=tuple(each),
        tensors=plain.tensors * 2,
        map=parameter_map("mabcd", free, known, configurations=2, products=terms),
        prior_std={name: 2.0 for name in "pqrs"},
        counted=(np.array([[True, False]]), np.ones((3, 2), dtype=bool)),
        feedback=Feedback(
            errors=(0, 1), inputs=(2, 3), responses=(random_answers(rng, 1), random_answers(rng, 3))
        ),
    )
    together = replace(
        apart,
        factors=(factors,),
        tensors=plain.tensors,
        parts=((1, 3),),
        counted=(np.concatenate(apart.counted),),
    )
    return together, apart


@pytest.mark.parametrize("noise", [False, True])
def test_parts_of_a_configuration_are_as_configurations(noise):
    """But for what few rows borrow, and the floor: here no block has few, and none is exact."""
    together, apart = in_parts_and_apart(3, noise=noise)
    phi = np.array([0.2, -0.4, 0.7, 0.1])
    chosen = [np.array([True, True, False, False]), np.array([False, True, False, True])]

    def all_of(problem):
        state = evaluated(problem, phi)
        asked = corrected_equations(problem, state)
        at = State(phi=phi, residual=state.residual, variance=state.variance)
        some = corrected_equations(*selected(problem, at, chosen[1]))
        return (
            np.array([state.cost, state.rest]),
            state.residual,
            state.variance,
            state.squares,
            asked.information,
            asked.noise_information,
            asked.scores,
            part_information(problem, state, chosen),
            some.information,
            some.scores,
            root_of(problem, state, asked.information),
        )

    for one, other in zip(all_of(together), all_of(apart), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_rows_give_the_root_of_the_information_of_every_part(monkeypatch):
    together, _ = in_parts_and_apart(3, noise=False)
    state = evaluated(together, np.array([0.2, -0.4, 0.7, 0.1]))
    plain = corrected_equations(together, state).information
    monkeypatch.setattr("rotorfit.estimation.banded_equations.SMALLEST_PIVOT", np.inf)
    R = root_of(together, state, plain)
    np.testing.assert_allclose(R.T @ R, plain, rtol=1e-10, atol=1e-10 * plain.max())


def test_one_noise_level_gives_ordinary_least_squares():
    rng = np.random.default_rng(0)
    x = rng.normal(size=400)
    y = 2.0 * x - 0.5 + 0.1 * rng.normal(size=400)
    fit = banded(line_problem(x, y, block_rows=400), np.array([0.0, 0.0]))
    slope, offset = np.polyfit(x, y, 1)
    np.testing.assert_allclose(fit.estimate.values, [slope, offset], rtol=1e-6)
    _, covariance = np.polyfit(x, y, 1, cov="unscaled")
    residual = y - slope * x - offset
    expected = covariance * (residual @ residual) / 400
    np.testing.assert_allclose(fit.estimate.covariance, expected, rtol=1e-5)


def test_quiet_blocks_count_more_than_loud_ones():
    rng = np.random.default_rng(1)
    x = rng.normal(size=2000)
    loud = np.repeat([0.01, 1.0], 1000)
    errors = {"banded": [], "ordinary": []}
    for _ in range(20):
        y = 3.0 * x + loud * rng.normal(size=2000)
        fit = banded(line_problem(x, y, block_rows=100), np.array([1.0, 0.0]))
        errors["banded"].append(fit.estimate.value("slope") - 3.0)
        errors["ordinary"].append(np.polyfit(x, y, 1)[0] - 3.0)
    assert np.std(errors["banded"]) < 0.05 * np.std(errors["ordinary"])


def test_interval_covers_the_slope():
    rng = np.random.default_rng(2)
    x = rng.normal(size=1000)
    level = np.repeat(rng.uniform(0.05, 0.5, size=20), 50)
    inside = 0
    for _ in range(200):
        y = 3.0 * x + level * rng.normal(size=1000)
        fit = banded(line_problem(x, y), np.array([1.0, 0.0]))
        inside += abs(fit.estimate.values[0] - 3.0) < 1.96 * fit.estimate.std[0]
    assert 180 <= inside <= 199  # 0.90 to 0.995 of 200; the noise of 20 blocks is estimated


@pytest.mark.parametrize("rows", [30, 60])
def test_variances_from_n_rows_add_four_nths(rows):
    rng = np.random.default_rng(4)
    x = rng.normal(size=8 * rows)
    fit = banded(line_problem(x, x + rng.normal(size=8 * rows), block_rows=rows), np.zeros(2))
    expected = fit.estimate.covariance * (1.0 + 4.0 / rows)
    np.testing.assert_allclose(covariance_with_noise_uncertainty(fit), expected, rtol=1e-9)


def test_what_a_prior_shows_is_no_chance():
    rng = np.random.default_rng(4)
    x = rng.normal(size=240)
    known = line_problem(
        x, x + rng.normal(size=240), block_rows=30, prior_std={"slope": 1e-4, "offset": 1e-4}
    )
    fit = banded(known, np.zeros(2))
    np.testing.assert_allclose(
        covariance_with_noise_uncertainty(fit), fit.estimate.covariance, atol=1e-12
    )


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), size=st.integers(1, 8), spread=st.floats(0.0, 12.0))
def test_a_root_of_any_units_squares_to_what_it_is_of(seed, size, spread):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-spread, spread, size)
    root = units[:, None] * rng.normal(size=(size, size + 2))
    again = square_root(root @ root.T)
    np.testing.assert_allclose(again @ again.T / np.outer(units, units), root @ root.T
                               / np.outer(units, units), atol=1e-12)  # fmt: skip


def test_what_variances_add_is_never_below_zero():
    """Of slope and offset only one combination is known: rounding is larger than what is added."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        x = 1.0 + 1e-8 * rng.normal(size=400)
        fit = banded(line_problem(x, x + rng.normal(size=400)), np.zeros(2))
        added = np.diagonal(covariance_with_noise_uncertainty(fit)) - np.diagonal(
            fit.estimate.covariance
        )
        assert (added >= 0.0).all()


def test_few_rows_scatter_as_said():
    """Six stretches of ten rows, noise of a factor of three: the fit alone claims too much."""
    rng = np.random.default_rng(9)
    plain, widened, found = [], [], []
    for _ in range(300):
        x = rng.normal(size=(6, 10))
        y = x + np.linspace(1.0, 3.0, 6)[:, None] * rng.normal(size=(6, 10))
        problem = line_problem(x.ravel(), y.ravel(), block_rows=10)
        apart = replace(problem.factors[0], segment=np.arange(6))
        fit = banded(replace(problem, factors=(apart,)), np.array([1.0, 0.0]))
        found.append(fit.estimate.values[0])
        plain.append(fit.estimate.covariance[0, 0])
        widened.append(covariance_with_noise_uncertainty(fit)[0, 0])
    variance = np.var(found)
    assert np.mean(plain) < 0.8 * variance
    assert np.mean(widened) == pytest.approx(variance, rel=0.2)


def test_exact_equations_are_met_to_rounding():
    x = np.linspace(-1.0, 1.0, 200)
    fit = banded(line_problem(x, 1e-3 * x + 7.0), np.array([5.0, -20.0]))
    np.testing.assert_allclose(fit.estimate.values, [1e-3, 7.0], rtol=1e-9, atol=1e-12)


def test_prior_holds_what_the_data_leave_open():
    x = np.full(200, 2.0)  # slope and offset cannot be told apart
    y = 5.0 + 0.1 * np.random.default_rng(3).normal(size=200)
    fit = banded(line_problem(x, y, prior_std={"offset": 1e-6}), np.array([0.0, 0.0]))
    assert fit.estimate.value("slope") == pytest.approx(2.5, abs=0.02)


def test_a_parameter_that_nothing_moves_is_named_as_such():
    x = np.zeros(200)
    y = np.random.default_rng(4).normal(size=200)
    with pytest.raises(EstimationError, match="do not move a parameter"):
        banded(line_problem(x, y), np.array([0.0, 0.0]))


def test_products_are_carried_through_fixing_a_parameter():
    problem = random_problem(5, products=True)
    phi = np.array([0.2, -0.4, 0.7])
    whole = problem.map.theta(phi)
    for name, value, rest in (("p", 0.2, [1, 2]), ("q", -0.4, [0, 2]), ("r", 0.7, [0, 1])):
        fixed = problem.map.fixed(name, value)
        np.testing.assert_allclose(fixed.theta(phi[rest]), whole, rtol=1e-13)


def test_known_noise_of_a_regressor_does_not_bias_the_slope():
    rng = np.random.default_rng(6)
    slopes = {True: [], False: []}
    for _ in range(20):
        x = rng.normal(size=1000)
        seen = x + 0.5 * rng.normal(size=1000)
        y = 3.0 * x + 0.2 * rng.normal(size=1000)
        for known in (True, False):
            problem = line_problem(seen, y)
            factors = problem.factors[0]
            noise = np.tile([0.0, 0.25, 0.0], (len(factors), 1)) if known else None
            problem = replace(problem, factors=(replace(factors, noise=noise),))
            fit = banded(problem, np.array([1.0, 0.0]))
            slopes[known].append(fit.estimate.values[0])
    assert np.mean(slopes[False]) == pytest.approx(3.0 / 1.25, abs=0.05)  # attenuated
    assert np.mean(slopes[True]) == pytest.approx(3.0, abs=4 * np.std(slopes[True]) / 20**0.5)


def test_covariance_with_known_noise_is_the_estimates_scatter():
    rng = np.random.default_rng(8)
    errors, claimed = [], []
    for _ in range(100):
        x = rng.normal(size=1000)
        seen = x + 0.3 * rng.normal(size=1000)
        y = 3.0 * x + 0.5 * rng.normal(size=1000)
        problem = line_problem(seen, y)
        factors = problem.factors[0]
        noise = np.tile([0.0, 0.09, 0.0], (len(factors), 1))
        fit = banded(
            replace(problem, factors=(replace(factors, noise=noise),)), np.array([1.0, 0.0])
        )
        errors.append(fit.estimate.values[0] - 3.0)
        claimed.append(fit.estimate.std[0])
    assert np.std(errors) == pytest.approx(np.mean(claimed), rel=0.25)
