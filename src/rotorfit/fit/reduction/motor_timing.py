"""The timing of the motors: lag, delay, and how far they are identifiable."""

from __future__ import annotations

import math
from dataclasses import field, replace
from typing import TYPE_CHECKING, Final

from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rotorfit.estimation.factors import Factors

LAG_PRIOR: Final = (0.035, 0.03)
"""Mean and deviation of a motor's time constant before the flight [s]."""

SUM_FAULT: Final = 1e-4
SPLIT_FAULT: Final = 3e-4
"""Deviations that no curvature shows [s], of a delay or of lag plus delay, and of their split: drag
without a velocity, and motors that are no first-order lag."""


DELAYING: Final = ("motor_delay", "motor_lag")
"""Times that delay slow motion, the plainer one first."""
LARGEST_SKEW: Final = 0.8
"""Largest share by which rising is faster and falling slower than their mean, or vice versa."""


@frozen_dataclass
class FreeTiming:
    """Times that a fit may move, from where its signals were made.

    - `at`: lag and delay with which the signals were made.
    - `names`: of ``motor_delay``, ``motor_lag`` and ``motor_skew`` (lag (1 - s) up and (1 + s)
      down).
    - `lag_prior`: mean and standard deviation of the lag before the flight [s].
    - `force_std`: standard deviation before the flight of how much later than turns the forces of
      each flight come [s]; None: they come with them.
    """

    at: MotorResponse
    names: tuple[str, ...]
    lag_prior: tuple[float, float] = LAG_PRIOR
    force_std: float | None = None

    @property
    def delay_slope(self) -> int | None:
        """Place of the slopes by a delay, or by a lag, which delays slow motion; None without."""
        places = [self.names.index(name) for name in DELAYING if name in self.names]
        return places[0] if places else None

    def moved(self, by: Mapping[str, float]) -> MotorResponse:
        """Move each of the times by so much."""
        lag = max(self.at.mean_lag + by.get("motor_lag", 0.0), 0.0)
        skew = skew_of(self.at) + by.get("motor_skew", 0.0)
        skew = min(max(skew, -LARGEST_SKEW), LARGEST_SKEW)
        delay = self.at.delay + by.get("motor_delay", 0.0)
        if skew == 0.0:
            return MotorResponse(lag=lag, delay=delay)
        return MotorResponse(lag=lag * (1.0 - skew), delay=delay, lag_down=lag * (1.0 + skew))

    def without_times(self, values: Mapping[str, float]) -> dict[str, float]:
        """Select a fit's values but for the times, at which its signals are made again."""
        return {name: value for name, value in values.items() if name not in self.names}

    def faults(self) -> list[dict[str, float]]:
        """List common errors of the times that no curvature shows."""
        if "motor_lag" not in self.names:
            return [{"motor_delay": SUM_FAULT}]
        if "motor_delay" not in self.names:
            return [{"motor_lag": SUM_FAULT}]
        split = {"motor_lag": SPLIT_FAULT, "motor_delay": -SPLIT_FAULT}
        return [split, {"motor_lag": 0.0, "motor_delay": SUM_FAULT}]

    def prior(self, forces: Sequence[str] = ()) -> dict[str, tuple[float, float]]:
        """Return mean and deviation of how far each may move; `forces`: delays of the forces."""
        mean, std = self.lag_prior
        known = {"motor_lag": (mean - self.at.mean_lag, std)}
        own = {name: value for name, value in known.items() if name in self.names}
        return own if self.force_std is None else own | dict.fromkeys(forces, (0.0, self.force_std))


def skew_of(response: MotorResponse) -> float:
    """Compute the share by which rising is faster and falling slower than their mean."""
    if response.lag_down is None or response.mean_lag == 0.0:
        return 0.0
    return response.lag_down / response.mean_lag - 1.0


@frozen_dataclass
class TimedBands:
    """Band factors that a timing was found with: they serve the next fit of the same flights.

    - `at`: lag and delay with which the signals were made, within a little of those found.
    - `made_of`: vehicle, flights and whatever else the signals were made of.
    - `factors`: one per configuration.
    """

    at: MotorResponse
    inputs: tuple[object, ...]
    factors: tuple[Factors, ...]

    def matches(self, inputs: tuple[object, ...]) -> bool:
        """Return whether the factors were made of these very objects."""
        return all(own is other for own, other in zip(self.inputs, inputs, strict=True))


@frozen_dataclass
class MotorTiming:
    """The motors' timing by the flights.

    - `response`: lag and delay, found or given [s].
    - `lag_std`, `delay_std`: their standard deviations [s]; None for what was given or has no
      meaning.
    - `total_std`: standard deviation of lag plus delay [s].
    - `free`: which times a fit finds again together with everything else (`FreeTiming.names`): the
      identifiable ones.
    - `log_likelihood`: of its fit, to compare it with others of the same flights.
    - `reached`: where the other parameters of its fit ended: the next one begins there.
    - `bands`: what that fit was made to.
    """

    response: MotorResponse
    total_std: float
    lag_std: float | None = None
    delay_std: float | None = None
    free: tuple[str, ...] = ()
    log_likelihood: float = -math.inf
    reached: Mapping[str, float] | None = None
    bands: TimedBands | None = field(default=None, repr=False, compare=False)

    @property
    def identifiable(self) -> bool:
        """Whether lag plus delay is known better than by its own size, or by motors' usual lag."""
        return is_time_identifiable(self.response.mean_lag + self.response.delay, self.total_std)

    @property
    def without_biases(self) -> dict[str, float] | None:
        """Where its fit ended, without the accelerometer's biases."""
        if self.reached is None:
            return None
        # A wrong law, or tilted axes, end in a bias of some m/s^2. A fit with the right ones that
        # begins there stays there, with thrust and inertia a third too small.
        return {n: value for n, value in self.reached.items() if not n.startswith("accel_bias")}

    def frees(self, names: Sequence[str]) -> bool:
        """Return whether it has all of these times, or the delay of motors without lag."""
        if set(names) <= set(self.free):
            return True
        no_lag = self.lag_std is not None and self.response.mean_lag == 0.0
        return self.free == ("motor_delay",) and no_lag and "motor_lag" in names

    def widened(self, *, lag: float = 0.0, delay: float = 0.0, total: float = 0.0) -> MotorTiming:
        """Return it with further deviations of its times, and of their sum [s]."""
        return replace(
            self,
            lag_std=None if self.lag_std is None else math.hypot(self.lag_std, lag),
            delay_std=None if self.delay_std is None else math.hypot(self.delay_std, delay),
            total_std=math.hypot(self.total_std, total),
        )

    def with_lag_of(self, before: MotorTiming) -> MotorTiming:
        """Return it with the lag's deviation of another one, where its delay alone is free."""
        if self.lag_std is not None or before.lag_std is None:
            return self
        return self.with_lag_std(before.lag_std)

    def with_lag_std(self, lag_std: float) -> MotorTiming:
        """Return it with a lag that was held in the fit of its delay, and known to a deviation [s].

        The delay is what is left of their sum.
        """
        delay_std = None if self.delay_std is None else max(self.delay_std, lag_std)
        return replace(self, lag_std=lag_std, delay_std=delay_std)


def is_time_identifiable(value: float, std: float) -> bool:
    """Return whether a time is better known than its own size, or motors' usual lag [s]."""
    return 1.96 * std <= max(abs(value), LAG_PRIOR[0])
