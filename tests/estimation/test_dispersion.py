"""How far the parts of a fit scatter over what it states: by hand, and over many made ones."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.estimation import dispersion as module
from rotorfit.estimation.banded import BandedProblem, banded, information_of_parts
from rotorfit.estimation.dispersion import (
    Dispersion,
    alike,
    dispersions,
    pooled,
)
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.parameter_map import parameter_map

PARTS = 4
BLOCKS = 5
"""Of each part."""


def line(seed, apart, *, rows=60):
    """Fit y = a x + b w, with a and b of each part `apart` deviations of one from 2 and -1."""
    rng = np.random.default_rng(seed)
    count = PARTS * BLOCKS
    x, w, noise = rng.normal(size=(3, count, rows))
    own = apart / np.sqrt(BLOCKS * rows) * np.repeat(rng.normal(size=(2, PARTS)), BLOCKS, axis=1)
    y = (2.0 + own[0])[:, None] * x - (1.0 - own[1])[:, None] * w + noise
    factors = Factors(
        R=triangular_factors(np.stack([y, x, w], axis=2)),
        rows=np.full(count, rows),
        segment=np.repeat(np.arange(PARTS), BLOCKS),
        band=np.tile([0.0, 1.0], (count, 1)),
    )
    tensor = np.zeros((3, 1, 3))
    tensor[0, 0, 0], tensor[1, 0, 1], tensor[2, 0, 2] = 1.0, -1.0, -1.0
    problem = BandedProblem(
        factors=(factors,),
        tensors=(tensor,),
        map=parameter_map(
            ("y", "x", "w"), {"a": {(0, "x"): 1.0}, "b": {(0, "w"): 1.0}}, {(0, "y"): 1.0}
        ),
        noisy=(0,),
        prior_mean={},
        prior_std={},
    )
    return banded(problem, np.array([1.0, 0.0]))


def dispersion(fit, parts):
    [found] = dispersions(fit, parts, [np.any(parts, axis=0)])
    return found


def parts_of(fit):
    segment = fit.problem.factors[0].segment
    return [segment == part for part in range(PARTS)]


@pytest.mark.parametrize(("apart", "expected"), [(0.0, 1.0), (2.0, 5.0)])
def test_parts_that_differ_show_their_own_variance(apart, expected):
    """Of deviations of 2 beside those of 1 by chance: 1 + 2^2 times as much as stated."""
    found = [dispersion(fit, parts_of(fit)) for fit in (line(k, apart) for k in range(60))]
    assert np.mean([one.ratio for one in found]) == pytest.approx(expected, rel=0.1)


def test_degrees_are_those_of_the_ratios_own_scatter():
    """Two parameters of four parts: three of each are free, 6; a chi-square of 6 over 6."""
    found = [dispersion(fit, parts_of(fit)) for fit in (line(k, 0.0) for k in range(150))]
    assert np.mean([one.degrees for one in found]) == pytest.approx(6.0, rel=0.05)
    assert np.var([one.ratio for one in found]) == pytest.approx(2.0 / 6.0, rel=0.25)


def test_one_part_alone_counts_nothing():
    fit = line(1, 0.0)
    found = dispersion(fit, [np.ones(PARTS * BLOCKS, dtype=bool)])
    assert found.degrees == pytest.approx(0.0, abs=1e-9)


def test_scatter_is_pooled_by_degrees_of_freedom():
    """(2 * 9 + 6 * 3 * 1) / 8 of 8 degrees; without any of its own the number's alone."""
    stated, shown, blocks = np.array([[1.0]]), np.array([9.0]), np.array([2.0])
    variance, degrees = pooled([Dispersion(ratio=3.0, degrees=6.0)], stated, shown, blocks)
    assert (variance[0], degrees[0]) == (4.5, 8.0)
    variance, degrees = pooled([Dispersion(ratio=1.0, degrees=0.0)], stated, shown, blocks)
    assert (variance[0], degrees[0]) == (9.0, 2.0)


def test_each_flight_widens_by_its_own_share():
    """2 * 3 + 5 * 1 of 11^2 / (6^2 / 4 + 5^2 / 5) degrees; a flight without a share is no matter.

    What nothing is stated of has its own scatter alone."""
    two = [Dispersion(ratio=2.0, degrees=4.0), Dispersion(ratio=5.0, degrees=5.0)]
    stated = np.array([[3.0, 3.0, 0.0], [1.0, 0.0, 0.0]])
    variance, degrees = pooled(two, stated, np.array([1.0, 1.0, 7.0]), np.array([1.0, 1.0, 2.0]))
    both = 11.0**2 / 14.0
    assert variance == pytest.approx([(1 + both * 11) / (1 + both), (1 + 4 * 6) / 5, 7.0])
    assert degrees == pytest.approx([1.0 + both, 5.0, 2.0])


