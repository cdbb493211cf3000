"""The thrust coefficient that carries the weight, and how sure it is: hovers by hand."""

import numpy as np
import pytest

import made_fit
from rotorfit.dataset.weight_balance import Held, held_up, pooled, turning
from rotorfit.diagnostics.kt_from_weight import WeighedThrust, absorbed_weight, kt_from_weight
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.preprocessing.flight_data import Segment

G = 9.80665
MASS = 1.4
KT = MASS * G / (4 * 500.0**2)
"""Of four rotors at 500 rad/s."""


def weighed(*flights):
    flown = made_fit.dataset(*flights, mass=MASS)
    return kt_from_weight(flown.configurations, flown.vehicle)


@pytest.mark.parametrize("seconds", [4.0, 8.0])
def test_hover_gives_kt_up_to_a_possible_gain_of_velocity(seconds):
    """1.5 m/s in the time over g, and 2 % by which a propeller in motion differs."""
    found = weighed(made_fit.prepared(seconds=seconds))
    assert found.kt == pytest.approx(KT, rel=1e-9)
    assert found.std / KT == pytest.approx(np.hypot(1.5 / seconds / G, 0.02), rel=1e-9)


def test_two_hovers_are_as_sure_as_both_together():
    found = weighed(made_fit.prepared(seconds=4.0), made_fit.prepared(seconds=4.0))
    assert found.std / KT == pytest.approx(np.hypot(1.5 / 4.0 / G / 2**0.5, 0.02), rel=1e-9)


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


def test_a_stretch_of_less_than_two_seconds_tells_nothing():
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


WEIGHED = WeighedThrust(kt=1.0, std=0.04)


@pytest.mark.parametrize(
    ("kt", "std", "apart"),
    [
        (1.149, 0.03, False),  # three deviations: 0.03 and 0.04 make 0.05
        (1.151, 0.03, True),
        (0.849, 0.03, True),
        (1.119, 0.0, False),
        (1.121, 0.0, True),
    ],
)
def test_chance_is_three_deviations_of_both(kt, std, apart):
    assert WEIGHED.contradicts(kt, std) is apart


@pytest.mark.parametrize(("kt", "apart"), [(1.079, False), (1.081, True), (0.919, True)])
def test_propellers_may_deviate_8_percent_from_the_square_law(kt, apart):
    assert WeighedThrust(kt=1.0, std=0.001).contradicts(kt, 0.001) is apart


@pytest.mark.parametrize(
    ("kt", "std", "timed", "surer"),
    [
        (1.0, 0.126, True, False),  # 1.96 std under a quarter of kt
        (1.0, 0.129, True, True),
        (-2.0, 0.25, True, False),
        (-2.0, 0.26, True, True),
        (1.0, 0.079, False, False),  # not told: twice the weight's own is enough
        (1.0, 0.081, False, True),
    ],
)
def test_the_weight_is_surer_where_thrust_changes_are_uncertain(kt, std, timed, surer):
    assert WEIGHED.is_more_certain_than(kt, std, timed=timed) is surer


def test_the_weight_must_be_twice_as_sure():
    vague = WeighedThrust(kt=1.0, std=0.1)
    assert not vague.is_more_certain_than(1.0, 0.199, timed=True)
    assert vague.is_more_certain_than(1.0, 0.201, timed=True)


def absorbed(bias, half=0.1, *, reads=G, source="imu", name="accel_bias_z@A"):
    """Return what is said of a fitted bias [m/s^2] of 20 s in which the accelerometer reads so."""
    flight = made_fit.prepared(seconds=20.0, force=np.tile([0.0, 0.0, reads], (2000, 1)))
    numbers = Numbers(
        names=(name,),
        values=np.array([bias]),
        half_width=np.array([half]),
        correlation=np.eye(1),
        excitation={},
    )
    return absorbed_weight(made_fit.dataset(flight, mass=MASS, source=source), numbers)


def test_a_bias_that_gravity_contradicts_is_thrust():
    """0.4 m/s^2, or half of its half-width, and 1.96 * 1.5 / 20 of the velocity."""
    for half, limit in ((0.1, 0.4), (1.2, np.hypot(0.6, 1.96 * 1.5 / 20.0))):
        for sign in (1.0, -1.0):
            assert absorbed(sign * (limit - 1e-3), half) is None
            wrong = absorbed(sign * (limit + 1e-3), half)
            assert wrong.fitted == pytest.approx(sign * limit, abs=2e-3)
            assert wrong.read == pytest.approx(0.0, abs=1e-9)


def test_a_bias_that_the_accelerometer_shows_over_gravity_is_one():
    assert absorbed(2.0, reads=G + 2.0) is None
    assert absorbed(0.0, reads=G + 2.0) is not None


def test_cameras_have_no_bias_along_the_vertical():
    assert absorbed(0.39, source="mocap", reads=G + 2.0) is None
    assert absorbed(0.41, source="mocap", reads=G + 2.0).read == 0.0


def test_sideways_a_bias_may_be_a_turned_mounting():
    assert absorbed(3.0, name="accel_bias_x@A") is None
