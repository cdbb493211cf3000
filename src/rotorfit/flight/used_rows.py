"""Which rows of a flight are used: the window asked for, without what has not settled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.flight.airborne import (
    SHORTEST_FLIGHT,
    phase_edges,
)
from rotorfit.flight.clocks import (
    JITTER_STEPS,
    UniformChannels,
)
from rotorfit.flight.flight_checks import (
    refuse_empty_window,
)
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.signals import whole_samples

if TYPE_CHECKING:
    from jaxtyping import Float


SETTLING = 0.2
"""After the beginning of a log or a gap, in which motors follow commands that it does not have [s]:
five usual lags."""
Window = tuple[float | None, float | None]


def window_runs(uniform: UniformChannels, window: Window) -> tuple[tuple[int, int], ...]:
    """Cut the stretches without gaps to the start and end that the user gives."""
    if window == (None, None):
        return uniform.stretches
    first, last = window_rows(uniform.time, uniform.sample_rate, window)
    shortest = max(whole_samples(SHORTEST_FLIGHT * uniform.sample_rate), 3)
    clipped = [(max(a, first), min(b, last)) for a, b in uniform.stretches]
    kept = tuple((a, b) for a, b in clipped if b - a >= shortest)
    refuse_empty_window(kept, window, float(uniform.time[-1] - uniform.time[0]))
    return kept


def window_rows(
    time: Float[np.ndarray, " n"], sample_rate: float, window: Window
) -> tuple[int, int]:
    """Convert the user's start and end to first row and stop (exclusive)."""
    edges = (
        -np.inf if window[0] is None else window[0],
        np.inf if window[1] is None else window[1],
    )
    # A start or end upon a sample means that sample, however its time is rounded.
    since_start = time - time[0] + JITTER_STEPS / sample_rate
    first, stop = (int(np.searchsorted(since_start, edge)) for edge in edges)
    return first, stop


def drop_unsettled(
    flights: list[tuple[int, int]], uniform: UniformChannels
) -> list[tuple[int, int]]:
    """Drop the beginnings of flights that depend on unlogged commands, if anything is left."""
    begins = np.array([start for start, _ in uniform.stretches])
    known = begins + whole_samples(SETTLING * uniform.sample_rate)
    shortest = max(whole_samples(SHORTEST_FLIGHT * uniform.sample_rate), 3)
    firsts = [int(known[np.searchsorted(begins, a, side="right") - 1]) for a, _ in flights]
    settled = [(max(a, first), b) for (a, b), first in zip(flights, firsts, strict=True)]
    return [(a, b) for a, b in settled if b - a >= shortest] or flights


def inner_segments(flights: list[tuple[int, int]], uniform: UniformChannels) -> tuple[Segment, ...]:
    """Drop the end samples that a central difference cannot serve."""
    starts, stops = ({run[end] for run in uniform.stretches} for end in (0, 1))
    return tuple(Segment(start=a + (a in starts), stop=b - (b in stops)) for a, b in flights)


def phases_of(data: FlightData) -> tuple[Segment, ...]:
    """Cut the segments where the flight's character changes."""
    phases: list[Segment] = []
    for segment in data.segments:
        rates = data.angular_velocity[segment.start : segment.stop]
        for a, b in phase_edges(rates, data.sample_rate):
            phases.append(Segment(start=segment.start + a, stop=segment.start + b))
    return tuple(phases)