def scattered(rng, true, degrees):
    return [
        Dispersion(ratio=float(r * rng.chisquare(f) / f), degrees=float(f))
        for r, f in zip(true, degrees, strict=True)
    ]


def test_flights_that_scatter_alike_share_one_dispersion():
    """Of 400 fives no more unlike than chance, the mean is known by all, and unbiased."""
    rng = np.random.default_rng(5)
    found = [alike(scattered(rng, [2.0] * 5, [6.0] * 5)) for _ in range(400)]
    off = np.log([[one.ratio for one in five] for five in found]) - np.log(2.0)
    assert abs(off.mean()) < 0.05  # by the mean of logarithms it were .17 too small
    assert off.std() < 0.8 * np.sqrt(2.0 / 6.0)
    assert np.median([five[0].degrees for five in found]) == pytest.approx(30.0, rel=0.15)


def test_flights_that_scatter_unlike_keep_their_own():
    """1 and 8 of 60 degrees each: what is drawn to the others is a small part of the difference."""
    rng = np.random.default_rng(6)
    found = [alike(scattered(rng, [1.0, 8.0, 1.0], [60.0] * 3)) for _ in range(100)]
    ratios = np.median([[one.ratio for one in three] for three in found], axis=0)
    assert ratios == pytest.approx([1.0, 8.0, 1.0], rel=0.1)
    assert found[0][0].degrees == pytest.approx(60.0, rel=0.2)


def test_two_dispersions_are_drawn_together_by_moments():
    """Half their difference a = ln 3 shrinks by 1 - s^2 / 2 a^2, s^2 = trigamma(5) by chance."""
    one, other = alike([Dispersion(ratio=ratio, degrees=10.0) for ratio in (1.0, 9.0)])
    a, chance = np.log(3.0), 0.2213229557
    kept = 1.0 - chance / (2.0 * a**2)
    middle = a + np.log(5.0) - 1.5061176684  # less the mean of the logarithm, digamma(5) - ln 5
    assert np.log([one.ratio, other.ratio]) == pytest.approx([middle - kept * a, middle + kept * a])
    variance = kept * chance + (1.0 - kept) ** 2 * a**2
    assert one.degrees == pytest.approx((1.0 + np.sqrt(1.0 + 2.0 * variance)) / variance)


def test_a_flight_that_shows_nothing_has_the_mean_of_the_others():
    """And is known no better than the others are alike."""
    two = [Dispersion(ratio=4.0, degrees=40.0), Dispersion(ratio=1.0, degrees=40.0)]
    *known, silent = alike([*two, Dispersion(ratio=1.0, degrees=0.0)])
    assert silent.ratio == pytest.approx(2.0, rel=0.05)
    assert silent.degrees < 5.0 < known[0].degrees


def test_what_hardly_shows_a_dispersion_makes_none():
    """Two flights of one phase each: a bare one, and one with a payload."""
    hardly, nothing = Dispersion(ratio=9.0, degrees=0.008), Dispersion(ratio=1.0, degrees=0.0)
    assert max(one.ratio for one in alike([hardly, nothing])) <= 9.0
    known = Dispersion(ratio=2.0, degrees=12.0)
    drawn = alike([hardly, known])[0]
    assert drawn.ratio == pytest.approx(alike([nothing, known])[0].ratio)


def test_one_flight_is_left_as_it_is():
    one = Dispersion(ratio=4.0, degrees=7.0)
    assert alike([one]) == [one]


def test_groups_have_the_dispersion_of_their_own_parts():
    """The first two parts scatter twice as far as the others, by the sums over each."""
    fit = line(3, 0.0)
    parts = parts_of(fit)
    groups = [parts[0] | parts[1], parts[2] | parts[3]]
    scale = np.where(groups[0], 3.0, 1.0)[:, None]
    fit = replace(fit, influence=scale * fit.influence)
    root = np.linalg.inv(np.linalg.cholesky(fit.estimate.covariance))
    moves = [root @ fit.influence[part].sum(axis=0) for part in parts]
    H = information_of_parts(fit, parts) @ fit.estimate.covariance
    free = [np.trace(one - one @ one) for one in H]
    expected = [
        (moves[i] @ moves[i] + moves[i + 1] @ moves[i + 1]) / (free[i] + free[i + 1])
        for i in (0, 2)
    ]
    alone = [dispersion(fit, [parts[i], parts[i + 1]]) for i in (0, 2)]
    assert [one.ratio for one in alone] == pytest.approx(expected)
    assert dispersions(fit, parts, groups) == alike(alone)


def test_what_is_not_stated_has_no_dispersion(monkeypatch):
    fit = line(1, 0.0)
    monkeypatch.setattr(module, "information_of_parts", lambda fit, parts: np.zeros((4, 2, 2)))
    assert dispersion(fit, parts_of(fit)) == Dispersion(ratio=1.0, degrees=0.0)
