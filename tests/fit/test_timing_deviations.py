"""The deviations of the motors' timing, from costs whose curvature is known."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.fit import timing_search
from rotorfit.fit.flights import Flown
from rotorfit.fit.motor_timing import MotorTiming, told
from rotorfit.fit.timing_search import (
    _find_delay,
    _find_lag,
    _hold_fault,
    _no_wider,
    _penalised,
    _pull,
    _untold,
    _with_deviations,
    _with_skew,
)
from rotorfit.flight.motors import MotorResponse

MS = 1e-3
COMMANDED = MotorsEntry(speed="commanded")
BOTTOM = np.array([0.040, 0.010])
COVARIANCE = MS**2 * np.array([[16.0, -6.0], [-6.0, 9.0]])
"""Of lag and delay: 4 and 3 ms, and 13 ms^2 of their sum."""
INFORMATION = np.linalg.inv(COVARIANCE)


def bowl(bottom):
    def cost(point):
        away = np.asarray(point)[:2] - bottom
        return 7.0 + 0.5 * float(away @ INFORMATION @ away)

    return cost


def deviations(*, delay_free=True, pull=0.0, hold=0.0, apart=0.0, cost=None):
    """Return the timing found from 1 ms beside the bottom, the slow bands' being `apart` off."""
    off = np.array([0.0, 1.0] if delay_free else [1.0, 0.0]) * MS
    shift = off / MS * apart
    return _with_deviations(
        cost or bowl(BOTTOM),
        cost or bowl(BOTTOM + shift),
        BOTTOM + off,
        delay_free=delay_free,
        pull=pull,
        hold=hold,
    )


def norm(*parts):
    return MS * np.sqrt(np.sum(np.square(parts)))


@pytest.mark.parametrize(
    ("pull", "sum_fault", "split_fault"), [(0.0, 1, 5), (3.0, 3, 5), (7, 7, 7)]
)
def test_lag_and_delay_have_the_deviations_of_their_curvature_and_their_faults(
    pull, sum_fault, split_fault
):
    """1 ms of the sum and 5 ms of the split that no curvature shows, or what gusts pull by."""
    found = deviations(pull=pull * MS, hold=1.5 * MS, apart=2.0 * MS)
    assert found.lag_std == pytest.approx(norm(4, 2, split_fault), rel=1e-6)
    assert found.delay_std == pytest.approx(norm(3, 2, split_fault, 1.5), rel=1e-6)
    assert found.total_std == pytest.approx(norm(13**0.5, 2, sum_fault, 1.5), rel=1e-6)
    assert (found.response.lag, found.response.delay) == pytest.approx(BOTTOM)


def test_a_lag_alone_has_the_faults_of_the_sum():
    own = 1.0 / np.sqrt(INFORMATION[0, 0]) / MS
    found = deviations(delay_free=False, pull=2.0 * MS, hold=1.5 * MS, apart=3.0 * MS)
    assert found.lag_std == found.total_std == pytest.approx(norm(own, 3, 2, 1.5), rel=1e-6)
    assert found.delay_std is None
    assert deviations(delay_free=False).total_std == pytest.approx(norm(own, 1), rel=1e-6)
    assert found.response.lag == pytest.approx(BOTTOM[0])


def test_a_lag_that_nothing_tells_is_as_unsure_as_the_longest_one():
    found = deviations(delay_free=False, cost=lambda point: 3.0)
    assert found.lag_std == pytest.approx(norm(200, 1), rel=1e-9)


def given(monkeypatch, *, counted, slow, pull=0.0, hold=0.0, std=2.0):
    """Let the cost of a delay be least at `counted`, that of the pilot's band alone at `slow`."""

    def cost(flown, response, which):
        bottom = slow if which is None else counted
        return 0.5 * ((response.delay - bottom * MS) / (std * MS)) ** 2

    # What stands for the bands at a timing is the timing itself.
    monkeypatch.setattr(Flown, "bands", lambda self, response: response)
    monkeypatch.setattr(timing_search, "_cost_of_bands", cost)
    monkeypatch.setattr(timing_search, "_counted", lambda flown, response: ())
    monkeypatch.setattr(timing_search, "_pull", lambda *_: pull * MS)
    monkeypatch.setattr(timing_search, "_hold_fault", lambda _: hold * MS)


