"""Where two models disagree the intervals hold both; by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import made_fit
from rotorfit.dataset.dataset import Dataset
from rotorfit.errors import UnsettledError
from rotorfit.fit.intervals.joint_numbers import Numbers
from rotorfit.fit.intervals.kt_from_weight import WeighedThrust
from rotorfit.identification import estimates
from rotorfit.identification.estimates import (
    _as_sure_as_weight,
    _holding_both,
    _kt_of,
    _reaching,
    joint_fit,
)


def numbers(values, half_width):
    return Numbers(
        names=("kt", "kd"),
        values=np.array(values),
        half_width=np.array(half_width),
        correlation=np.eye(2),
        excitation={},
    )


ONE, OTHER = numbers([10.0, 4.0], [0.5, 3.0]), numbers([12.0, 5.0], [0.7, 0.5])


def test_an_interval_that_holds_both_reaches_to_the_far_end_of_the_other():
    """From 10 to 12.7 is 2.7; an interval that held the other one already stays."""
    both = _holding_both(ONE, OTHER)
    assert both.values.tolist() == [10.0, 4.0]
    assert both.half_width == pytest.approx([2.7, 3.0])


def test_an_interval_that_reaches_ends_at_the_vaguer_value():
    assert _reaching(ONE, OTHER).half_width == pytest.approx([2.0, 3.0])
    assert _reaching(OTHER, ONE).half_width == pytest.approx([2.0, 1.0])


def test_a_deviation_is_half_of_an_interval_over_1_96():
    assert _kt_of(numbers([10.0, 0.0], [0.98, 1.0])) == pytest.approx((10.0, 0.5))


def test_a_weighed_thrust_coefficient_is_held_to_a_ten_thousandth(monkeypatch):
    """What the flights say of it otherwise is in the interval, and not in the fit."""
    held = []

    class Held(Exception):  # noqa: N818
        pass

    def steered(joint, begin, *, commanded, known, terms):
        held.append(known)
        raise Held

    monkeypatch.setattr("rotorfit.fit.joint.joint_fit.select_informative_bands", steered)
    monkeypatch.setattr(Dataset, "timed_bands", (made_fit.blocks([(1.0, 2.0)]),))
    dataset = replace(made_fit.dataset(made_fit.prepared()))
    with pytest.raises(Held):
        joint_fit(dataset, weighed=WeighedThrust(kt=2e-6, std=1e-7), begin={"kt": 2e-6})
    assert held[0]["kt"] == pytest.approx((2e-6, 2e-10))


@pytest.mark.parametrize("settles", [True, False])
def test_what_is_open_of_the_weight_is_in_every_interval(monkeypatch, settles):
    """Another fit a deviation further: kt by .2 and kd by -1.1, 1.96 times of which is open."""
    tried = []

    def joint_fit(dataset, *, weighed, terms, begin):
        tried.append((weighed.kt, begin))
        if not settles:
            raise UnsettledError("no end", reached={"moved": 1.0})
        return SimpleNamespace(estimate=SimpleNamespace(by_name={"moved": 1.0})), []

    monkeypatch.setattr(estimates, "joint_fit", joint_fit)
    monkeypatch.setattr(
        estimates, "_numbers_at", lambda reached, *_: np.array([10.2, 2.9]) * reached["moved"]
    )
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={})
    dataset, weighed = made_fit.dataset(made_fit.prepared()), WeighedThrust(kt=10.0, std=0.2)
    surer = _as_sure_as_weight(dataset, fit, ONE, [body], weighed=weighed, terms=())
    assert tried == [(10.2, {**fit.estimate.by_name, "kt": 10.2})]
    assert surer.values.tolist() == [10.0, 4.0]
    assert surer.half_width == pytest.approx(np.hypot([0.5, 3.0], [1.96 * 0.2, 1.96 * 1.1]))
