"""A closed loop in which gusts pull least squares: what was asked for tells without their pull."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.checks.reference_test import FEWEST_LINES, Instrumented, instrumented

BLOCKS, LINES = 12, 15
BLOCK = np.repeat(np.arange(BLOCKS), LINES)
SEEDS = 60


def noise(rng, size=BLOCKS * LINES):
    return (rng.normal(size=size) + 1j * rng.normal(size=size)) / 2**0.5


def loop(seed, *, pilot=3.0, answer=0.5, response=1.0, passed=0.0):
    """Return reference, prediction and error of rotors that answer a share of every gust.

    Each block has its own gain and phase of the loop. `response`: of the vehicle over the model's;
    `passed`: share of the answer that an attitude loop asks for, and the rate loop does not add.
    """
    rng = np.random.default_rng(seed)
    gust, asked = noise(rng), pilot * noise(rng)
    gain = np.repeat(rng.uniform(0.5, 2.0, BLOCKS) * np.exp(1j * rng.uniform(0, 6, BLOCKS)), LINES)
    asked = asked - passed * answer * gust / gain
    made = gain * asked - (1.0 - passed) * answer * gust
    return asked, made, gust + (response - 1.0) * made


def found(seed, **how):
    one = instrumented(*loop(seed, **how), block=BLOCK)
    assert one is not None
    return one


@pytest.fixture(scope="module")
def gusty():
    return [found(seed) for seed in range(SEEDS)]


def test_least_squares_is_biased_and_the_instrument_is_not(gusty):
    plain, ratio = (np.array([getattr(one, name) for one in gusty]) for name in ("plain", "ratio"))
    assert plain.mean() < 0.97
    assert abs(ratio.mean() - 1.0) < 3.0 * ratio.std() / SEEDS**0.5
    assert ratio.std() / SEEDS**0.5 < 0.005


def test_the_deviation_is_that_of_the_scatter(gusty):
    ratio = np.array([one.ratio for one in gusty])
    stated = np.median([one.std for one in gusty])
    assert 0.8 < stated / ratio.std() < 1.5
    inside = np.abs(ratio - 1.0) < [one.half_width for one in gusty]
    assert inside.mean() > 0.93


def test_a_weak_reference_is_not_biased_either():
    """With each line in its own gain, the gusts would come back through it."""
    some = [found(seed, pilot=0.5, answer=0.7) for seed in range(SEEDS)]
    assert np.mean([one.plain for one in some]) < 0.3
    assert np.median([one.ratio for one in some]) == pytest.approx(1.0, abs=0.04)


def test_what_an_attitude_loop_passes_on_is_in_the_half_width():
    some = [found(seed, pilot=2.0, answer=1.0, passed=0.25) for seed in range(SEEDS)]
    off = np.abs([one.ratio - 1.0 for one in some])
    assert np.mean(off < [1.96 * one.std for one in some]) < 0.8
    assert np.mean(off < [one.half_width for one in some]) > 0.9


def test_a_wrong_response_contradicts_the_model_and_gusts_do_not(gusty):
    assert not any(one.contradicts(1e-3) for one in gusty)
    other = [found(seed, pilot=10.0, answer=0.1, response=1.2) for seed in range(5)]
    assert all(one.contradicts(1e-3) for one in other)
    assert [one.ratio for one in other] == pytest.approx([1.2] * 5, abs=0.03)


def test_what_an_attitude_loop_may_pass_on_is_no_contradiction():
    one = Instrumented(ratio=1.10, plain=1.10, std=0.01, difference_std=0.01)
    assert one.contradicts(1e-3)
    assert not replace(one, plain=0.94).contradicts(1e-3)


def test_what_two_blocks_show_is_known_as_of_two():
    asked, made, error = loop(1)
    one = instrumented(asked, made, error, block=BLOCK)
    assert 0.5 * BLOCKS < one.degrees <= BLOCKS
    halves = instrumented(asked, made, error, block=BLOCK // (BLOCKS // 2))
    assert 1.5 < halves.degrees <= 2.0
    seen = Instrumented(ratio=1.2, plain=1.2, std=0.03, difference_std=0.03, degrees=2.0)
    assert seen.contradicts(1e-3)
    assert not replace(seen, of_blocks=1.0).contradicts(1e-3)
    assert replace(seen, of_blocks=1.0).half_width == pytest.approx(4.303 * 0.03, rel=1e-3)
    assert replace(seen, of_blocks=0.2).half_width == pytest.approx(1.96 * 0.03, rel=1e-3)


def test_scales_and_units_of_the_reference_do_not_matter():
    asked, made, error = loop(1)
    one = instrumented(asked, made, error, block=BLOCK)
    other = instrumented(57.3j * asked, made, error, block=BLOCK)
    assert other.ratio == pytest.approx(one.ratio, rel=1e-12)
    assert other.std == pytest.approx(one.std, rel=1e-12)


def test_no_reference_shows_nothing():
    asked, made, error = loop(1)
    assert instrumented(0.0 * asked, made, error, block=BLOCK) is None
    few = slice(0, FEWEST_LINES - 1)
    assert instrumented(asked[few], made[few], error[few], block=BLOCK[few]) is None
    assert instrumented(asked, 0.0 * made, 0.0 * error, block=BLOCK) is None
    none = slice(0, 0)
    assert instrumented(asked[none], made[none], error[none], block=BLOCK[none]) is None


def test_a_simulation_without_errors_has_the_models_response():
    asked, made, error = loop(1)
    one = instrumented(asked, made, 0.0 * error, block=BLOCK)
    assert one.ratio == pytest.approx(1.0, abs=1e-12)
    assert one.half_width < 1e-6
