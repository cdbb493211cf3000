"""Check that motors and gyro keep one clock throughout a flight.

A log merged of two recorders has two clocks, which run apart by some parts in a thousand, or jump.
The delay of the turns after the rotors' torque then changes along the flight, which that of one
clock does not; lag and delay of a whole flight are only the mean of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.findings import Evidence, doubt_or_passed
from rotorfit.flight.signals import running_mean
from rotorfit.model.parameters import INERTIA, MOTOR_TIMES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float, Int

    from rotorfit.findings import Finding
    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

MOST_PARTS: Final = 12
FEWEST_PARTS: Final = 6
LEAST_PART: Final = 2.0
"""Length of a part in which a delay shows [s]."""
LOWEST, HIGHEST = 1.0, 12.0
"""Band of the turns that rotors make [Hz]: below it gusts, above it noise and vibration."""
SMOOTHED: Final = 2.0
"""Width over which a spectrum is averaged [Hz]."""
LONGEST_DELAY: Final = 0.5
STEP: Final = 0.002
"""Delays that are tried [s]: of twelve parts of a minute whose clocks differ by 1 %, all."""
LEAST_SCORE: Final = 4.5
"""Deviations from chance from which a part shows its delay: the best of all that are tried has two
or three by chance."""
LEAST_TORQUE: Final = 0.15
"""Size of the torques of a part over the upper quartile of all, from which it counts: in a calm one
the rotors answer the gyro's noise, and the delay is that of the autopilot."""
LEAST_CHANGE: Final = 0.015
"""Least change that is said [s]: with other motion the delay of one clock changes by up to 10 ms,
since a motor's lag delays quick motion less than slow."""
CERTAIN: Final = 10.0
"""Deviations, by the parts' scatter, from which it surely changed: of six parts that scatter by as
much as half of that change chance makes one in five hundred look so."""
LEAST_SCATTER: Final = 0.0005
"""Least deviation of the delay of a part [s]."""
ONE_CLOCK: Final = "log motors and gyro by one clock"


class PartDelays(NamedTuple):
    """How much later than the rotors' torque the vehicle turns, in parts of a flight.

    - `middle`: of each part, since the first sample [s].
    - `delay`: of its turns [s].
    """

    middle: Float[np.ndarray, " p"]
    delay: Float[np.ndarray, " p"]


class DelayChange(NamedTuple):
    """A change of that delay along a flight.

    - `seconds`: from the first part to the last, or across the jump.
    - `std`: its deviation, by the parts' scatter [s].
    - `jump`: when it jumped, since the first sample [s]; None: it changed evenly.
    - `rate`: seconds per second, where it changed evenly.
    """

    seconds: float
    std: float
    jump: float | None
    rate: float

    @property
    def is_sure(self) -> bool:
        """Whether neither chance nor other motion makes it."""
        return abs(self.seconds) > max(LEAST_CHANGE, CERTAIN * self.std)


def clock_drift(fit: Fit) -> Iterator[Finding]:
    """Check that the turns follow the motors by the same delay from first to last."""
    for flight in fit.dataset.flights:
        change = delay_change(part_delays(flight.prepared.data, fit.dataset.vehicle))
        if change is None:
            continue
        half = 1.96 * change.std
        evidence = Evidence(
            name="delay_change",
            value=change.seconds,
            interval=(change.seconds - half, change.seconds + half),
            limit=LEAST_CHANGE,
        )
        yield doubt_or_passed(
            "clock-drift",
            _describe_change(flight, change) if change.is_sure else None,
            numbers=("kd", "Jr", *MOTOR_TIMES, "motor_lag_total", *INERTIA),
            flights=(flight.entry.written,),
            doubtful_because="motors and gyro do not keep one clock",
            next_step=ONE_CLOCK,
            evidence=(evidence,),
        )


def _describe_change(flight: LoadedFlight, change: DelayChange) -> str:
    """Explain that the delay of the turns changed, and what to do."""
    name, size = Path(flight.entry.file).name, f"{1e3 * abs(change.seconds):.0f} ms"
    way = "later" if change.seconds > 0.0 else "sooner"
    if change.jump is None:
        return (
            f"{name}: the vehicle follows its motors {size} {way} at the end of the flight than at "
            "its beginning: their clock and that of the gyro run apart; "
            f"{ONE_CLOCK}, or multiply the motors' times by {1.0 + change.rate:.5f}"
        )
    return (
        f"{name}: from about {change.jump:.0f} s on the vehicle follows its motors {size} {way} "
        f"than before: the clock of motors or gyro jumped; {ONE_CLOCK}, or identify the part "
        "before or after that (start and end)"
    )


