"""Crazyflie micro-SD logs as bytes: the header, and where each record begins, across damage.

A log is a magic byte, a version, a list of events with their variables, then records of an event
number, a time and the values, packed and little-endian; a CRC-32 of all that ends it. Written by
the firmware's usddeck.c; version 1 has times in ms as uint32, version 2 in us as uint64.
"""

from __future__ import annotations

import re
import struct
import zlib
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import Content, let_go, report_progress
from rotorfit.logs.flight_log import pieces

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int, UInt8

MAGIC: Final = 0xBC
VERSIONS: Final[Mapping[int, tuple[str, float]]] = {1: ("<u4", 1e-3), 2: ("<u8", 1e-6)}
"""Type of the time of a record, and its unit [s], by version."""

TYPES: Final[Mapping[str, str]] = {
    "B": "<u1",
    "b": "<i1",
    "H": "<u2",
    "h": "<i2",
    "I": "<u4",
    "i": "<i4",
    "f": "<f4",
    "e": "<f2",
}
"""NumPy type by the letter that the header gives each variable."""

MOST_DECLARED: Final = 1000
"""Most events, and most variables of one; the firmware writes 20 of each."""
LONGEST_NAME: Final = 200

CRC_BYTES: Final = 4
LATEST_TIME: Final = 1e7
"""No vehicle is on for so long [s]: a later first time is damage."""
LARGEST_STEP: Final = 3600.0
"""Longest pause between two records [s]."""
LARGEST_STEP_BACK: Final = 1.0
"""Tasks of the firmware write in turns, and a record may come after a later one [s]."""
CHAIN: Final = 4
"""So many records must follow each other for the search to trust a place after damage."""
FIRST_BLOCK, LARGEST_BLOCK = 16, 1 << 16
"""Records looked at together."""
SEARCH_BYTES: Final = 1 << 16
PIECE_BYTES: Final = 1 << 22

_VARIABLE: Final = re.compile(r"([!-~]+)\((.)\)")


@frozen_dataclass
class Variable:
    """A variable of an event: its name, NumPy type, and place in the record [bytes]."""

    name: str
    type: str
    offset: int


@frozen_dataclass
class Event:
    """A kind of record: its variables in order, and its size with number and time [bytes]."""

    number: int
    name: str
    variables: tuple[Variable, ...]
    size: int


@frozen_dataclass
class Header:
    """What a log declares: version, events, and where the records begin [bytes]."""

    version: int
    events: tuple[Event, ...]
    start: int


@frozen_dataclass
class Records:
    """Where the records of a log are: position of each [bytes], by number of the event.

    `dropped_records` could be read, but run into a damaged place; `trailing_bytes` are of an
    unfinished record at the end.
    """

    header: Header
    starts: Mapping[int, Int[np.ndarray, " n"]]
    damaged_places: int
    skipped_bytes: int
    dropped_records: int
    trailing_bytes: int
    checksum: bool


def read_header(data: Content) -> Header:
    """Read what a log declares."""
    if len(data) < 5:
        raise LogError(f"{len(data)} bytes, expected a Crazyflie log header: copy the file again")
    version, count = struct.unpack_from("<HH", data, 1)
    if version not in VERSIONS:
        raise LogError(f"Crazyflie log of version {version}, expected 1 or 2")
    if count > MOST_DECLARED:
        raise LogError(f"the header declares {count} events: it is damaged; copy the file again")
    head = 2 + np.dtype(VERSIONS[version][0]).itemsize
    events: list[Event] = []
    position = 5
    for _ in range(count):
        event, position = _read_event(data, position, head)
        events.append(event)
    numbers = [event.number for event in events]
    if len(set(numbers)) < len(numbers):
        raise LogError("the header declares an event twice: it is damaged; copy the file again")
    return Header(version=version, events=tuple(events), start=position)


def _read_event(data: Content, position: int, head: int) -> tuple[Event, int]:
    """Read the event declared at a position, and the position after it."""
    number, position = _read_uint16(data, position)
    name, position = _read_name(data, position)
    count, position = _read_uint16(data, position)
    if count > MOST_DECLARED:
        raise LogError(f"event {name!r} declares {count} variables: the header is damaged")
    variables: list[Variable] = []
    size = head
    for _ in range(count):
        text, position = _read_name(data, position)
        match = _VARIABLE.fullmatch(text)
        if match is None or match[2] not in TYPES:
            raise LogError(
                f"event {name!r} declares the variable {text!r}, expected a name and a type of "
                f"{', '.join(TYPES)}, such as gyro.x(f): the header is damaged"
            )
        variables.append(Variable(name=match[1], type=TYPES[match[2]], offset=size))
        size += np.dtype(TYPES[match[2]]).itemsize
    return Event(number=number, name=name, variables=tuple(variables), size=size), position


