"""Where the frames and events of a log begin and end, across damage."""

from __future__ import annotations

import re
from array import array
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.blackbox.encodings import (
    MAX_VB_BYTES,
    ByteIndex,
    group_fields,
    index_bytes,
    read_tag2_3s32,
    read_tag8_4s16,
)
from rotorfit.logs.blackbox.header import Encoding, FrameDefinition, Header

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jaxtyping import Int, UInt8

EVENT: Final = ord("E")
LOG_END: Final = 255
LOGGING_RESUME: Final = 14
MAX_EVENT_BYTES: Final = 64
"""No event is longer."""
MAX_EVENTS: Final = 100_000
"""Most events of one log; an hour of flight has some dozens."""

# Payload by event number: "u" unsigned and "s" signed variable byte, a digit so many raw bytes.
_PAYLOADS: Final[dict[int, tuple[str, str]]] = {
    0: ("sync beep", "u"),
    10: ("autotune cycle start", "5"),
    11: ("autotune cycle result", "4"),
    12: ("autotune targets", "8"),
    14: ("logging resumed", "uu"),
    15: ("disarmed", "u"),
    20: ("G-tune cycle result", "1s2"),
    30: ("flight mode", "uu"),
    40: ("twitch test", "5"),
}
_INFLIGHT_ADJUSTMENT: Final = 13
_END_MESSAGE = re.compile(rb"End of log(?: \(disarm reason:([^)]?)\))?\x00", re.DOTALL)


@frozen_dataclass
class Event:
    """One event: its number in the specification, its name, what is recorded with it.

    Raw bytes are one integer, low byte first; `position` is of its E [bytes from the first frame].
    """

    kind: int
    name: str
    values: tuple[int, ...]
    position: int


def read_event(data: bytes, position: int) -> tuple[Event | None, int]:
    """Read the event that begins with the E at `position`."""
    refused = None, len(data) + 1
    if position + 1 >= len(data):
        return refused
    kind, start = data[position + 1], position + 2
    if kind == LOG_END:
        message = _END_MESSAGE.match(data, start)
        if message is None:
            return refused
        reason = message.group(1) or b""
        return _make_event(kind, "end of log", tuple(reason), position), message.end()
    if kind == _INFLIGHT_ADJUSTMENT:
        # The high bit of the number of the adjusted function says that a float follows.
        is_float = data[start : start + 1] >= b"\x80"
        name, payload = "in-flight adjustment", "14" if is_float else "1s"
    elif kind in _PAYLOADS:
        name, payload = _PAYLOADS[kind]
    else:
        return refused
    values, stop = _read_payload(data, start, payload)
    return (_make_event(kind, name, values, position), stop) if stop <= len(data) else refused


def _make_event(kind: int, name: str, values: tuple[int, ...], position: int) -> Event:
    return Event(kind=kind, name=name, values=values, position=position)


def _read_payload(data: bytes, start: int, payload: str) -> tuple[tuple[int, ...], int]:
    """Read the numbers of a payload and the position after it; past the end if cut off."""
    values: list[int] = []
    position = start
    for part in payload:
        if part.isdigit():
            stop = position + int(part)
            value = int.from_bytes(data[position:stop], "little")
        else:
            value, stop = _read_vb(data, position)
            if part == "s":
                value = (value >> 1) ^ -(value & 1)
        if stop > len(data):
            return (), len(data) + 1
        values.append(value)
        position = stop
    return tuple(values), position


