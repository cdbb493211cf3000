"""One clock for all topics: the stamps of the messages where they can be believed.

A message says when its data were taken, the recorder when it arrived. The first is better, unless
it is empty, jumps, or belongs to a clock that has nothing to do with the recorder's. A clock that
only began elsewhere (the autopilot's, at power-on) is moved: the fastest messages took no time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from rotorfit.logs.rosbag.stream import Recorded

_SAME_CLOCK: Final = 1.0
"""Median delay up to which stamps count as the recorder's own clock [s]."""
_STEADY: Final = 1.0
"""Spread of the delay of a clock that only began elsewhere [s]."""
_ONE_SOURCE: Final = 0.25
"""Offsets closer than this belong to one clock [s]."""
_BACKWARDS: Final = 0.1
"""Share of stamps before the one received before: messages overtake each other, now and then."""
_REPEATED: Final = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """The clock of one topic, since the beginning of the recording [s].

    `basis` is ``"stamp"``, ``"moved"`` or ``"received"``; `why` has the numbers that decided.
    """

    time: Float[np.ndarray, " n"]
    basis: str
    why: str


def timings(topics: Sequence[Recorded], start: int) -> list[Timing]:
    """Return the clock of each topic."""
    offsets = [_offset(topic) for topic in topics]
    return [
        _timing(topic, offset, _shared(offset, offsets), start)
        for topic, offset in zip(topics, offsets, strict=True)
    ]


def _offset(topic: Recorded) -> float | None:
    """Return by how much stamps are to be moved [s]: 0 or more than that; None: no good stamps."""
    stamps, received = topic.stamps, topic.received
    if len(stamps) == 0 or (stamps <= 0).any():
        return None
    steps = np.diff(stamps)
    if len(steps) and ((steps < 0).mean() > _BACKWARDS or (steps == 0).mean() > _REPEATED):
        return None
    delay = _seconds(received, stamps)
    low, middle, high = np.percentile(delay, [5.0, 50.0, 95.0]).tolist()
    if abs(middle) < _SAME_CLOCK:
        return 0.0
    return float(delay.min()) if high - low < _STEADY else None


def _shared(offset: float | None, offsets: Sequence[float | None]) -> float | None:
    """Return the offset of the clock that several topics share: the least, of the fastest one."""
    if not offset:
        return offset
    return min(o for o in offsets if o and abs(o - offset) < _ONE_SOURCE)


def _timing(topic: Recorded, own: float | None, offset: float | None, start: int) -> Timing:
    received = _seconds(topic.received, np.full(1, start))
    if own is None or offset is None:
        return Timing(time=received, basis="received", why=_why_not(topic))
    delay = _seconds(topic.received, topic.stamps)
    time = received - delay + offset
    if offset == 0.0:
        why = f"stamps, received {1e3 * float(np.median(delay)):.1f} ms later (median)"
        return Timing(time=time, basis="stamp", why=why)
    why = f"stamps of a clock that began elsewhere, moved by {offset:.3f} s to the recorder's"
    return Timing(time=time, basis="moved", why=why)


def _why_not(topic: Recorded) -> str:
    if len(topic.stamps) == 0 or (topic.stamps < 0).all():
        return "times of receipt: its messages have no stamp"
    if (topic.stamps <= 0).any():
        return "times of receipt: its stamps are zero"
    steps = np.diff(topic.stamps)
    if len(steps) and (steps < 0).mean() > _BACKWARDS:
        return "times of receipt: its stamps go back"
    if len(steps) and (steps == 0).mean() > _REPEATED:
        return "times of receipt: its stamps repeat"
    return "times of receipt: its stamps belong to no steady clock"


def _seconds(
    later: Int[np.ndarray, " n"], earlier: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " n"]:
    """Subtract nanoseconds without overflow [s]."""
    whole = later // 1_000_000_000 - earlier // 1_000_000_000
    return whole + 1e-9 * (later % 1_000_000_000 - earlier % 1_000_000_000)