def _read_uint16(data: Content, position: int) -> tuple[int, int]:
    if position + 2 > len(data):
        raise LogError("the file ends within its header: no flight was recorded")
    return int.from_bytes(data[position : position + 2], "little"), position + 2


def _read_name(data: Content, position: int) -> tuple[str, int]:
    """Read a null-terminated name, and the position after it."""
    stop = data.find(b"\0", position, position + LONGEST_NAME + 1)
    if stop < 0:
        raise LogError(
            f"no name of at most {LONGEST_NAME} letters at byte {position} of the header: "
            "it is damaged or cut off; copy the file again"
        )
    return data[position:stop].decode("latin-1"), stop + 1


def find_records(data: Content) -> Records:
    """Find the records of a log."""
    header = read_header(data)
    checksum = _checksum_matches(data)
    # An unfinished file has no CRC: its last bytes are looked at like the others.
    walk = _Walk(
        header=header,
        sizes={event.number: event.size for event in header.events},
        content=data,
        bytes=np.frombuffer(data, np.uint8),
        stop=len(data) - CRC_BYTES if checksum else len(data),
    )
    runs: list[tuple[int, int, int]] = []
    position, last = header.start, None
    places = skipped = dropped = 0
    while position < walk.stop:
        count, time = _count_run(walk, position, last)
        if count > 0:
            runs.append((walk.number(position), position, count))
            position += count * walk.sizes[walk.number(position)]
            last = time
            continue
        # At a number that no event has, or a time that cannot follow, the search goes on at the
        # next place from which some records follow each other; the record before is dropped, since
        # its bytes may be others'.
        following = _next_place(walk, position + 1, last)
        if following is None:
            break
        number, first, count = runs[-1] if runs else (0, 0, 0)
        if runs and first + count * walk.sizes[number] == position:
            runs.pop()
            dropped += 1
            if count > 1:
                runs.append((number, first, count - 1))
        places += 1
        skipped += following - position
        position = following
    trailing = walk.stop - position
    return Records(
        header=header,
        starts=_record_starts(walk, runs),
        damaged_places=places,
        skipped_bytes=skipped,
        dropped_records=dropped,
        trailing_bytes=trailing,
        checksum=checksum,
    )


def _checksum_matches(data: Content) -> bool:
    checksum, end = 0, len(data) - CRC_BYTES
    for start in range(0, end, PIECE_BYTES):
        checksum = zlib.crc32(data[start : min(start + PIECE_BYTES, end)], checksum)
        let_go(data)
    return checksum == int.from_bytes(data[-CRC_BYTES:], "little")


