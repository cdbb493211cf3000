"""What a part of the blocks says against the whole, by one step."""

import numpy as np
import pytest

from rotorfit.estimation.banded import (
    BandedProblem,
    banded,
    normal_equations,
    shift_without,
    steps_without,
)
from rotorfit.estimation.factors import Factors, time_block_factors
from rotorfit.estimation.parameter_map import parameter_map

BLOCKS, ROWS = 40, 60


def line_problem(seed, *, jump=0.0):
    """Return y = a x + b with unit noise on y; in the last ten blocks a is larger by `jump`."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=BLOCKS * ROWS)
    slope = 2.0 + jump * (np.arange(BLOCKS * ROWS) >= 30 * ROWS)
    y = slope * x + 0.5 + rng.normal(size=len(x))
    blocks = time_block_factors(np.column_stack([y, x, np.ones_like(x)]), block_rows=ROWS)
    factors = Factors(R=blocks.R, rows=blocks.rows, segment=np.arange(BLOCKS), band=blocks.band)
    tensor = np.zeros((3, 1, 3))
    tensor[0, 0, 0] = 1.0
    tensor[1, 0, 1] = tensor[2, 0, 2] = -1.0
    free = {"a": {(0, "a"): 1.0}, "b": {(0, "b"): 1.0}}
    return BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(("y", "a", "b"), free, {(0, "y"): 1.0}),
        noisy=(0,),
        prior_mean={},
        prior_std={},
    )


LAST = np.arange(BLOCKS) >= 30


def test_one_step_is_the_fit_without_those_blocks():
    problem = line_problem(1, jump=0.1)
    fit = banded(problem, np.array([1.0, 0.0]))
    rest = BandedProblem(
        factors=(problem.factors[0].select(~LAST),),
        tensors=problem.tensors,
        map=problem.map,
        noisy=problem.noisy,
        prior_mean={},
        prior_std={},
    )
    again = banded(rest, np.array([1.0, 0.0]))
    moved = again.estimate.values - fit.estimate.values
    shift = shift_without(fit, LAST)
    np.testing.assert_allclose(shift.values, moved, atol=0.05 * np.abs(moved).max())


def test_the_shift_is_as_large_as_it_says():
    shifts = [
        shift_without(banded(line_problem(seed), np.array([2.0, 0.5])), LAST) for seed in range(150)
    ]
    scores = np.array([s.values / s.std for s in shifts])
    assert scores.std() == pytest.approx(1.0, abs=0.15)
    assert np.abs(scores.mean()) < 0.2


def test_a_part_that_differs_is_seen():
    shift = shift_without(banded(line_problem(3, jump=0.3), np.array([2.0, 0.5])), LAST)
    assert shift.values[0] / shift.std[0] < -5.0
    assert abs(shift.values[1] / shift.std[1]) < 4.0


def test_blocks_left_out_say_nothing():
    fit = banded(line_problem(4), np.array([2.0, 0.5]))
    whole = normal_equations(fit, np.ones(BLOCKS, dtype=bool))
    rest = normal_equations(fit, ~LAST)
    assert not rest.scores[:-1][LAST].any()
    np.testing.assert_allclose(whole.scores.sum(axis=0), 0.0, atol=1e-2)
    both = normal_equations(fit, LAST).information + rest.information
    np.testing.assert_allclose(whole.information, both, rtol=1e-9)


def test_steps_without_each_part_are_those_of_all_others():
    fit = banded(line_problem(5, jump=0.1), np.array([2.0, 0.5]))
    parts = [LAST, np.arange(BLOCKS) < 7, np.arange(BLOCKS) == 12]
    expected = [normal_equations(fit, ~part).step for part in parts]
    every = [*parts, ~(parts[0] | parts[1] | parts[2])]
    np.testing.assert_allclose(steps_without(fit, every)[:3], expected, rtol=1e-8)
