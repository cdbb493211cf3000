"""Writes Crazyflie micro-SD logs as the firmware's usddeck.c does, for tests."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

FIXED = 0xFFFF
TIME = {1: "I", 2: "Q"}


@dataclass(frozen=True)
class Event:
    """A kind of record: number, name, and variables with their types, such as ("gyro.x", "f")."""

    number: int
    name: str
    variables: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Record:
    """One record: the event's number, the time in the file's unit, and the values."""

    number: int
    time: int
    values: Sequence[float]


def encode_header(events: Sequence[Event], *, version: int = 2) -> bytes:
    parts = [struct.pack("<BHH", 0xBC, version, len(events))]
    for event in events:
        parts.append(struct.pack("<H", event.number) + event.name.encode() + b"\0")
        parts.append(struct.pack("<H", len(event.variables)))
        parts += [f"{name}({kind})".encode() + b"\0" for name, kind in event.variables]
    return b"".join(parts)


def encode_record(event: Event, record: Record, *, version: int = 2) -> bytes:
    kinds = "".join(kind for _, kind in event.variables)
    return struct.pack(f"<H{TIME[version]}{kinds}", record.number, record.time, *record.values)


def encode(events: Sequence[Event], records: Sequence[Record], *, version: int = 2) -> bytes:
    """Return a whole log with its CRC."""
    by_number = {event.number: event for event in events}
    body = b"".join(encode_record(by_number[r.number], r, version=version) for r in records)
    data = encode_header(events, version=version) + body
    return data + struct.pack("<I", zlib.crc32(data))
