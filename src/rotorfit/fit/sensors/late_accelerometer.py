r"""Take off the lateness of an accelerometer that neither its noise nor its motion has shown.

Thrust shows in the accelerometer when the rotors' differences show in the gyro
(`force_delay.py`). A force that comes later by more than chance and gusts has passed a low-pass.
The timing of the motors is that of forces and turns together: with a late force the rotors seem to
come early, and J_r makes up for it in yaw. One of second order at cut-off :math:`f_c` delays slow
motion by :math:`\sqrt 2 / (2 \pi f_c)`; with that one taken off, the flights are fitted again,
until forces and turns agree. A low-pass is no delay, and a long delay is more than its slope: from
the second fit on, the delay is where a straight line through the last two would end.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.reduction.bandwidth import Bandwidth
from rotorfit.fit.sensors.force_delay import force_delays, times_of
from rotorfit.fit.sensors.lateness import Lateness, of_one_vehicle
from rotorfit.fit.timing.sensor_bandwidth import with_force_in_time
from rotorfit.fit.timing.timing_faults import SLOW_DELAY
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset

FILTERED_SHARE: Final = 0.1
"""Share of accelerometers behind a low-pass that neither the log nor the flight has named."""
DOUBTED_SHARE: Final = 0.25
"""Share of low-passes that noise or motion have named whose delay is another."""
USUAL_FILTER_DELAY: Final = 0.01
"""Mean delay of these [s]: that of 22 Hz, as autopilots have 10 to 40."""
IN_TIME: Final = 0.3
"""Deviations of what may be left."""
MOST_FITS: Final = 4
"""Further fits at most."""
SURE: Final = 0.75
"""Share of the stated deviation that a delay is off: .75 (rms) of the delays of 58 random worlds
with a low-pass."""
LEAST_SLOPE: Final = 0.25
"""Share at least by which a delay taken off shortens the lateness that a fit leaves."""
DELAYS: Final = np.arange(0.001, 0.1, 0.001)
"""Delays that are taken off [s]."""
SAME: Final = 1e-3
"""Share by which a delay that is taken off again differs at most."""


class _Round(NamedTuple):
    """A fit, and of each flight the delay taken off its forces [s] and the lateness left.

    - `numbers`: of the fit with those left.
    """

    fit: Fit
    delays: Sequence[float]
    left: Sequence[Lateness | None]
    numbers: Mapping[str, float]

    def odds(self, k: int) -> float:
        """Compute the logarithm of the odds that a flight's forces are late, or made too early."""
        one, delay = self.left[k], self.delays[k]
        if one is None or (one.seconds <= 0.0 and delay == 0.0):
            return -np.inf
        return log_odds_of_delay(one, DOUBTED_SHARE if delay > 0.0 else FILTERED_SHARE)


@frozen_dataclass
class ForceDelays:
    """Delays that were taken off the accelerometers, and what they leave open.

    - `left`: lateness that is left, of each flight that shows one.
    - `shifts`: of the numbers and the motors' times, by name: with delays longer by their
      deviation, or, where none was taken off, with one by its chance.
    """

    left: tuple[tuple[LoadedFlight, Lateness], ...]
    shifts: Mapping[str, float]


def fit_with_force_in_time(fit: Fit, again: Callable[[TimedDataset], Fit]) -> Fit:
    """Fit the flights with forces and turns at one time, where they are certainly not.

    `again`: fits flights whose signals have changed. What was found is recorded (`ForceDelays`).
    """
    if fit.dataset.source != "imu":
        return fit
    rounds = [_round_of(fit)]
    late = _late_flights(rounds[0])
    with suppress(EstimationError, np.linalg.LinAlgError):
        while late and len(rounds) <= MOST_FITS and not _is_in_time(rounds[-1], late):
            found = {k: _next_delay(rounds, k) for k in late}
            if all(np.isclose(found[k][0], rounds[-1].delays[k], rtol=SAME) for k in late):
                break  # they are at an end of `DELAYS`
            low_passes = {k: _low_pass(*one) for k, one in found.items()}
            rounds.append(_round_of(again(with_force_in_time(rounds[-1].fit.dataset, low_passes))))
            # Beside a later one a flight may have seemed in time.
            late = sorted({*late, *_late_flights(rounds[-1])})
    return rounds[-1].fit.with_record(_recorded(rounds, late))


def _round_of(fit: Fit) -> _Round:
    """Measure what a fit leaves of each flight's lateness."""
    found, numbers = force_delays(fit)
    drawn = of_one_vehicle([one for _, one in found])
    by_flight = {id(flight): one for (flight, _), one in zip(found, drawn, strict=True)}
    flights = fit.dataset.flights
    left = [by_flight.get(id(f)) for f in flights]
    return _Round(fit, [_taken_off(f) for f in flights], left, numbers)


def _taken_off(flight: LoadedFlight) -> float:
    """Return the delay of the low-pass that was taken off a flight's forces [s]."""
    low_pass = flight.bandwidths.get("accel")
    return low_pass.slow_delay if low_pass is not None and low_pass.taken_off else 0.0


def _late_flights(found: _Round) -> list[int]:
    """Return which flights' forces are rather late than not, or were made too early."""
    return [k for k in range(len(found.left)) if found.odds(k) > 0.0]


