"""Fewer samples for a fit that looks at slow lines alone, and what is kept of how it was recorded.

Whole flights are decimated: the equations compare a central difference with an average over the
same two samples, of all signals alike.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int
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
    grid, smooth = _grid(data, step), _low_pass(data.sample_rate, step, top)
    before, held = len(smooth) // 2, motors.speed == "commanded"
    mean = np.convolve(smooth, np.ones(step) / step) if held else smooth
    thinned = partial(_filtered, grid=grid, weights=smooth, before=before)
    speed = _filtered(prepared.motor_channel, grid=grid, weights=mean, before=before)
    gyro, rate = thinned(data.angular_velocity), data.sample_rate / step
    fewer = dataclasses.replace(
        data,
        sample_rate=rate,
        time=data.time[grid.kept],
        specific_force=thinned(data.specific_force),
        angular_velocity=gyro,
        angular_acceleration=central_difference(gyro, rate),
        segments=tuple(_inside(s, s, grid.kept) for s in data.segments),
        rotor_speed_std=data.rotor_speed_std / float(np.sqrt(step)),
        velocity=None if data.velocity is None else thinned(data.velocity),
        climb=None if data.climb is None else thinned(data.climb[:, None])[:, 0],
        reference=None if data.reference is None else thinned(data.reference),
        held_for=1.0 / data.sample_rate if held else None,
    )
    return dataclasses.replace(
        prepared,
        data=with_motors(fewer, speed, motors.response),
        phases=_phases(prepared, grid.kept),
        motor_channel=speed,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """Which rows are kept, every `step` of them, and the parts that are filtered apart."""

    kept: Int[np.ndarray, " m"]
    step: int
    parts: tuple[tuple[int, int], ...]


def _grid(data: FlightData, step: int) -> _Grid:
    """Return rows that begin anew after every gap, and each segment as a part of its own.

    Beside a segment, and the row before and behind it, a gap of one channel may be drawn over.
    """
    jumps = clock_jumps(data.time, data.sample_rate).tolist()
    whole = [0, *jumps, len(data.time)]
    borders = {row for s in data.segments for row in (s.start - 1, s.stop + 1)}
    return _Grid(
        kept=np.concatenate([np.arange(a, b, step) for a, b in pairwise(whole)]),
        step=step,
        parts=tuple(pairwise(sorted({*whole, *borders}))),
    )


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
    grid: _Grid,
    weights: Float[np.ndarray, " t"],
    before: int,
) -> Float[np.ndarray, "m k"]:
    """Return the kept rows of filtered values, every part continued by point reflection.

    `weights`: of consecutive samples, of which so many are `before` the row.
    """
    out = np.empty((len(grid.kept), values.shape[1]))
    ends = ((before, len(weights) - 1 - before), (0, 0))
    # With as many zeros that the first sum over samples alone is one of those that are made.
    turned = np.concatenate([np.zeros(-(len(weights) - 1) % grid.step), weights[::-1]])
    skipped = (len(turned) - 1) // grid.step
    for a, b in grid.parts:
        first, stop = np.searchsorted(grid.kept, [a, b]).tolist()
        if first < stop:
            wide = np.pad(values[a:b], ends, mode="reflect", reflect_type="odd")
            made = signal.upfirdn(turned, wide[grid.kept[first] - a :], down=grid.step, axis=0)
            out[first:stop] = made[skipped : skipped + stop - first]
    return out


def _inside(part: Segment, segment: Segment, kept: Int[np.ndarray, " m"]) -> Segment:
    """Return the kept rows of a part of a segment that have neighbours of that segment."""
    first, last = np.searchsorted(kept, [segment.start - 1, segment.stop + 1]).tolist()
    start, stop = np.searchsorted(kept, [part.start, part.stop]).tolist()
    return Segment(start=max(start, first + 1), stop=min(stop, last - 1))


def _phases(prepared: PreparedFlight, kept: Int[np.ndarray, " m"]) -> tuple[Segment, ...]:
    """Return the phases in rows that are kept."""
    return tuple(
        _inside(phase, segment, kept)
        for segment in prepared.data.segments
        for phase in prepared.phases
        if segment.start <= phase.start < segment.stop
    )
