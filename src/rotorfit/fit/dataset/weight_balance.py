"""Gravity as a reference: over a whole flight, the mean vertical force is the weight.

Turned by the gyro into axes that do not rotate, the mean of the specific force over T seconds is
minus gravity plus (change of velocity) / T. Nothing of a fit is in that, and no attitude need be
known; a gyro's bias turns a window of some seconds by too little to matter. So the accelerometer,
and the thrust that a fit makes of the rotor speeds, can each be held against gravity.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.fit.reduction.reduce import split_segment
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.kinematics import carried_group, rotated, running_product, small_turns
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from jaxtyping import Float

LONGEST_WINDOW = 10.0
"""A bias of the gyro of 0.01 rad/s turns the axes by 0.1 rad in this time [s]."""
SHORTEST_WINDOW = 2.0
"""Shortest window: in less, a change of velocity looks too much like gravity [s]."""
SHORTEST_PIECE = 0.5
"""The same in a flight torn into pieces so short that most of it is in no longer window [s]."""
FEWEST_PIECES = 4
"""Such pieces, from whose differences the scatter of their mean is known."""
VELOCITY_CHANGE = 1.5
"""Deviation of the vertical velocity at the end of a stretch from that at its beginning [m/s]."""
HOVER_THRUST = (0.5, 1.6)
"""Thrust over its usual that still is a hover."""
MOST_OUTSIDE = 0.1
"""Share of a piece that may be outside of it."""


@frozen_dataclass
class Held:
    """The mean force that held a vehicle up, over gravity: 1 where everything is right.

    - `ratio`: mean of the upward specific force over gravity.
    - `std`: of the ratio, from the unknown change of velocity.
    - `seconds`: how long it was looked at [s].
    """

    ratio: float
    std: float
    seconds: float


@frozen_dataclass
class Turning:
    """The turn of the body axes within windows of a flight, for every force of that flight.

    - `windows`: in which the specific force is averaged.
    - `attitude`: quaternions (scalar first) from the body's axes to those at the start of the
      window, one for each group of samples.
    - `group`: samples in a group.
    - `sample_rate`: of the flight [Hz].
    - `is_torn`: whether gaps leave so little of it whole that shorter windows are taken, too.
    """

    windows: tuple[Segment, ...]
    attitude: tuple[Float[np.ndarray, "_ 4"], ...]
    group: int
    sample_rate: float
    is_torn: bool = False


def turning(data: FlightData) -> Turning:
    """Integrate the turn of a flight's axes by its gyro, in windows of its segments."""
    group = carried_group(data.sample_rate)
    windows, is_torn = _windows_of(data)
    rates = [grouped(data.angular_velocity[w.start : w.stop], group) for w in windows]
    # All windows at once: rest behind the shorter ones changes nothing before it.
    angles = np.zeros((max((len(w) for w in rates), default=0), len(rates), 3))
    for i, (window, w) in enumerate(zip(windows, rates, strict=True)):
        samples = np.minimum(len(window) - group * np.arange(len(w)), group)
        angles[: len(w), i] = w * samples[:, None] / data.sample_rate
    turned = running_product(small_turns(angles))
    attitude = tuple(turned[: len(w), i] for i, w in enumerate(rates))
    return Turning(
        windows=windows,
        attitude=attitude,
        group=group,
        sample_rate=data.sample_rate,
        is_torn=is_torn,
    )


def held_up(axes: Turning, force: Float[np.ndarray, "n 3"]) -> Held | None:
    """Compute the mean of a specific force along the vertical, over gravity.

    `force`: of every sample, body axes [m/s^2], of the accelerometer or thrust over mass. None
    where no stretch is long enough.
    """
    if not axes.windows:
        return None
    lengths = np.array([len(window) for window in axes.windows]) / axes.sample_rate
    means = np.array(
        [
            _mean_length(grouped(force[window.start : window.stop], axes.group), attitude)
            for window, attitude in zip(axes.windows, axes.attitude, strict=True)
        ]
    )
    # Where one window follows the next, the velocity between them cancels.
    breaks = 1 + sum(b.start != a.stop for a, b in pairwise(axes.windows))
    seconds = float(lengths.sum())
    return Held(
        ratio=float(lengths @ means) / seconds / GRAVITY,
        std=VELOCITY_CHANGE * float(np.sqrt(breaks)) / seconds / GRAVITY,
        seconds=seconds,
    )


def hovering(data: FlightData) -> FlightData:
    """Select the pieces of a flight in which it hovers, more or less."""
    squares: Float[np.ndarray, " n"] = np.einsum("nr,nr->n", data.rotor_speed, data.rotor_speed)
    usual = float(np.median(squares[data.used_rows])) if data.segments else 0.0
    low, high = HOVER_THRUST
    calm: list[Segment] = []
    for segment in data.segments:
        for piece in split_segment(segment, SHORTEST_WINDOW * data.sample_rate):
            own = squares[piece.start : piece.stop]
            # In throws, dives and crashes the velocity changes by more than `VELOCITY_CHANGE`, and
            # what the accelerometer reads on average is no gravity.
            if float(((own < low * usual) | (own > high * usual)).mean()) > MOST_OUTSIDE:
                continue
            follows = bool(calm) and calm[-1].stop == piece.start
            begin = calm.pop().start if follows else piece.start
            calm.append(Segment(start=begin, stop=piece.stop))
    return replace(data, segments=tuple(calm))


def _windows_of(data: FlightData) -> tuple[tuple[Segment, ...], bool]:
    """Return the segments in equal windows, none too short, and whether the flight is torn."""
    whole = _equal_windows(data, SHORTEST_WINDOW)
    pieces = _equal_windows(data, SHORTEST_PIECE)
    is_torn = len(pieces) >= FEWEST_PIECES and 2 * sum(map(len, whole)) < sum(map(len, pieces))
    return tuple(pieces if is_torn else whole), is_torn


def _equal_windows(data: FlightData, shortest: float) -> list[Segment]:
    """Return the segments in equal windows, none shorter than `shortest` [s]."""
    return [
        window
        for segment in data.segments
        for window in split_segment(segment, LONGEST_WINDOW * data.sample_rate)
        if len(window) >= shortest * data.sample_rate
    ]


def _mean_length(force: Float[np.ndarray, "m 3"], attitude: Float[np.ndarray, "m 4"]) -> float:
    """Return the length of the mean force in axes that do not turn with the body."""
    return float(np.linalg.norm(rotated(attitude, force).mean(axis=0)))


def grouped(values: Float[np.ndarray, "n 3"], group: int) -> Float[np.ndarray, "m 3"]:
    """Average groups of samples; the last one may be of fewer."""
    whole = len(values) // group * group
    means = values[:whole].reshape(-1, group, 3).mean(axis=1)
    rest = values[whole:]
    return means if not len(rest) else np.concatenate([means, rest.mean(axis=0, keepdims=True)])


def held_together(parts: Iterable[Held | None]) -> Held | None:
    """Return the mean of those that are known; None if none is."""
    known = [part for part in parts if part is not None]
    return pooled(known) if known else None


def pooled(parts: Sequence[Held]) -> Held:
    """Return the mean of several, each with the weight of its deviation."""
    weight = np.array([part.std**-2.0 for part in parts])
    ratios = np.array([part.ratio for part in parts])
    return Held(
        ratio=float(weight @ ratios / weight.sum()),
        std=float(weight.sum() ** -0.5),
        seconds=sum(part.seconds for part in parts),
    )
