"""Where two models disagree the intervals hold both; what is open of the weight is in them."""

import dataclasses

import numpy as np
import pytest

import made_fit
from rotorfit.diagnostics import kt_from_weight
from rotorfit.diagnostics.kt_from_weight import WeighedThrust, held_at, kt_of
from rotorfit.fit.fit_flights import widen_to_reach

FLIGHTS = made_fit.dataset(made_fit.prepared())


def fit(values, half_width):
    numbers = made_fit.no_numbers("kt", "kd", values=values, half_width=half_width)
    return made_fit.fit(FLIGHTS, numbers)


ONE, OTHER = fit([10.0, 4.0], [0.5, 3.0]), fit([12.0, 5.0], [0.7, 0.5])


def test_an_interval_reaches_the_far_end_of_the_other_one():
    """From 10 to 12.7 is 2.7; an interval that held the other one already stays."""
    both = widen_to_reach(ONE, OTHER, with_interval=True).numbers
    assert both.values.tolist() == [10.0, 4.0]
    assert both.half_width == pytest.approx([2.7, 3.0])


@pytest.mark.parametrize(
    ("sharp", "vague", "half"), [(ONE, OTHER, [2.0, 3.0]), (OTHER, ONE, [2.0, 1.0])]
)
def test_an_interval_ends_at_the_vaguer_value(sharp, vague, half):
    reached = widen_to_reach(sharp, vague, with_interval=False)
    assert reached.numbers.half_width == pytest.approx(half)


def test_a_deviation_is_half_of_an_interval_over_1_96():
    assert kt_of(fit([10.0, 0.0], [0.98, 1.0]).numbers) == pytest.approx((10.0, 0.5))


@pytest.mark.parametrize("settles", [True, False])
def test_what_is_open_of_the_weight_is_in_every_interval(monkeypatch, settles):
    """Another fit a deviation further: kt by .2 and kd by -1.1, 1.96 times of which is open."""
    tried = []

    def refit(fit, dataset, *, known):
        tried.append(known["kt"])
        return dataclasses.replace(fit, numbers=ONE.numbers)

    def shift(fit, dataset, *, begin, known):
        tried.append((known["kt"], begin["kt"]))
        return np.array([0.2, -1.1]) if settles else -np.array([0.2, -1.1])

    for name, made in (("refit", refit), ("shift_of", shift)):
        monkeypatch.setattr(kt_from_weight, name, made)
    monkeypatch.setattr(kt_from_weight, "widen_by_settings", lambda fit, known: fit)
    held = held_at(ONE, WeighedThrust(kt=10.0, std=0.2))
    # What the flights say of k_t otherwise is in the interval, and not in the fit.
    assert tried == [(10.0, pytest.approx(1e-3)), ((10.2, pytest.approx(1.02e-3)), 10.2)]
    assert held.numbers.values.tolist() == [10.0, 4.0]
    assert held.numbers.half_width == pytest.approx(np.hypot([0.5, 3.0], [1.96 * 0.2, 1.96 * 1.1]))
