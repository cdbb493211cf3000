"""Whether the motors' lag acts on their speed, as in any motor, or on their thrust.

Simulators low-pass the command itself, which is thrust there. A lag of the speed then seems longer
for falling speed than for rising, and inertia comes out a few percent too large. Where nobody says
what the lag acts on, the flights decide between the two by the likelihood; thrust that rises and
falls at different rates, too, is that of motors, whose lag is of neither.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rotorfit.errors import EstimationError
from rotorfit.fit.dataset.dataset import with_motor_settings, with_prepared
from rotorfit.fit.reduction.motor_timing import skew_of
from rotorfit.fit.timing.timed_fit import LEAST_GAIN
from rotorfit.fit.timing.timing_fit import find_timing, fit_at
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.terms.registry import DEFAULT_TERMS

if TYPE_CHECKING:
    from rotorfit.fit.timing.timed_dataset import TimedDataset


def with_likelier_lag(dataset: TimedDataset) -> TimedDataset:
    """Let the motors' lag act on their thrust where the flights show it and nobody says else.

    Returns the flights with the timing of such motors, or as they are.
    """
    found = dataset.motor_timing
    if found is None or not _may_act_on_thrust(dataset):
        return dataset
    other = _acting_on_thrust(dataset)
    alike = MotorResponse(lag=found.response.mean_lag, delay=found.response.delay)
    try:
        first = fit_at(other.at(alike, found.free), DEFAULT_TERMS, guess=found.without_biases)
        if first.shows_skew or first.estimate.log_likelihood < found.log_likelihood + LEAST_GAIN:
            return dataset
        free = tuple(name for name in found.free if name != "motor_skew")
        timing = find_timing(other, near=replace(found, response=alike, free=free))
    except EstimationError:
        return dataset
    if timing is None or timing.response.two_way:
        return dataset
    gain = timing.log_likelihood - found.log_likelihood
    return dataset if gain < LEAST_GAIN else replace(other, motor_timing=timing, lag_gain=gain)


def _may_act_on_thrust(dataset: TimedDataset) -> bool:
    """Return whether a lag of the speed seems longer for falling speed, as one of the thrust does.

    In motion that is too small to show the difference none seems so, and none matters.
    """
    timing = dataset.motor_timing
    if timing is None or "motor_skew" not in timing.free or dataset.motors.lag_on is not None:
        return False
    return skew_of(timing.response) > 0.0


def _acting_on_thrust(dataset: TimedDataset) -> TimedDataset:
    """Return the flights with a lag of the motors' thrust, not timed yet."""
    dataset = replace(dataset, motor_timing=None)
    dataset = with_prepared(
        dataset, lambda prepared: replace(prepared, data=replace(prepared.data, lag_on="thrust"))
    )
    return with_motor_settings(dataset, lag_on="thrust")
