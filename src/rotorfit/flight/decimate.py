"""Fewer samples for a fit that looks at slow lines alone, and what is kept of how it was recorded.

Whole flights are decimated: the equations compare a central difference with an average over the
same two samples, of all signals alike.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.flight_data import FlightData, HeldCommands, Segment
from rotorfit.flight.motors.motor_model import MotorModel, clock_jumps, with_motors
from rotorfit.flight.signals import (
    Saturation,
    Stretch,
    Thinning,
    central_difference,
    kept_rows,
    saturation,
    stretches,
    thinning_low_pass,
    whole_samples,
)
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.flight.prepare import PreparedFlight

FEWEST_PER_PERIOD: Final = 8.0
"""Samples kept for a period of the fastest line: at that line the average of [1 4 1]/6 is off the
central difference by 0.2 %, at a third of its frequency by 0.003 %."""


@frozen_dataclass
class AsRecorded:
    """A flight as recorded, however many samples are kept of it.

    - `sample_rate`: of the clock of all channels [Hz].
    - `start`: time of the first sample, on the log's own clock [s].
    - `samples`, `seconds`: in all airborne stretches.
    - `spans`: start and end of every airborne stretch, on the log's own clock [s].
    - `cut_off`: what the ends of gyro and accelerometer cut off.
    """

    sample_rate: float
    start: float
    samples: int
    seconds: float
    spans: tuple[tuple[float, float], ...]
    saturation: Mapping[str, Saturation]


def as_recorded(prepared: PreparedFlight) -> AsRecorded:
    """Summarise a flight with every sample that was recorded."""
    data = prepared.data
    return AsRecorded(
        sample_rate=data.sample_rate,
        start=float(data.time[0]),
        samples=data.samples_used,
        seconds=data.seconds_used,
        spans=tuple(
            (float(data.time[s.start]), float(data.time[s.stop - 1])) for s in data.segments
        ),
        saturation={
            "gyro": saturation(_used_rows(data, data.angular_velocity), "gyro"),
            "accel": saturation(_used_rows(data, data.specific_force), "accel"),
        },
    )


def _used_rows(data: FlightData, values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "u 3"]:
    """Return the rows of all segments; of one they are not copied."""
    parts = [values[s.start : s.stop] for s in data.segments]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def decimated(prepared: PreparedFlight, motors: MotorModel, *, top: float) -> PreparedFlight:
    """Decimate a flight to the rate that lines up to `top` [Hz] need; slow logs stay as they are.

    Signals pass a linear-phase filter without delay, white noise keeps its density, and no sample
    of a segment is made of others outside it. Held commands become their mean, held as long as all
    of them. Derivatives must be central differences.
    """
    data = prepared.data
    step = whole_samples(data.sample_rate / (FEWEST_PER_PERIOD * top))
    if step < 2:
        return prepared
    thinned, held = _design_thinning(data, step, top), None
    gyro, rate = thinned(data.angular_velocity), data.sample_rate / step
    if motors.speed == "measured":
        speed = thinned(prepared.motor_channel)
    else:
        mean = np.convolve(thinned.weights, np.ones(step) / step)
        speed = dataclasses.replace(thinned, weights=mean)(prepared.motor_channel)
        held = HeldCommands(
            speed=prepared.motor_channel,
            sample_rate=data.sample_rate,
            jumps=clock_jumps(data.time, data.sample_rate),
        )
    fewer = dataclasses.replace(
        data,
        sample_rate=rate,
        time=np.concatenate(
            [
                data.time[s.start] + (np.array(s.kept) - s.start) / data.sample_rate
                for s in thinned.within
            ]
        ),
        specific_force=thinned(data.specific_force),
        angular_velocity=gyro,
        angular_acceleration=central_difference(gyro, rate),
        rotor_speed=speed,
        rotor_acceleration=speed,
        segments=_map_segments(data.segments, thinned.within),
        rotor_speed_std=data.rotor_speed_std / float(np.sqrt(step)),
        velocity=None if data.velocity is None else thinned(data.velocity),
        carried=None if data.carried is None else thinned(data.carried),
        world_axes=None if data.world_axes is None else thinned(data.world_axes),
        climb=None if data.climb is None else thinned(data.climb[:, None])[:, 0],
        reference=None if data.reference is None else thinned(data.reference),
        thinned=thinned,
        held=held,
    )
    return dataclasses.replace(
        prepared,
        data=with_motors(fewer, speed, motors.response),
        phases=_map_segments(prepared.phases, thinned.within),
        motor_channel=speed,
    )


def _design_thinning(data: FlightData, step: int, top: float) -> Thinning:
    """Design the filter for lines up to `top` [Hz] that keeps every `step`-th row."""
    weights = thinning_low_pass(data.sample_rate, step, top)
    within = stretches(
        len(data.time),
        step=step,
        jumps=clock_jumps(data.time, data.sample_rate).tolist(),
        # Beside a segment and its neighbour rows, a gap of one channel may be drawn over.
        borders=[row for s in data.segments for row in (s.start - 1, s.stop + 1)],
    )
    return Thinning(within=within, weights=weights, before=len(weights) // 2)


def _map_segments(parts: Sequence[Segment], within: Sequence[Stretch]) -> tuple[Segment, ...]:
    """Map segments of recorded rows to kept rows."""
    rows = [kept_rows(within, part.start, part.stop) for part in parts]
    return tuple(Segment(start=a, stop=b) for a, b in rows)
