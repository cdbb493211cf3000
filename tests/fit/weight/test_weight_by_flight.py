"""k_t of several flights: never less certain than the best of them, unless they contradict."""

import numpy as np
import pytest

from rotorfit.checks.thrust_against_weight import KIND, flights_weigh_alike
from rotorfit.estimation.measured import Measured, mean_scale
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.weight.flight_weights import (
    CHANCE,
    FlightWeight,
    chance_of_difference,
    limit_by_weight,
    limit_shared_error,
    weight_of_flights,
)
from rotorfit.fit.weight.weigh_thrust import Balance

CRAZYFLIES = ((2.009, 0.0043), (2.004, 0.0054), (2.005, 0.0033), (1.983, 0.0015), (1.988, 0.002))
"""k_t [1e-8 N s^2] of five flights of one Crazyflie on two days, and its deviation as a share."""


def flights(*measured):
    return [
        FlightWeight(file=f"log{i}", kt=Measured(value=value, std=share * value))
        for i, (value, share) in enumerate(measured)
    ]


def test_chance_is_uniform_among_sound_flights():
    random = np.random.default_rng(7)
    shares = np.array([0.003, 0.01, 0.004, 0.02])
    found = [
        chance_of_difference(flights(*zip(np.exp(random.normal(0.0, shares)), shares, strict=True)))
        for _ in range(2000)
    ]
    assert np.mean(found) == pytest.approx(0.5, abs=0.03)
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.025)


def test_sound_flights_are_never_wider_than_the_best():
    random = np.random.default_rng(8)
    inside, trials = 0, 1500
    for _ in range(trials):
        shares = random.uniform(0.002, 0.02, random.integers(2, 7))
        own = flights(*zip(np.exp(random.normal(0.0, shares)), shares, strict=True))
        best = min(one.kt.share for one in own)
        # Between flights more is taken to vary than does: the random effect of their mean.
        pooled = mean_scale([one.kt for one in own], spread=0.01)
        found = weight_of_flights(pooled, own)
        alike = chance_of_difference(own) >= CHANCE
        assert (found.share <= best * (1 + 1e-12)) or not alike
        low, high = found.interval
        inside += low <= 1.0 <= high
    assert inside / trials > 0.95


def test_a_poor_second_estimate_does_not_widen_several_flights():
    """Changes of thrust 15 % low to 6.5 %, 2.4 deviations off: by chance, once in sixty flights."""
    own = flights((2.0, 0.004), (2.004, 0.004))
    weight = Measured(value=2.002, std=0.0057)
    kt = Balance(weight=weight, changes=Measured(value=1.71, std=0.111)).kt
    assert kt.share > 2.0 * weight.share
    assert limit_by_weight(kt, weight, own).share == pytest.approx(0.004)
    assert limit_by_weight(kt, weight, own[:1]) == kt


def test_flights_that_contradict_each_other_say_so():
    own = flights(*CRAZYFLIES)
    found = flights_weigh_alike(own)
    assert (found.kind, found.severity, found.numbers) == (KIND, "doubt", ("kt",))
    assert found.flights == ("log3", "log0")
    assert found.diagnostics["kt_between_flights"] == pytest.approx(2.009 / 1.983 - 1.0)
    wide = Measured(value=1.99, std=0.01)
    assert weight_of_flights(wide, own) == wide


def test_flights_that_agree_pass():
    found = flights_weigh_alike(flights((2.0, 0.004), (2.01, 0.004), (1.995, 0.01)))
    assert (found.severity, found.flights) == ("passed", ())
    assert flights_weigh_alike(flights((2.0, 0.004))) is None


@pytest.mark.parametrize(("interval", "covers"), [((1.9, 2.2), True), ((2.01, 2.09), False)])
def test_an_interval_that_leaves_a_flight_out_does_not_cover_it(interval, covers):
    found = flights_weigh_alike(flights((2.0, 0.004), (2.1, 0.004)), interval)
    assert ("the interval of kt covers" in found.sentence) == covers
    assert chance_of_difference(flights((2.0, 0.004))) == 1.0


def numbers(shared):
    term = {"source": "made up"}
    return Numbers(
        names=("kt", "Ixx@A"),
        values=np.array([2.0, 1.0]),
        terms=(
            IntervalTerm(name="noise", half_width=np.array([0.006, 0.1]), **term),
            IntervalTerm(name="shared by all flights", half_width=np.array([shared, 0.2]), **term),
        ),
        correlation=np.eye(2),
        excitation={},
    )


@pytest.mark.parametrize(("shared", "half"), [(0.02, 0.01), (0.004, np.hypot(0.006, 0.004))])
def test_what_all_flights_share_is_in_the_best_of_them(shared, half):
    found = limit_shared_error(numbers(shared), 0.005)
    assert found.number("kt")[1] == pytest.approx(half)
    assert found.number("Ixx@A")[1] == pytest.approx(np.hypot(0.1, 0.2))