def part_delays(data: FlightData, vehicle: Vehicle) -> PartDelays:
    """Measure the delay of roll and pitch after the rotors' torque in each lively part."""
    torque = data.rotor_speed**2 @ vehicle.levers[:, :2]
    turn = data.angular_acceleration[:, :2]
    shown = [
        (float(data.time[rows].mean() - data.time[0]), one)
        for rows in _split_parts(data)
        if (one := _measure_delay(torque[rows], turn[rows], data.sample_rate)) is not None
    ]
    usual = np.quantile([one.torque for _, one in shown] or [0.0], 0.75)
    lively = [(t, one.delay) for t, one in shown if one.torque >= LEAST_TORQUE * usual]
    middle, delay = np.array(lively).reshape(-1, 2).T
    return PartDelays(middle, delay)


def _split_parts(data: FlightData) -> Iterator[Int[np.ndarray, " r"]]:
    """Yield the rows of the parts of a flight; of a part over a gap the longer side."""
    rows, least = data.used_rows, LEAST_PART * data.sample_rate
    for part in np.array_split(rows, min(max(int(len(rows) / least), 1), MOST_PARTS)):
        own = max(np.split(part, np.flatnonzero(np.diff(part) > 1) + 1), key=len)
        if len(own) > 0.5 * least:
            yield own


class _ShownDelay(NamedTuple):
    """The delay of a part [s], and the size of its torques in the band."""

    delay: float
    torque: float


def _measure_delay(
    cause: Float[np.ndarray, "n 2"], effect: Float[np.ndarray, "n 2"], sample_rate: float
) -> _ShownDelay | None:
    """Measure the delay at which an effect follows its cause; None if it hardly does.

    By the likelihood of a delay where all that an effect has is noise of its own spectrum.
    """
    window = np.hanning(len(cause))[:, None]
    frequency = np.fft.rfftfreq(len(cause), 1.0 / sample_rate)
    band = (frequency >= LOWEST) & (frequency <= min(HIGHEST, 0.4 * sample_rate))
    lines = max(int(SMOOTHED * len(cause) / sample_rate), 1)
    of_cause, of_effect = (
        np.fft.rfft((one - one.mean(axis=0)) * window, axis=0)[band] for one in (cause, effect)
    )
    power = running_mean(np.abs(of_effect) ** 2, lines).clip(min=np.finfo(float).tiny)
    cross = (of_cause.conj() * of_effect / power).sum(axis=1)
    by_chance = np.sqrt(0.5 * float((np.abs(of_cause) ** 2 / power).sum()))
    delays = np.arange(-LONGEST_DELAY, LONGEST_DELAY, STEP)
    by_delay = np.real(np.exp(2j * np.pi * np.outer(delays, frequency[band])) @ cross)
    i = int(np.argmax(by_delay))
    if by_delay[i] < LEAST_SCORE * by_chance or not 0 < i < len(delays) - 1:
        return None
    before, at, after = by_delay[i - 1 : i + 2].tolist()
    return _ShownDelay(
        delay=float(delays[i]) + STEP * 0.5 * (before - after) / (before - 2.0 * at + after),
        torque=float(np.linalg.norm(of_cause)) / len(cause) ** 0.5,
    )


def delay_change(parts: PartDelays) -> DelayChange | None:
    """Fit an even change, and a jump, to the delays; return what leaves less, None of few parts.

    By medians, so that a part that shows a wrong delay moves neither.
    """
    t, delay = parts
    if len(t) < FEWEST_PARTS:
        return None
    i, j = np.triu_indices(len(t), 1)
    rate = float(np.median((delay[j] - delay[i]) / (t[j] - t[i])))
    scatter = _scatter_of(delay - rate * t)
    spread = np.sqrt(((t - t.mean()) ** 2).sum())
    duration = float(t[-1] - t[0])
    found, least = DelayChange(rate * duration, scatter * duration / spread, None, rate), scatter
    for k in range(2, len(t) - 1):
        first, second = delay[:k], delay[k:]
        levels = float(np.median(first)), float(np.median(second))
        scatter = _scatter_of(np.concatenate([first - levels[0], second - levels[1]]))
        if scatter < least:
            std = scatter * np.sqrt(1.0 / k + 1.0 / (len(t) - k))
            moment = 0.5 * float(t[k - 1] + t[k])
            found, least = DelayChange(levels[1] - levels[0], float(std), moment, 0.0), scatter
    return found


def _scatter_of(values: Float[np.ndarray, " p"]) -> float:
    """Estimate the deviation of values by how far they are from their median on the average."""
    size = float(np.abs(values - np.median(values)).mean())
    return max(np.sqrt(0.5 * np.pi) * size, LEAST_SCATTER)


CHECKS: Final = (clock_drift,)