@pytest.mark.parametrize(("pull", "fault"), [(0.0, 1.0), (0.5, 1.0), (4.0, 4.0)])
def test_a_delay_has_its_curvature_its_fault_and_what_slow_bands_say_otherwise(
    monkeypatch, pull, fault
):
    given(monkeypatch, counted=3.0, slow=4.5, pull=pull, hold=2.5)
    found = _find_delay(made_fit.flown(made_fit.prepared()))
    assert found.response.delay == pytest.approx(3.0 * MS, rel=1e-4)
    assert found.delay_std == found.total_std == pytest.approx(norm(2, 1.5, fault, 2.5), rel=1e-4)


def test_a_delay_that_nothing_tells_is_as_unsure_as_the_search_is_wide(monkeypatch):
    """From -12 to 12 ms; a cost that is all but flat."""
    given(monkeypatch, counted=0.0, slow=0.0, std=1e4)
    found = _find_delay(made_fit.flown(made_fit.prepared()))
    assert found.delay_std == pytest.approx(norm(24, 1), rel=1e-3)


@pytest.mark.parametrize(
    ("ratios", "expected"),
    [
        ([[1.0, 3.0, 2.0]], 0.05),
        ([[1.0, 3.0, 2.0], [9.0, 5.0, 6.0]], 0.15 / 9),
        ([[0.01] * 3], 1.5),
    ],
)
def test_an_answer_to_gusts_moves_a_delay_by_150_ms_over_rho(monkeypatch, ratios, expected):
    """Of the turn and the configuration that are flown most; not beyond a rho of 0.1."""
    factors = made_fit.blocks([(1.0, 2.0)])
    whole = made_fit.flown(made_fit.prepared())
    whole = replace(whole, configurations=whole.configurations * len(ratios))
    told_ratios = iter(ratios)
    monkeypatch.setattr(Flown, "bands", lambda self, response: (factors,) * len(ratios))
    monkeypatch.setattr(timing_search, "turn_ratios", lambda *_, mass: np.array(next(told_ratios)))
    counted = (np.ones((1, 3), dtype=bool),) * len(ratios)
    assert _pull(whole, MotorResponse(), counted) == pytest.approx(expected)


def test_a_turn_that_is_flown_above_the_pilots_band_is_not_pulled(monkeypatch):
    factors = made_fit.blocks([(1.0, 2.0), (3.0, 4.0)])
    monkeypatch.setattr(Flown, "bands", lambda self, response: (factors,))
    monkeypatch.setattr(timing_search, "turn_ratios", lambda *_, mass: np.ones(3))
    counted = np.array([[True] * 3, [False, False, True]])
    assert _pull(made_fit.flown(made_fit.prepared()), MotorResponse(), (counted,)) == 0.0
    counted[1] = False
    assert _pull(made_fit.flown(made_fit.prepared()), MotorResponse(), (counted,)) == 0.15


def test_how_long_a_command_held_is_unknown_by_a_quarter_of_the_slowest_logs_sample():
    flights = made_fit.prepared(motor_rate=100.0), made_fit.prepared(motor_rate=50.0)
    assert _hold_fault(made_fit.flown(*flights, motors=COMMANDED)) == pytest.approx(0.005)
    assert _hold_fault(made_fit.flown(*flights)) == 0.0


def test_a_lag_of_35_ms_give_or_take_30_is_usual(monkeypatch):
    monkeypatch.setattr(timing_search, "_cost", lambda *_: 0.0)
    cost = _penalised(made_fit.flown(made_fit.prepared(), motors=COMMANDED), None)
    assert cost(np.array([0.035, 0.02])) == pytest.approx(0.0, abs=1e-12)
    assert cost(np.array([0.065, 0.0])) == pytest.approx(0.5)
    assert cost(np.array([0.005, 0.0])) == pytest.approx(0.5)
    bench = MotorsEntry(speed="commanded", lag=0.05, lag_std=0.002)
    cost = _penalised(made_fit.flown(made_fit.prepared(), motors=bench), None)
    assert cost(np.array([0.054, 0.0])) == pytest.approx(2.0)


