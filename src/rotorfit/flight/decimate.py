"""Fewer samples for a fit that looks at slow lines alone, and what is kept of how it was recorded.

Whole flights are decimated: the equations compare a central difference with an average over the
same two samples, of all signals alike.
"""

import dataclasses
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import signal

from rotorfit.flight.data import FlightData, Segment
from rotorfit.flight.motor_columns import MotorModel, clock_jumps, with_motors
from rotorfit.flight.prepare import PreparedFlight
from rotorfit.flight.sensor_limits import CutOff, cut_off
from rotorfit.flight.signals import central_difference, whole_samples

FEWEST_PER_PERIOD: Final = 8.0
"""Samples kept for a period of the fastest line: at that line the average of [1 4 1]/6 is off the
central difference by 0.2 %, at a third of its frequency by 0.003 %."""
FLAT: Final = 4.0 / 3.0
"""Up to so many times that line the filter is flat, and nothing folds back onto it."""
DAMPED: Final = 80.0
"""What would fold back there is damped by [dB]; flat to the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AsRecorded:
    """What of a flight is said of its log, however many samples are kept of it.

    Attributes
    ----------
    sample_rate
        Of the clock of all channels [Hz].
    samples, seconds
        In all airborne stretches.
    spans
        Start and end of every airborne stretch, on the log's own clock [s].
    cut_off
        What the ends of gyro and accelerometer cut off.
    """

    sample_rate: float
    samples: int
    seconds: float
    spans: tuple[tuple[float, float], ...]
    cut_off: Mapping[str, CutOff]


def as_recorded(prepared: PreparedFlight) -> AsRecorded:
    """Return what is said of a flight with every sample that was recorded."""
    data, rows = prepared.data, prepared.data.used_rows
    return AsRecorded(
        sample_rate=data.sample_rate,
        samples=data.samples_used,
        seconds=data.seconds_used,
        spans=tuple(
            (float(data.time[s.start]), float(data.time[s.stop - 1])) for s in data.segments
        ),
        cut_off={
            "gyro": cut_off(data.angular_velocity[rows], "gyro"),
            "accel": cut_off(data.specific_force[rows], "accel"),
        },
    )


def decimated(prepared: PreparedFlight, motors: MotorModel, *, top: float) -> PreparedFlight:
    """Return a flight with as many samples as lines up to `top` [Hz] need; slow logs as they are.

    Signals pass a linear-phase filter without delay, white noise keeps its density, and no sample
    of a segment is made of what is outside of it. A command that was held becomes the mean of
    those that it stands for, which is held as long as all of them.

    Parameters
    ----------
    prepared
        With derivatives that are central differences.
    motors
        By which it was prepared.
    top
        The highest frequency that is looked at.
    """
    data = prepared.data
    step = whole_samples(data.sample_rate / (FEWEST_PER_PERIOD * top))
    if step < 2:
        return prepared
    stretches, smooth = _stretches(data, step), _low_pass(data.sample_rate, step, top)
    before, held = len(smooth) // 2, motors.speed == "commanded"
    mean = np.convolve(smooth, np.ones(step) / step) if held else smooth
    thinned = partial(_filtered, stretches=stretches, weights=smooth, before=before)
    speed = _filtered(prepared.motor_channel, stretches=stretches, weights=mean, before=before)
    gyro, rate = thinned(data.angular_velocity), data.sample_rate / step
    fewer = dataclasses.replace(
        data,
        sample_rate=rate,
        time=np.concatenate([s.times(data) for s in stretches]),
        specific_force=thinned(data.specific_force),
        angular_velocity=gyro,
        angular_acceleration=central_difference(gyro, rate),
        segments=_placed(data.segments, stretches),
        rotor_speed_std=data.rotor_speed_std / float(np.sqrt(step)),
        velocity=None if data.velocity is None else thinned(data.velocity),
        climb=None if data.climb is None else thinned(data.climb[:, None])[:, 0],
        reference=None if data.reference is None else thinned(data.reference),
        held_for=1.0 / data.sample_rate if held else None,
    )
    return dataclasses.replace(
        prepared,
        data=with_motors(fewer, speed, motors.response),
        phases=_placed(prepared.phases, stretches),
        motor_channel=speed,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stretch:
    """Recorded rows `start` to `stop` without a gap in the clock, and which are kept of them.

    `first`: the row that the first kept one becomes, which is before `start`, so that the second
    recorded row has a neighbour; the last is behind `stop` likewise. `borders`: rows between which
    parts are filtered apart.
    """

    start: int
    stop: int
    step: int
    first: int
    borders: tuple[int, ...]

    @property
    def kept(self) -> range:
        """Recorded rows that are kept, the first and the last outside of what was recorded."""
        return range(self.start + 1 - self.step, self.stop - 1 + self.step, self.step)

    def place(self, row: int) -> int:
        """Return what the first kept row from `row` on becomes."""
        return self.first - (self.kept.start - row) // self.step

    def times(self, data: FlightData) -> Float[np.ndarray, " m"]:
        """Return when the kept rows are [s]."""
        return data.time[self.start] + (np.array(self.kept) - self.start) / data.sample_rate


def _stretches(data: FlightData, step: int) -> list[_Stretch]:
    """Return the stretches without a gap in the clock, each segment a part of its own.

    Beside a segment, and the row before and behind it, a gap of one channel may be drawn over.
    """
    borders = [row for s in data.segments for row in (s.start - 1, s.stop + 1)]
    jumps = clock_jumps(data.time, data.sample_rate).tolist()
    found: list[_Stretch] = []
    first = 0
    for a, b in pairwise([0, *jumps, len(data.time)]):
        own = {a, b, *(row for row in borders if a < row < b)}
        found.append(_Stretch(start=a, stop=b, step=step, first=first, borders=tuple(sorted(own))))
        first += len(found[-1].kept)
    return found


@lru_cache(maxsize=8)
def _low_pass(sample_rate: float, step: int, top: float) -> Float[np.ndarray, " t"]:
    """Return an odd number of weights, about the sample in their middle."""
    kept_rate = sample_rate / step
    width = kept_rate - 2.0 * FLAT * top
    count, beta = signal.kaiserord(DAMPED, width / (0.5 * sample_rate))
    return signal.firwin(count | 1, 0.5 * kept_rate, window=("kaiser", beta), fs=sample_rate)


def _filtered(
    values: Float[np.ndarray, "n k"],
    *,
    stretches: Sequence[_Stretch],
    weights: Float[np.ndarray, " t"],
    before: int,
) -> Float[np.ndarray, "m k"]:
    """Return the kept rows of filtered values, every part continued by point reflection.

    `weights`: of consecutive samples, of which so many are `before` the row.
    """
    step = stretches[0].step
    behind = len(weights) - 1 - before
    # With as many zeros that the first sum over samples alone is one of those that are made.
    turned = np.concatenate([np.zeros(-(len(weights) - 1) % step), weights[::-1]])
    skipped = (len(turned) - 1) // step
    parts: list[Float[np.ndarray, "_ k"]] = []
    for stretch in stretches:
        for a, b in pairwise(stretch.borders):
            kept = stretch.kept[
                stretch.place(a) - stretch.first if a > stretch.start else 0 : stretch.place(b)
                - stretch.first
                if b < stretch.stop
                else None
            ]
            ends = ((before + step, behind + step), (0, 0))
            wide = np.pad(values[a:b], ends, mode="reflect", reflect_type="odd")
            made = signal.upfirdn(turned, wide[kept.start - a + step :], down=step, axis=0)
            parts.append(made[skipped : skipped + len(kept)])
    return np.concatenate(parts)


def _placed(parts: Sequence[Segment], stretches: Sequence[_Stretch]) -> tuple[Segment, ...]:
    """Return parts of the recorded rows as parts of the kept ones."""
    starts = [stretch.start for stretch in stretches]
    own = [stretches[bisect_right(starts, part.start) - 1] for part in parts]
    return tuple(
        Segment(start=stretch.place(part.start), stop=stretch.place(part.stop))
        for part, stretch in zip(parts, own, strict=True)
    )
