"""How far the parts of a fit scatter over what it states: by hand, and over many made ones."""

import numpy as np
import pytest

from rotorfit.estimation import dispersion as module
from rotorfit.estimation.banded import BandedProblem, banded
from rotorfit.estimation.dispersion import Dispersion, dispersion
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


def test_one_part_alone_tells_nothing():
    fit = line(1, 0.0)
    found = dispersion(fit, [np.ones(PARTS * BLOCKS, dtype=bool)])
    assert found.degrees == pytest.approx(0.0, abs=1e-9)


def test_scatter_is_pooled_by_degrees_of_freedom():
    """(2 * 9 + 6 * 3 * 1) / 8 of 8 degrees; without any of its own the number's alone."""
    stated, shown, blocks = np.array([1.0]), np.array([9.0]), np.array([2.0])
    variance, degrees = Dispersion(ratio=3.0, degrees=6.0).pooled(stated, shown, blocks)
    assert (variance[0], degrees[0]) == (4.5, 8.0)
    variance, degrees = Dispersion(ratio=1.0, degrees=0.0).pooled(stated, shown, blocks)
    assert (variance[0], degrees[0]) == (9.0, 2.0)


def test_what_is_not_stated_has_no_dispersion(monkeypatch):
    fit = line(1, 0.0)
    monkeypatch.setattr(module, "information_of_parts", lambda fit, parts: np.zeros((4, 2, 2)))
    assert dispersion(fit, parts_of(fit)) == Dispersion(ratio=1.0, degrees=0.0)