def _read_vb(data: bytes, start: int) -> tuple[int, int]:
    """Read an unsigned variable-byte number and the position after it; past the end if none."""
    value = 0
    for i, byte in enumerate(data[start : start + 5]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 128:
            return value & 0xFFFFFFFF, start + i + 1
    return 0, len(data) + 1


DAMAGE: Final = ord("?")
"""Stands among the letters of the frames where bytes had to be skipped."""

WINDOW: Final = 1 << 20
"""Bytes whose frames are found and read together; their index takes some twenty times as many."""

_RUN, _MASKED_RUN, _TABLE = 0, 1, 2


@frozen_dataclass
class Window:
    """The frames that begin in one part of a log, in the order of the file.

    - `index`: of the bytes of this part, and enough more for its last frame.
    - `origin`: where the part begins [bytes from the first frame of the log].
    - `letters`: kind of each frame as ASCII, or `DAMAGE`.
    - `starts`: position after the letter [bytes from `origin`].
    - `events`: of the E frames, which are not among the others.
    - `skipped_bytes`: in damaged stretches.
    - `stop`: after the last whole frame so far [bytes from the first frame of the log].
    - `ended`: whether an end-of-log event was met.
    """

    index: ByteIndex
    origin: int
    letters: UInt8[np.ndarray, " n"]
    starts: Int[np.ndarray, " n"]
    events: tuple[Event, ...]
    skipped_bytes: int
    stop: int
    ended: bool


@frozen_dataclass
class _Walk:
    """How to find the end of a frame of one kind without reading it.

    Each step is a kind, a count and a table: a run of that many variable-byte numbers; a byte
    from which the table says how many of them follow; a byte from which it says the length.
    """

    steps: tuple[tuple[int, int, Sequence[int]], ...]
    longest: int


def scan_frames(data: bytes, header: Header) -> Iterator[Window]:
    """Find all frames of one log, part by part, so that only one part is indexed at a time."""
    walks = {ord(k): _walk_of_definition(d, header.data_version) for k, d in header.frames.items()}
    overlap = max(MAX_EVENT_BYTES, *(walk.longest for walk in walks.values())) + 2
    size = header.stop - header.data_start
    origin = stop = 0
    ended = False
    while origin < size and not ended:
        first = header.data_start + origin
        # A frame is accepted if another frame, or the end of the log, follows it at once; otherwise
        # the search goes on one byte after the letter with which it seemed to begin.
        part = data[first : min(first + WINDOW + overlap, header.stop)]
        window, origin = _scan_part(part, walks, origin, stop)
        stop, ended = window.stop, window.ended
        yield window


def _scan_part(
    data: bytes, walks: Mapping[int, _Walk], origin: int, stop_before: int
) -> tuple[Window, int]:
    """Find the frames that begin in the first `WINDOW` bytes, and where to go on."""
    index = index_bytes(data)
    markers = frozenset(walks) | {EVENT}
    search = re.compile(b"[" + re.escape(bytes(sorted(markers))) + b"]").search
    rank, ends = index.rank.data, index.ends.data
    letters, starts, events = bytearray(), array("q"), list[Event]()
    position, good, skipped, is_last = 0, stop_before - origin, 0, False
    limit = min(len(data), WINDOW)
    while position < limit and not is_last:
        letter, event = data[position], None
        if letter == EVENT:
            event, stop = read_event(data, position)
        elif letter in walks:
            stop = _frame_stop(data, rank, ends, walks[letter], position + 1)
        else:
            stop = len(data) + 1
        is_last = event is not None and event.kind == LOG_END
        if stop > len(data) or not (is_last or stop == len(data) or data[stop] in markers):
            following = search(data, position + 1)
            position = following.start() if following else len(data)
            continue
        if position > good:
            skipped += position - good
            letters.append(DAMAGE)
            starts.append(good)
        if event is None:
            letters.append(letter)
            starts.append(position + 1)
        else:
            events.append(replace(event, position=origin + position))
        position = good = stop
    window = Window(
        index=index,
        origin=origin,
        letters=np.frombuffer(bytes(letters), np.uint8),
        starts=np.array(starts, np.int64),
        events=tuple(events),
        skipped_bytes=skipped,
        stop=origin + good,
        ended=is_last,
    )
    return window, origin + position


def _frame_stop(data: bytes, rank: memoryview, ends: memoryview, walk: _Walk, start: int) -> int:
    """Find the position after the frame whose fields begin at `start`; past the end if none."""
    position = start
    try:
        for kind, count, table in walk.steps:
            if kind == _RUN:
                position = ends[rank[position] + count - 1]
            elif kind == _TABLE:
                position += table[data[position]]
            else:
                written = table[data[position]]
                position += 1
                if written:
                    position = ends[rank[position] + written - 1]
    except IndexError:  # the frame was cut off
        return len(data) + 1
    return position if position - start <= walk.longest else len(data) + 1


def _walk_of_definition(definition: FrameDefinition, version: int) -> _Walk:
    """Return how to find the end of a frame of this definition."""
    steps: list[tuple[int, int, Sequence[int]]] = []
    longest = 0
    for group in group_fields(definition):
        match group.encoding:
            case Encoding.UNWRITTEN:
                continue
            case Encoding.TAG8_8SVB:
                mask = (1 << group.count) - 1
                table = tuple((tags & mask).bit_count() for tags in range(256))
                steps.append((_MASKED_RUN, 0, table))
                longest += 1 + MAX_VB_BYTES * group.count
            case Encoding.TAG2_3S32 | Encoding.TAG2_3SVARIABLE | Encoding.TAG8_4S16:
                table = _group_lengths(group.encoding, version)
                steps.append((_TABLE, 0, table))
                longest += max(table)
            case _:
                steps.append((_RUN, group.count, ()))
                longest += MAX_VB_BYTES * group.count
    return _Walk(steps=tuple(steps), longest=longest)


@lru_cache
def _group_lengths(encoding: Encoding, version: int) -> tuple[int, ...]:
    """Return the number of bytes of a group by its first byte, as the reader itself takes them."""
    room = 16
    index = index_bytes(b"".join(bytes([tags]) + bytes(room - 1) for tags in range(256)))
    starts = room * np.arange(256)
    if encoding == Encoding.TAG8_4S16:
        _, stops = read_tag8_4s16(index, starts, version)
    else:
        _, stops = read_tag2_3s32(index, starts, variable=False)  # lengths are the same in both
    return tuple(int(length) for length in stops - starts)