def log_odds_of_delay(late: Lateness, share: float = FILTERED_SHARE) -> float:
    """Compute the logarithm of the odds that a low-pass delays a sensor, by Bayes' theorem.

    `share`: of sensors with such a delay, before the flight.
    """
    prior = -DELAYS / USUAL_FILTER_DELAY
    likelihood = (abs(late.seconds) - 0.5 * DELAYS) * DELAYS / late.std**2
    ratio = np.logaddexp.reduce(prior + likelihood) - np.logaddexp.reduce(prior)
    return float(ratio + np.log(share / (1.0 - share)))


def _is_in_time(found: _Round, late: Sequence[int]) -> bool:
    """Return whether a fit leaves no more than a part of a deviation of any lateness."""
    left = [found.left[k] for k in late]
    return all(one is None or abs(one.seconds) <= IN_TIME * one.std for one in left)


def _slope(rounds: Sequence[_Round], k: int) -> float:
    """Return by how much less late a flight is in a fit, over the delay taken off."""
    if len(rounds) < 2:
        return 1.0
    before, last = rounds[-2:]
    one, other = before.left[k], last.left[k]
    if one is None or other is None or np.isclose(last.delays[k], before.delays[k], rtol=SAME):
        return 1.0
    slope = (one.seconds - other.seconds) / (last.delays[k] - before.delays[k])
    return float(np.clip(slope, LEAST_SLOPE, 1.0))


def _next_delay(rounds: Sequence[_Round], k: int) -> tuple[float, float]:
    """Return the delay with which nothing would be left, and its deviation [s]."""
    delay, left, slope = rounds[-1].delays[k], rounds[-1].left[k], _slope(rounds, k)
    if left is None:
        return delay, 0.0
    longer = delay + left.seconds / slope
    return float(np.clip(longer, DELAYS[0], DELAYS[-1])), SURE * left.std / slope


def _low_pass(delay: float, std: float) -> Bandwidth:
    """Return the low-pass of second order with a delay [s] that is known so well."""
    low, high = np.clip([delay + 1.96 * std, delay - 1.96 * std], DELAYS[0], DELAYS[-1])
    return Bandwidth(
        shape="second order",
        cutoff=SLOW_DELAY / delay,
        interval=(SLOW_DELAY / float(low), SLOW_DELAY / float(high)),
        delay=0.0,
        gain=0.5 * (delay / std) ** 2 if std > 0.0 else 0.0,
    )


def _recorded(rounds: Sequence[_Round], late: Sequence[int]) -> ForceDelays:
    """Record what is left, and how far the numbers may be off by a delay."""
    last = rounds[-1]
    flights = zip(last.fit.dataset.flights, last.left, strict=True)
    left = tuple((flight, one) for flight, one in flights if one is not None)
    shifts = _shifts_if_late(last) if len(rounds) < 2 else _shifts_if_later(rounds, late)
    # A fit that runs away leaves some that are no numbers.
    finite = {name: shift for name, shift in shifts.items() if np.isfinite(shift)}
    return ForceDelays(left=left, shifts=finite)


def _shifts_if_late(found: _Round) -> dict[str, float]:
    """Return the deviations of the numbers by a delay that is likelier not there."""
    # Of one that is there with a probability p, by a shift s, the variance is p s^2.
    odds = max((found.odds(k) for k in range(len(found.left))), default=-np.inf)
    share, moved = float(np.exp(-0.5 * np.logaddexp(0.0, -odds))), found.numbers
    own = _numbers_of(found.fit)
    return {name: share * abs(moved[name] - own[name]) for name in own if name in moved}


def _shifts_if_later(rounds: Sequence[_Round], late: Sequence[int]) -> dict[str, float]:
    """Return the shifts of the numbers with delays that are longer by their deviation."""
    before, last = rounds[-2:]
    # The numbers have moved with all delays at once: of a flight that was in time before, a share
    # of its own would say nothing.
    step = np.linalg.norm([last.delays[k] - before.delays[k] for k in late])
    share = float(np.linalg.norm([_next_delay(rounds, k)[1] for k in late]) / step)
    was, now = _numbers_of(before.fit), _numbers_of(last.fit)
    return {name: share * abs(now[name] - was[name]) for name in now if name in was}


def _numbers_of(fit: Fit) -> dict[str, float]:
    """Return the numbers of a fit by their names, and the motors' free times."""
    timing = fit.configurations[0].timing
    times = {} if timing is None else times_of(timing, fit.estimate.estimate.by_name)
    return dict(zip(fit.numbers.names, fit.numbers.values.tolist(), strict=True)) | times


def allow_for_force_delays(fit: Fit) -> Fit:
    """Append the shift of the numbers, and the motors' times, with the accelerometers' delays."""
    found = fit.record_of(ForceDelays)
    if found is None or not found.shifts:
        return fit
    half = 1.96 * np.array([found.shifts.get(name, 0.0) for name in fit.numbers.names])
    term = IntervalTerm(
        name="late accelerometer",
        half_width=half,
        source="the time at which forces and turns agree",
    )
    timing = fit.dataset.motor_timing
    if timing is not None:
        names = ("motor_lag", "motor_delay", "motor_lag_total")
        lag, delay, total = (found.shifts.get(name, 0.0) for name in names)
        fit = fit.with_timing(timing.widened(lag=lag, delay=delay, total=total))
    return fit.with_terms(term)