@frozen_dataclass
class _Walk:
    """What the search for records needs: the file's bytes, up to `stop`, and the sizes."""

    header: Header
    sizes: Mapping[int, int]
    content: Content
    bytes: UInt8[np.ndarray, " n"]
    stop: int

    def number(self, position: int) -> int:
        """Read the number of the event whose record would begin at a position."""
        return int(self.bytes[position]) + 256 * int(self.bytes[min(position + 1, self.stop - 1)])

    def times(self, heads: UInt8[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
        """Return the times in the heads of records [s]."""
        kind, unit = VERSIONS[self.header.version]
        width = np.dtype(kind).itemsize
        return np.ascontiguousarray(heads[:, 2 : 2 + width]).view(kind)[:, 0] * unit


def _count_run(walk: _Walk, position: int, last: float | None) -> tuple[int, float | None]:
    """Count the records of one event that follow each other from a position; and the last time."""
    number = walk.number(position)
    size = walk.sizes.get(number)
    if size is None:
        return 0, last
    found, block = 0, FIRST_BLOCK
    while True:
        first = position + found * size
        count = min(block, (walk.stop - first) // size)
        rows = walk.bytes[first : first + count * size].reshape(count, size)
        good, times = _credible_records(walk, rows, number, last)
        n = count if good.all() else int(np.argmin(good))
        found += n
        if count == LARGEST_BLOCK:
            let_go(walk.content)
            report_progress(first + n * size, walk.stop)
        last = float(times[n - 1]) if n else last
        if n < block:
            return found, last
        block = min(8 * block, LARGEST_BLOCK)


def _credible_records(
    walk: _Walk, rows: UInt8[np.ndarray, "n k"], number: int, last: float | None
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Select which rows are records of an event whose time can follow the one before; times."""
    numbers = np.ascontiguousarray(rows[:, :2]).view("<u2")[:, 0]
    times = walk.times(rows)
    steps = np.diff(times, prepend=times[:1] if last is None else last)
    credible = (steps >= -LARGEST_STEP_BACK) & (steps <= LARGEST_STEP) & (times <= LATEST_TIME)
    return (numbers == number) & credible, times


def _next_place(walk: _Walk, position: int, last: float | None) -> int | None:
    """Find the first position from which `CHAIN` records follow each other; None if none."""
    head = 2 + np.dtype(VERSIONS[walk.header.version][0]).itemsize
    while position + head <= walk.stop:
        part = walk.bytes[position : min(position + SEARCH_BYTES + head - 1, walk.stop)]
        heads = np.lib.stride_tricks.sliding_window_view(part, head)
        numbers = heads[:, 0].astype(np.int64) + 256 * heads[:, 1].astype(np.int64)
        known = np.flatnonzero(np.isin(numbers, list(walk.sizes)))
        times = walk.times(heads[known])
        earliest = 0.0 if last is None else last - LARGEST_STEP_BACK
        latest = LATEST_TIME if last is None else last + LARGEST_STEP
        for candidate in known[(times >= earliest) & (times <= latest)].tolist():
            if _is_chained(walk, position + candidate, last):
                return position + candidate
        position += len(heads)
    return None


def _is_chained(walk: _Walk, position: int, last: float | None) -> bool:
    """Return whether `CHAIN` records follow each other, or fewer up to the very end."""
    for _ in range(CHAIN):
        size = walk.sizes.get(walk.number(position))
        if size is None or position + size > walk.stop:
            return False
        rows = walk.bytes[position : position + size].reshape(1, size)
        good, times = _credible_records(walk, rows, walk.number(position), last)
        if not good[0]:
            return False
        last = float(times[0])
        position += size
        if position == walk.stop:
            return True
    return True


def _record_starts(
    walk: _Walk, runs: list[tuple[int, int, int]]
) -> dict[int, Int[np.ndarray, " n"]]:
    """Find the position of every record, by number of the event."""
    found: dict[int, list[Int[np.ndarray, " n"]]] = {number: [] for number in walk.sizes}
    for number, first, count in runs:
        found[number].append(first + walk.sizes[number] * np.arange(count))
    none = np.zeros(0, dtype=np.int64)
    return {number: np.concatenate([none, *parts]) for number, parts in found.items()}


def record_times(data: Content, records: Records, event: Event) -> Float[np.ndarray, " n"]:
    """Return the times of the records of an event, as recorded [s]."""
    kind, unit = VERSIONS[records.header.version]
    starts = records.starts[event.number]
    times = np.empty(len(starts))
    for rows in pieces(len(starts)):
        times[rows] = _read_values(data, starts[rows] + 2, kind)
        let_go(data)
    times *= unit
    return times


def column(
    data: Content, records: Records, event: Event, variable: Variable
) -> Float[np.ndarray, " n"]:
    """Read a variable of all records of an event, as recorded; not finite ones as NaN."""
    return variables_at(data, records.starts[event.number], [variable])[:, 0]


def variables_at(
    data: Content, starts: Int[np.ndarray, " n"], variables: Sequence[Variable]
) -> Float[np.ndarray, "n k"]:
    """Return variables of the records that begin at some places; not finite ones as NaN."""
    values = np.empty((len(starts), len(variables)))
    for rows in pieces(len(starts)):
        some = values[rows]
        for column, variable in enumerate(variables):
            some[:, column] = _read_values(data, starts[rows] + variable.offset, variable.type)
        some[~np.isfinite(some)] = np.nan
        let_go(data)
    return values


def _read_values(
    data: Content, positions: Int[np.ndarray, " n"], kind: str
) -> Float[np.ndarray, " n"]:
    """Read numbers of one type at positions in the file."""
    width = np.dtype(kind).itemsize
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), width)
    with np.errstate(invalid="ignore"):  # damaged bytes may be a signalling NaN
        return windows[positions].view(kind)[:, 0].astype(np.float64)
