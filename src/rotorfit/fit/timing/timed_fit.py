"""A fit of flights that moves their motors' times, and what it says of these times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.fit.reduction.motor_timing import LARGEST_SKEW, SUM_FAULT, FreeTiming, skew_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.motors.motor_model import MotorResponse

LONGEST_MOVE: Final = 0.02
"""Longest move of a time in one round [s], within which its slope holds."""
MOST_OF_A_LAG: Final = 0.75
"""Largest share by which a lag falls in one round: without any lag, its slope says nothing of
longer ones."""
NEAR: Final = 0.3
"""Deviations by which the last round may still move a time, by the slopes of its signals. On a
flight whose rising and falling lags differ such a step was off by a quarter in the signals, so that
made anew they would move the time by about a tenth of its deviation."""
ENOUGH: Final[Mapping[str, float]] = {
    "motor_delay": 0.1 * SUM_FAULT,
    "motor_lag": 0.1 * SUM_FAULT,
    "motor_skew": 1e-3,
}
"""Or so much of it [s, s, share], which no flight shows: simulators do, to microseconds."""
LEAST_GAIN: Final = 10.0
"""Gain of log-likelihood for which rising and falling speed get a lag each, or thrust has it."""
LEAST_LAG: Final = 1e-3
"""Least lag of rotors whose rising and falling may differ [s]."""


class TimedFit(NamedTuple):
    """Flights with their signals made at a timing, and the fit of them that moves its times."""

    dataset: TimedDataset
    estimate: BandedEstimate
    configurations: Sequence[JointConfiguration] = ()

    @property
    def free(self) -> FreeTiming:
        """The times that the fit moves, and where the signals are made."""
        free = self.dataset.free_timing
        assert free is not None
        return free

    @property
    def values(self) -> Mapping[str, float]:
        """The other parameters, by name: where a fit at another timing begins."""
        return self.free.without_times(self.estimate.estimate.by_name)

    @property
    def ended(self) -> MotorResponse:
        """The timing where the fit ends, at most as far as the signals' slopes hold."""
        return self.moved({name: self.estimate.estimate.value(name) for name in self.free.names})

    def moved(self, by: Mapping[str, float]) -> MotorResponse:
        """Move the times in a direction, as far as the signals' slopes hold."""
        at = self.free.at
        reach = {name: LARGEST_SKEW if name == "motor_skew" else LONGEST_MOVE for name in by}
        if by.get("motor_lag", 0.0) < 0.0 and at.mean_lag > LEAST_LAG:
            reach["motor_lag"] = min(LONGEST_MOVE, MOST_OF_A_LAG * at.mean_lag)
        share = min(reach[name] / max(abs(value), reach[name]) for name, value in by.items())
        return self.free.moved({name: share * value for name, value in by.items()})

    @property
    def is_near(self) -> bool:
        """Whether the fit moves no time by more than a little of its deviation."""
        free, found = self.free, self.estimate.estimate
        at = [found.names.index(name) for name in free.names]
        enough = np.maximum(NEAR * found.std[at], [ENOUGH[name] for name in free.names])
        return bool((np.abs(found.values[at]) <= enough).all())

    @property
    def is_lagless(self) -> bool:
        """Whether the lag is free, and too short to separate from a delay."""
        return "motor_lag" in self.free.names and self.free.at.mean_lag < LEAST_LAG

    @property
    def loses_the_motion(self) -> bool:
        """Whether the fit takes the delay for a lag that hardly is: both are free."""
        return self.is_lagless and "motor_delay" in self.free.names

    @property
    def shows_skew(self) -> bool:
        """Whether the fit would lose `LEAST_GAIN` without the skew (Wald's test)."""
        found = self.estimate.estimate
        place = found.names.index("motor_skew")
        skew = skew_of(self.free.at) + float(found.values[place])
        return 0.5 * (skew / float(found.std[place])) ** 2 > LEAST_GAIN

    @property
    def exceeds_slopes(self) -> bool:
        """Whether a fit that has ended moved, or would move, beyond where its slopes hold."""
        free = self.free
        times = [name for name in free.names if name != "motor_skew"]
        still = any(abs(self.estimate.estimate.value(name)) > LONGEST_MOVE for name in times)
        return still or free.at.mean_lag < LEAST_LAG or abs(skew_of(free.at)) >= LARGEST_SKEW
