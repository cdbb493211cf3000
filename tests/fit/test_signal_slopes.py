"""Signals that a fit moves: to first order as they would be made anew."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

import made_fit
from rotorfit.estimation.banded_equations import evaluated
from rotorfit.estimation.factors import Factors, of_even_rows, stack_factors, triangular_factors
from rotorfit.fit.fit_flights import longer_arms
from rotorfit.fit.joint.joint_problem import joint_problem
from rotorfit.fit.reduction.frequency_bands import prepared_bands
from rotorfit.fit.reduction.motor_timing import FreeTiming, MotorTiming
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.flight.flight_data import Segment
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import rotor_columns

RATE = 200.0
AT = MotorResponse(lag=0.04, delay=0.01)
SKEWED = MotorResponse(lag=0.03, delay=0.01, lag_down=0.05)
LARGE = {"motor_lag": 6e-3, "motor_delay": 6e-3, "motor_skew": 0.1}


def slow_noise(rng, *shape, top=2.0):
    b, a = signal.butter(4, top / (RATE / 2))
    return np.asarray(signal.filtfilt(b, a, rng.normal(size=shape), axis=0)) * 5.0


def moving(seed, *, differentiation="central"):
    """A flight of 20 s that turns, its four rotors at speeds of their own."""
    rng = np.random.default_rng(seed)
    n = round(20.0 * RATE)
    flight = made_fit.prepared(rate=RATE, segments=(Segment(start=100, stop=n - 100),))
    data = replace(
        flight.data,
        specific_force=slow_noise(rng, n, 3) + np.array([0.0, 0.0, 9.8]),
        angular_velocity=slow_noise(rng, n, 3),
        angular_acceleration=slow_noise(rng, n, 3),
        differentiation=differentiation,
    )
    speed = 500.0 + 60.0 * slow_noise(rng, n, 4)
    return replace(flight, data=data, motor_channel=speed)


def gram(rows):
    return np.einsum("bmi,bmj->bij", rows, rows)


def left(flight, free, by):
    """Return what moved rows leave of the change that making the signals anew makes."""
    factors = prepared_bands(flight, made_fit.QUAD, free.at, free=free)
    moved = factors.moved(np.array([by.get(name, 0.0) for name in free.names]))
    anew = prepared_bands(flight, made_fit.QUAD, free.moved(by))
    squares = np.einsum("bii->bi", gram(anew.R)).sum(axis=0)
    scale = np.where(squares > 0.0, np.sqrt(squares), 1.0)

    def size(G):
        return np.linalg.norm(G.sum(axis=0) / np.outer(scale, scale))

    away = size(gram(moved) - gram(anew.R))
    return float(away), float(size(gram(factors.R) - gram(anew.R)))


@pytest.mark.parametrize(
    ("name", "at", "differentiation"),
    [
        *((name, AT, way) for name in ("motor_lag", "motor_delay") for way in ("central", "exact")),
        *((name, SKEWED, "central") for name in LARGE),
        ("motor_skew", AT, "central"),
    ],
)
def test_moved_rows_equal_recomputed_signals_to_second_order(name, at, differentiation):
    """Half of the move leaves a quarter of the error."""
    flight = moving(3, differentiation=differentiation)
    free = FreeTiming(at=at, names=(name,))
    large, change = left(flight, free, {name: LARGE[name]})
    small, _ = left(flight, free, {name: 0.5 * LARGE[name]})
    assert large < 0.15 * change
    assert 3.0 < large / small < 5.0


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 1000),
    share=st.tuples(*[st.floats(-1.0, 1.0)] * 2).filter(lambda s: max(map(abs, s)) > 0.2),
)
def test_both_times_move_together(seed, share):
    free = FreeTiming(at=AT, names=("motor_delay", "motor_lag"))
    by = {"motor_lag": 2e-3 * share[0], "motor_delay": 2e-3 * share[1]}
    away, _ = left(moving(seed), free, by)
    assert away < 4e-3  # 2 ms of each change it by up to 0.05


def test_rows_that_do_not_move_are_those_without_slopes():
    flight = moving(1)
    free = FreeTiming(at=AT, names=("motor_lag", "motor_delay"))
    with_slopes = prepared_bands(flight, made_fit.QUAD, AT, free=free)
    without = prepared_bands(flight, made_fit.QUAD, AT)
    assert without.slopes is None
    assert without.moved(np.zeros(0)) is without.R
    at_rest = with_slopes.moved(np.zeros(2))
    np.testing.assert_allclose(with_slopes.R, without.R, atol=1e-6 * np.abs(without.R).max())
    np.testing.assert_array_equal(at_rest[:, : with_slopes.R.shape[1]], with_slopes.R)
    assert not at_rest[:, with_slopes.R.shape[1] :].any()
    still = np.delete(
        np.arange(with_slopes.R.shape[2]), rotor_columns(regressor(made_fit.QUAD).layout)
    )
    assert not with_slopes.slopes[..., still].any()


BOTH = ("motor_lag", "motor_delay")
ELSEWHERE = MotorResponse(lag=0.0402, delay=0.0101)


@dataclass(frozen=True, kw_only=True)
class CountedFlights(TimedDataset):
    """Flights that note the timing wherever signals are made anew."""

    made: list = field(default_factory=list)

    @property
    def timed_lines(self):
        self.made.append(self.timing)
        return TimedDataset.timed_lines.func(self)


def counted_flights():
    return made_fit.as_kind(CountedFlights, made_fit.dataset(moving(2)))


def test_bands_of_the_timing_serve_the_same_flights_alone():
    whole = counted_flights().at(AT, BOTH)
    timing = MotorTiming(response=ELSEWHERE, total_std=1e-3, free=BOTH, bands=whole.found_with())
    found = replace(whole, motor_timing=timing)
    assert found.timing == ELSEWHERE and found.free_timing.at == AT
    assert found.timed_bands is whole.timed_bands and whole.made == [AT]
    for other in (
        replace(found, vehicle=longer_arms(made_fit.QUAD, 0.01)),
        replace(found, configurations=(replace(found.configurations[0]),)),
    ):
        assert other.free_timing.at == ELSEWHERE
        assert other.timed_bands is not whole.timed_bands
    assert whole.made == [AT, ELSEWHERE, ELSEWHERE]


def with_slopes(rng, blocks):
    """Factors of rows Z, with the slopes that Z has, by one factor of both side by side."""
    Z, D = rng.normal(size=(blocks, 50, 4)), rng.normal(size=(blocks, 50, 2))
    R = triangular_factors(np.concatenate([Z, D], axis=2))
    slopes = np.zeros((blocks, 1, 6, 4))
    slopes[:, 0, :, [1, 3]] = R[:, :, 4:].transpose(2, 0, 1)
    factors = Factors(
        R=R[:, :4, :4],
        rows=np.full(blocks, 50),
        segment=np.zeros(blocks, dtype=np.int64),
        band=np.tile([0.0, 1.0], (blocks, 1)),
        slopes=slopes,
    )
    return factors, Z, D


@given(seed=st.integers(0, 1000), by=st.floats(-2.0, 2.0))
def test_moved_factors_hold_the_gram_matrix_of_moved_rows(seed, by):
    factors, Z, D = with_slopes(np.random.default_rng(seed), 3)
    Z[:, :, [1, 3]] += by * D
    np.testing.assert_allclose(gram(factors.moved(np.array([by]))), gram(Z), atol=1e-9)


def test_slopes_go_with_their_blocks():
    rng = np.random.default_rng(0)
    one, other = with_slopes(rng, 3)[0], with_slopes(rng, 2)[0]
    both = stack_factors([one, other])
    np.testing.assert_array_equal(both.slopes, np.concatenate([one.slopes, other.slopes]))
    kept = both.select(np.array([False, True, False, False, True]))
    np.testing.assert_array_equal(kept.slopes, both.slopes[[1, 4]])
    assert stack_factors([one, replace(other, slopes=None)]).slopes is None


def test_configurations_of_fewer_rows_are_filled_up(rows=5):
    """Of a log at 10 Hz a block has few lines, and its slopes need no more rows than those."""
    rng = np.random.default_rng(0)
    whole = with_slopes(rng, 3)[0]
    short = replace(whole, slopes=np.ascontiguousarray(whole.slopes[:, :, :rows]))
    even = of_even_rows([whole, short])
    assert even[0] is whole
    assert even[1].slopes.shape == whole.slopes.shape
    np.testing.assert_array_equal(even[1].gram, short.gram)
    plain = replace(whole, slopes=None)
    assert of_even_rows([plain, short])[0] is plain


def test_configurations_of_few_rows_are_evaluated_jointly():
    width = len(regressor(made_fit.QUAD).layout)
    free = FreeTiming(at=AT, names=("motor_delay",))

    def body(name, rows):
        slopes = np.zeros((12, 1, rows, width))
        slopes[:, 0, width - 1, 4] = 1.0
        factors = replace(made_fit.blocks([(1.0, 2.0)] * 12), slopes=slopes)
        return made_fit.configuration(name, factors=factors, timing=free)

    bodies = [body("A", width + 3), body("B", width)]
    problem = joint_problem(bodies)
    phi = np.array([made_fit.BODY.get(n.partition("@")[0], 0.0) for n in problem.map.names])
    error = evaluated(problem, phi).residual
    assert error.shape[:2] == (24, width + 3)
    np.testing.assert_array_equal(error[12:], error[:12])
