"""What other settings shift is in the intervals: twice its rms, group by group."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit import fit_flights
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.fit_flights import longer_arms, moved_imu, other_geometries, setting_terms
from rotorfit.fit.intervals.interval_terms import combined_half_width
from rotorfit.fit.reduction.frequency_bands import LEAST_RATIO
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.terms.rotors import IMU_MOUNTING, MOUNTING_STD

RATE = 100.0
AT = MotorResponse(lag=0.04, delay=0.01)


def timing(total_std, *, lag_std=None, delay_std=None):
    return MotorTiming(response=AT, total_std=total_std, lag_std=lag_std, delay_std=delay_std)


def flown(found=None, *, arm_std=0.0, imu_std=0.0):
    vehicle = replace(made_fit.QUAD, arm_std=arm_std, imu_position_std=imu_std)
    return made_fit.dataset(
        made_fit.prepared(rate=RATE),
        vehicle=vehicle,
        motors=MotorsEntry(speed="commanded"),
        motor_timing=found,
    )


def trials(whole, shifts, *, timed=False):
    """Return the half-width from 10, and the trials, each shifting as `shifts` says, in order."""
    seen = []

    def shift(other, top):
        seen.append((other, top))
        return np.array([shifts[len(seen) - 1]])

    terms = (*made_fit.known_to([10.0]), *setting_terms(whole, shift, timed=timed))
    (half,) = combined_half_width(terms, 1)
    assert len(seen) == len(shifts)
    return float(half), seen


def responses(seen):
    return [other.motor_timing.response for other, _ in seen]


def test_half_the_frequency_range_is_tried_with_double_weight():
    whole = flown()
    half, seen = trials(whole, [3.0])
    assert half == pytest.approx(np.sqrt(10.0**2 + 6.0**2))
    assert seen == [(whole, 15.0)]


@pytest.mark.parametrize(("total_std", "step"), [(0.001, 0.005), (0.007, 0.007)])
def test_motor_delay_is_tried_off_by_half_a_sample_or_deviation(total_std, step):
    """Both ways; of the two shifts, which are one group, the root of the mean square."""
    half, seen = trials(flown(timing(total_std)), [3.0, 4.0, -6.0])
    assert half == pytest.approx(np.sqrt(100.0 + 4.0 * (9.0 + (16.0 + 36.0) / 2.0)))
    tried = [(response.lag, response.delay) for response in responses(seen[1:])]
    assert np.array(tried) == pytest.approx(np.array([[0.04, 0.01 - step], [0.04, 0.01 + step]]))
    assert [top for _, top in seen[1:]] == [np.inf, np.inf]


def test_lag_is_tried_as_delay_by_a_deviation_of_the_split():
    found = timing(0.001, lag_std=0.006, delay_std=0.007)
    half, seen = trials(flown(found), [0.0, 0.0, 0.0, 5.0])
    assert half == pytest.approx(np.sqrt(100.0 + 4.0 * 25.0))
    split = responses(seen)[3]
    assert (split.lag, split.delay, seen[3][1]) == pytest.approx((0.046, 0.004, np.inf))
    trials(flown(timing(0.001, lag_std=0.006)), [0.0] * 3)


def test_a_timing_that_the_fit_moves_itself_is_not_tried_again():
    """What it leaves open is in the covariance already: the bands alone are tried."""
    found = timing(0.007, lag_std=0.006, delay_std=0.007)
    half, seen = trials(flown(found), [3.0], timed=True)
    assert half == pytest.approx(np.sqrt(10.0**2 + 6.0**2))
    assert seen[0][1] == 15.0


def test_the_signals_of_another_timing_are_fitted_as_they_stand():
    """A trial that could move its own timing would move back."""
    found = replace(timing(0.007), free=("motor_delay",))
    _, seen = trials(flown(found), [0.0] * 3)
    assert seen[0][0].free_timing is not None
    assert all(other.free_timing is None for other, _ in seen[1:])


def test_each_measured_length_is_tried_off_by_its_deviation():
    whole = flown(arm_std=0.005, imu_std=0.002)
    half, seen = trials(whole, [1.0, 2.0, 3.0, 4.0, 5.0])
    assert half == pytest.approx(np.sqrt(100.0 + 4.0 * (1.0 + 4.0 + 9.0 + 16.0 + 25.0)))
    assert [top for _, top in seen[1:]] == [np.inf] * 4
    arms, *imus = (other.vehicle for other, _ in seen[1:])
    assert arms.arm == pytest.approx(0.255)
    assert np.array([v.imu_position for v in imus]) == pytest.approx(0.002 * np.eye(3))
    for other, _ in seen[1:]:  # the equations go with the geometry
        assert not np.array_equal(other.model.tensor, whole.model.tensor)


def test_lengths_without_a_deviation_are_taken_for_exact():
    assert other_geometries(flown()) == {}


def test_arms_grow_and_imus_move_by_the_length_that_is_given():
    longer = longer_arms(made_fit.QUAD, 0.01)
    assert longer.arm == pytest.approx(0.26)
    assert longer.positions[0, :2] == pytest.approx(np.full(2, 0.26 / 2**0.5))
    moved = moved_imu(replace(made_fit.QUAD, imu_position=(0.1, 0.2, 0.3)), 1, 0.004)
    assert moved.imu_position == pytest.approx((0.1, 0.204, 0.3))


def test_the_line_between_counted_bands_is_tried_elsewhere(monkeypatch):
    """At half and at twice the ratio: twice the rms of both shifts; many flights show it alone."""
    asked = []

    def shifted(fit, dataset, *, top=np.inf, least_ratio=LEAST_RATIO):
        asked.append((top, least_ratio))
        return np.array([{0.5: 3.0, 2.0: -4.0}.get(least_ratio / LEAST_RATIO, 0.0)])

    monkeypatch.setattr(fit_flights, "shift_of", shifted)
    numbers = made_fit.no_numbers("kt", values=[1.0], half_width=[10.0])
    found = fit_flights.allow_for_settings(made_fit.fit(flown(), numbers))
    assert found.numbers.half_width[0] == pytest.approx(np.sqrt(100.0 + 4.0 * (9.0 + 16.0) / 2.0))
    assert asked == [(15.0, LEAST_RATIO), *((np.inf, f * LEAST_RATIO) for f in (0.5, 2.0))]
    five = made_fit.configuration(
        factors=made_fit.blocks([(1.0, 2.0)] * 5, source=np.arange(5)),
    )
    found = fit_flights.allow_for_settings(made_fit.fit(flown(), numbers, bodies=[five]))
    assert found.numbers.half_width[0] == 10.0


def test_a_mounting_known_less_well_than_usual_is_a_term(monkeypatch):
    """Its centre is tried off by what is beyond the usual deviation: 4, where 5 is told from 3."""
    asked, shifts = [], {"mounting_x": 1.0, "mounting_y": 2.0, "mounting_z": -2.0}

    def shifted(fit, dataset, *, known):
        asked.append(known)
        return np.array([shifts[list(known)[-1]]])

    monkeypatch.setattr(fit_flights, "shift_of", shifted)
    numbers = made_fit.no_numbers("kt", values=[1.0], half_width=[10.0])
    estimate = made_fit.fit_of([made_fit.configuration()], std={}, terms=[IMU_MOUNTING.name])
    fit = replace(made_fit.fit(flown(), numbers, estimate=estimate), known={"kt": (1.0, 0.1)})
    term = fit_flights.mounting_term(fit, 5.0 / 3.0 * MOUNTING_STD)
    assert term.half_width == pytest.approx([1.96 * 3.0])
    assert asked[0] == {
        "kt": (1.0, 0.1),
        "mounting_x": (pytest.approx(4.0 / 3.0 * MOUNTING_STD), MOUNTING_STD),
    }
    assert len(asked) == 3
    assert not fit_flights.mounting_term(fit, MOUNTING_STD).half_width.any()
    assert len(asked) == 3
