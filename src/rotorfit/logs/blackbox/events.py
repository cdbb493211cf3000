"""The E frames of a log: what happened, as far as the format says."""

import re
from dataclasses import dataclass
from typing import Final

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One event.

    Attributes
    ----------
    kind
        Number of the specification.
    name
        In words.
    values
        What is recorded with it; raw bytes as one integer, low byte first.
    position
        Of its E [bytes from the first frame].
    """

    kind: int
    name: str
    values: tuple[int, ...]
    position: int


def read_event(data: bytes, position: int) -> tuple[Event | None, int]:
    """Read the event that begins with the E at `position`.

    Parameters
    ----------
    data
        The log without its header.
    position
        Of the letter.

    Returns
    -------
    Event or None
        None if these bytes are no event.
    int
        Position after the event; past the end if it is none.
    """
    refused = None, len(data) + 1
    if position + 1 >= len(data):
        return refused
    kind, start = data[position + 1], position + 2
    if kind == LOG_END:
        message = _END_MESSAGE.match(data, start)
        if message is None:
            return refused
        reason = message.group(1) or b""
        return _event(kind, "end of log", tuple(reason), position), message.end()
    if kind == _INFLIGHT_ADJUSTMENT:
        # The high bit of the number of the adjusted function says that a float follows.
        is_float = data[start : start + 1] >= b"\x80"
        name, payload = "in-flight adjustment", "14" if is_float else "1s"
    elif kind in _PAYLOADS:
        name, payload = _PAYLOADS[kind]
    else:
        return refused
    values, stop = _read_payload(data, start, payload)
    return (_event(kind, name, values, position), stop) if stop <= len(data) else refused


def _event(kind: int, name: str, values: tuple[int, ...], position: int) -> Event:
    return Event(kind=kind, name=name, values=values, position=position)


def _read_payload(data: bytes, start: int, payload: str) -> tuple[tuple[int, ...], int]:
    """Return the numbers of a payload and the position after it; past the end if cut off."""
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
    """Return an unsigned variable-byte number and the position after it; past the end if none."""
    value = 0
    for i, byte in enumerate(data[start : start + 5]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 128:
            return value & 0xFFFFFFFF, start + i + 1
    return 0, len(data) + 1
