"""k_t of changes of thrust and of the weight: their mean, and what is said where they differ."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.checks.motors.motor_law import open_law
from rotorfit.checks.thrust_against_weight import agreement
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.weight_balance import Held, held_up, pooled, turning
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.motors.commanded_speeds import inertia_widths
from rotorfit.fit.weight.kt_from_weight import (
    bias_at_rest,
    kt_from_weight,
    pooled_weight,
    thrust_shares,
    velocity_std_of,
)
from rotorfit.fit.weight.weigh_thrust import Balance, with_open_share
from rotorfit.flight.flight_data import Segment

COMMANDED = MotorsEntry(speed="commanded")

G = 9.80665
MASS = 1.4
KT = MASS * G / (4 * 500.0**2)
"""Of four rotors at 500 rad/s."""


def weighed(*flights):
    flown = made_fit.dataset(*flights, mass=MASS)
    return kt_from_weight(flown.configurations, flown.vehicle)


def test_two_hovers_are_as_sure_as_both_together():
    one = weighed(made_fit.prepared(seconds=8.0))
    two = weighed(made_fit.prepared(seconds=8.0), made_fit.prepared(seconds=8.0))
    assert one.value == pytest.approx(KT)
    assert two.std == pytest.approx(one.std / 2**0.5)
    assert weighed(made_fit.prepared(seconds=1.0)) is None


def test_flights_that_differ_widen_the_weight():
    """Two of 1 % and of 2 % that are 22 % apart count alike, and their mean is 11 % open."""
    found = pooled_weight(
        [Held(ratio=0.9, std=0.009, seconds=9.0), Held(ratio=1.1, std=0.022, seconds=9.0)]
    )
    assert found.value == pytest.approx((0.9 * 1.1) ** 0.5, rel=2e-3)
    assert found.share == pytest.approx(0.5 * np.log(1.1 / 0.9), rel=0.02)


def test_a_stretch_near_zero_does_not_pull_the_weight():
    """By their absolute deviations all three would count alike, and give two thirds."""
    sound = [Held(ratio=1.0, std=0.02, seconds=9.0), Held(ratio=1.01, std=0.02, seconds=9.0)]
    wild = Held(ratio=0.01, std=0.02, seconds=3.0)
    found = pooled_weight([*sound, wild])
    assert found.value == pytest.approx(1.005, rel=0.02)


def test_flights_that_agree_count_by_their_variances():
    found = pooled_weight(
        [Held(ratio=1.0, std=0.01, seconds=9.0), Held(ratio=1.01, std=0.0202, seconds=9.0)]
    )
    assert found.value == pytest.approx(1.01**0.2)
    assert found.share == pytest.approx(0.01 * 0.8**0.5)


def unlike(half_width):
    """Rotors 2 % above and below their mean, in turn, each known to a half-width."""
    return Numbers(
        names=("kt", "kt_1", "kt_2", "kt_3", "kt_4"),
        values=KT * np.array([1.0, 1.02, 0.98, 1.02, 0.98]),
        terms=made_fit.known_to(KT * np.full(5, half_width)),
        correlation=np.eye(5),
        excitation={},
    )


@pytest.mark.parametrize(("half_width", "each"), [(0.0196, 0.01), (5.0, 0.04)])
def test_rotors_that_carry_more_count_more(half_width, each):
    """Squares of 1.2 and 0.8 of their mean: .4 % more than equal rotors would lift.

    Where the flights tell nothing of single rotors, each is within 4 % all the same.
    """
    load = np.array([1.2, 0.8, 1.2, 0.8])
    flight = made_fit.prepared(seconds=8.0)
    speed = np.tile(500.0 * np.sqrt(load), (800, 1))
    flown = made_fit.dataset(replace(flight, data=replace(flight.data, rotor_speed=speed)))
    alike = kt_from_weight(flown.configurations, flown.vehicle)
    shares = thrust_shares(unlike(half_width), flown.vehicle)
    found = kt_from_weight(flown.configurations, flown.vehicle, shares=shares)
    assert found.value == pytest.approx(alike.value / 1.004, rel=1e-9)
    # Half of the weight on either pair: 0.1 of the difference between the pairs' means.
    own = found.value * 0.1 * each
    assert found.std == pytest.approx(np.hypot(alike.std, own), rel=1e-2)


def test_rest_shows_the_bias():
    """0.3 m/s^2 at rest, of which a fifth is taken off by what accelerometers usually have."""
    force = np.tile([0.0, 0.0, G], (2000, 1))
    force[:500, 2] += 0.3
    flight = made_fit.prepared(force=force, segments=(Segment(start=700, stop=2000),)).data
    flight.rotor_speed[:500] = 0.0
    found = bias_at_rest(flight)
    assert found.value == pytest.approx(0.3 * 0.2**2 / (0.1**2 + 0.2**2))
    assert found.std == pytest.approx((0.1**-2 + 0.2**-2) ** -0.5)
    in_the_air = made_fit.prepared(force=force).data
    assert bias_at_rest(in_the_air) == Measured(value=0.0, std=0.2)


def balance(changes, std, *, weight=(1.0, 0.01)):
    return Balance(
        changes=Measured(value=changes, std=std),
        weight=Measured(value=weight[0], std=weight[1]),
    )


def test_a_velocity_by_positions_is_less_sure_than_by_cameras():
    data = made_fit.prepared(seconds=1.0).data
    moving = np.zeros((len(data.time), 3))
    logged, by_positions = replace(data, velocity=moving), replace(data, carried=moving)
    assert velocity_std_of(logged, estimated=False) < velocity_std_of(by_positions, estimated=False)
    assert velocity_std_of(by_positions, estimated=True) < velocity_std_of(logged, estimated=True)


def test_kt_is_the_mean_by_variances():
    found = balance(1.005, 0.01005).kt
    assert found.value == pytest.approx(1.005**0.5)
    assert found.share == pytest.approx(0.01 / 2**0.5)


def test_a_difference_scales_the_interval():
    """The mean of two equals is as open as half their difference; from doubt on it reaches both."""
    small, large = balance(1.02, 0.0102).kt, balance(1.06, 0.0106).kt
    assert small.value == pytest.approx(1.02**0.5)
    assert small.share == pytest.approx(0.5 * np.log(1.02))
    assert large.value == pytest.approx(1.06**0.5)
    assert large.share == pytest.approx(np.hypot(0.5, 0.5 / 1.96) * np.log(1.06))


def test_nothing_jumps_as_the_difference_grows():
    many = [balance(c, 0.02).kt for c in np.linspace(0.8, 1.2, 401)]
    for numbers in ([m.value for m in many], [m.std for m in many]):
        assert np.abs(np.diff(numbers)).max() < 2e-3


def test_without_changes_the_weight_alone_counts():
    alone = Balance(changes=None, weight=Measured(value=2.0, std=0.1))
    assert alone.kt == alone.weight
    assert alone.deviations == 0.0


def inertia(half_width):
    return Numbers(
        names=("Ixx@A", "Iyy@A", "kd"),
        values=np.ones(3),
        terms=made_fit.known_to(np.array([half_width, 0.9, 0.9])),
        correlation=np.eye(3),
        excitation={},
    )


def test_no_flying_sharpens_inertia_that_the_law_leaves_open(assert_text, assert_wording):
    [found] = open_law(inertia_widths(inertia(0.22)), 0.2)
    assert found.numbers == ("Ixx@A",)  # of Iyy the flight itself leaves more open
    assert_wording(found.next_step)
    assert_text(found.useless_because)
    assert not list(open_law(inertia_widths(inertia(0.3)), 0.0))
    [wide] = open_law(inertia_widths(inertia(0.9)), 0.4)
    assert wide.numbers == ("Ixx@A", "Iyy@A")  # weak by the law alone


def test_what_is_open_of_a_laws_slope_is_in_changes():
    changes = with_open_share(Measured(value=2.0, std=0.06), 0.04)
    assert (changes.value, changes.std) == (2.0, pytest.approx(0.1))


@pytest.mark.parametrize(("changes", "doubted"), [(1.025, False), (0.95, False), (0.93, True)])
def test_what_chance_may_do_is_no_doubt(changes, doubted):
    """A hundredth of sound flights is 2.58 deviations apart: 5.8 % of 2 and 1 %."""
    said = agreement(balance(changes, 0.02), MotorsEntry(speed="measured"))
    assert (said.severity == "doubt") is doubted
    assert said.diagnostics["thrust_over_weight"] == pytest.approx(changes)
    assert bool(said.sentence) is doubted


@pytest.mark.parametrize(("changes", "std"), [(0.03, 0.01), (0.4, 0.02), (-0.1, 0.02)])
def test_a_contradiction_makes_all_thrust_doubtful(changes, std, assert_text):
    """As of a low-passed accelerometer: k_t is that of the weight, and nothing of it is sure."""
    both = balance(changes, std)
    said = agreement(both, MotorsEntry(speed="measured"))
    assert both.kt.value == pytest.approx(1.0)
    assert_text(said.doubtful_because)
    assert {"kt", "kd", "Ixx", "Iyy_com"} <= set(said.numbers)
    assert "doubtful" in said.sentence
    sure = agreement(balance(0.93, 0.02), MotorsEntry(speed="measured"))
    assert sure.severity == "doubt" and sure.doubtful_because is None


def held(data_seconds, *windows, force=None):
    flight = made_fit.prepared(
        seconds=data_seconds,
        force=force,
        segments=tuple(Segment(start=int(100 * a), stop=int(100 * b)) for a, b in windows),
    )
    return held_up(turning(flight.data), flight.data.specific_force)


def test_velocity_cancels_between_adjacent_windows():
    """One change of velocity over 30 s; with a gap in between two, whose squares add."""
    assert held(30.0, (0, 30)).std == pytest.approx(1.5 / 30.0 / G)
    assert held(40.0, (0, 15), (25, 40)).std == pytest.approx(1.5 * 2**0.5 / 30.0 / G)
    assert held(40.0, (0, 5), (10, 15), (20, 25)).std == pytest.approx(1.5 * 3**0.5 / 15.0 / G)
    assert held(30.0, (0, 30)).ratio == pytest.approx(1.0)


def test_a_stretch_of_less_than_two_seconds_shows_nothing():
    assert held(5.0, (0, 1.9)) is None
    assert held(5.0, (0, 2.1)).seconds == pytest.approx(2.1)


def test_directions_are_averaged_up_to_ten_seconds_then_lengths():
    """g along z for a while, then along x: as of a gyro that lost its way."""
    for turn, ratio in ((5.0, 0.5**0.5), (10.0, 1.0)):
        force = np.zeros((round(200 * turn), 3))
        force[: round(100 * turn), 2] = force[round(100 * turn) :, 0] = G
        assert held(2 * turn, (0, 2 * turn), force=force).ratio == pytest.approx(ratio)


def test_parts_are_pooled_by_the_inverse_of_their_variance():
    both = pooled([Held(ratio=1.0, std=0.3, seconds=4.0), Held(ratio=2.0, std=0.4, seconds=8.0)])
    assert both.ratio == pytest.approx((16 * 1.0 + 9 * 2.0) / 25)
    assert both.std == pytest.approx(0.24)  # 3 and 4 make 12/5
    assert both.seconds == 12.0