def test_untold_motors_have_the_usual_lag_and_30_ms_of_delay():
    flown = made_fit.flown(made_fit.prepared(), motors=COMMANDED)
    both = _untold(flown, delay_free=True)
    assert (both.lag_std, both.delay_std) == (0.03, 0.03)
    assert both.total_std == pytest.approx(0.03 * 2**0.5)
    lag = _untold(flown, delay_free=False)
    assert (lag.lag_std, lag.delay_std, lag.total_std) == (0.03, None, 0.03)
    assert both.response == MotorResponse(lag=0.035)


def test_a_skew_gains_what_its_parabola_falls_by():
    """A cost of 1/2 k (s - s0)^2 falls by 1/2 k s0^2 from no skew to the best one."""

    def cost(point):
        return 5.0 + 0.5 * 200.0 * (point[2] - 0.3) ** 2

    place = np.array([0.04, 0.01, 0.0])
    found, gain = _with_skew(cost, place, cost(place))
    assert found[2] == pytest.approx(0.3)
    assert gain == pytest.approx(9.0)


def searched(monkeypatch, *, gain, pull=1.0):
    """Search where a skew of 0.3 gains so much, the rest being a bowl of 1 ms."""

    def cost(flown, response, counted):
        down = response.lag if response.lag_down is None else response.lag_down
        lag, skew = response.mean_lag, (down - response.lag) / max(down + response.lag, 1e-9)
        bent = gain / 0.3**2 * (skew - 0.3) ** 2
        away = np.array([lag, response.delay]) - BOTTOM
        return bent + 0.5 * float(away @ away) / MS**2

    monkeypatch.setattr(timing_search, "_cost", cost)
    monkeypatch.setattr(timing_search, "_counted", lambda *_: ())
    monkeypatch.setattr(timing_search, "_counted_at_any", lambda *_: (np.ones((1, 3), dtype=bool),))
    monkeypatch.setattr(timing_search, "_pull", lambda *_: pull * MS)
    return _find_lag(made_fit.flown(made_fit.prepared(), motors=COMMANDED), delay_free=True)


@pytest.mark.parametrize(("gain", "skewed"), [(9.0, False), (11.0, True)])
def test_rising_and_falling_lags_are_told_apart_from_a_gain_of_10(monkeypatch, gain, skewed):
    found = searched(monkeypatch, gain=gain)
    assert (found.response.lag_down is not None) is skewed
    assert found.response.mean_lag == pytest.approx(BOTTOM[0], abs=2 * MS)


@pytest.mark.parametrize(("pull", "std"), [(29.0, 0.029), (31.0, 0.03)])
def test_from_a_pull_of_30_ms_the_flights_tell_nothing_of_the_lag(monkeypatch, pull, std):
    found = searched(monkeypatch, gain=0.0, pull=pull)
    assert found.lag_std == pytest.approx(std, rel=0.01)
    assert (found.response.delay == 0.0) is (pull > 30.0)


def timing(lag_std, delay_std, total_std):
    return MotorTiming(
        response=MotorResponse(lag=0.04, delay=0.01),
        lag_std=lag_std,
        delay_std=delay_std,
        total_std=total_std,
    )


def test_no_lag_is_less_sure_than_it_was_beforehand():
    sure = timing(0.02, 0.02, 0.001)
    assert _no_wider(sure, 0.03) is sure
    narrowed = _no_wider(timing(0.05, 0.05, 0.004), 0.03)
    assert narrowed.lag_std == 0.03
    assert narrowed.delay_std == pytest.approx(np.hypot(0.004, 0.03))
    assert narrowed.total_std == 0.004
    assert _no_wider(timing(0.05, 0.01, 0.004), 0.03).delay_std == 0.01
    alone = _no_wider(timing(0.05, None, 0.05), 0.03)
    assert (alone.lag_std, alone.delay_std, alone.total_std) == (0.03, None, 0.03)


@pytest.mark.parametrize(
    ("value", "std", "known"),
    [
        (0.010, 0.0178, True),  # 1.96 of them are 34.9 ms: under the usual 35
        (0.010, 0.0180, False),
        (-0.100, 0.0510, True),
        (0.100, 0.0511, False),
    ],
)
def test_a_time_is_told_where_half_of_its_interval_is_under_its_size_or_35_ms(value, std, known):
    assert told(value, std) is known
