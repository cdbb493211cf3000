"""A ULog as bytes: where each message begins, across damage, in bounded memory.

After a header of 16 bytes come messages of a length (2 bytes), a letter and a content. The file is
read in blocks; a step through the lengths finds the messages of a block, and where it meets what is
no message, the search goes on at the next synchronisation mark or data message that fits.
Format: docs.px4.io, "ULog File Format".

Rows of a topic grow block by block; then their fields become numbers.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, Any, BinaryIO, Final, Protocol, runtime_checkable

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import pieces

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Mapping

    from jaxtyping import Float, Int, UInt8

HEADER_BYTES: Final = 16
BLOCK_BYTES: Final = 1 << 20
SYNC: Final = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
KNOWN: Final = b"ABCDFILMOPQRS"
MOST_PLACES: Final = 1000
"""A file damaged in more places is no log, and would cost hours of search."""
_IS_KNOWN: Final = bytes(int(i in KNOWN) for i in range(256))
_SEARCH_BYTES: Final = (1 << 10, 1 << 16)
"""First and later windows of the search after damage."""


@runtime_checkable
class Judge(Protocol):
    """Knows which data messages a log may have."""

    def accept(self, content: bytes, starts: Int[np.ndarray, " n"]) -> int:
        """Count the messages that are sound, up to the first that is not."""
        ...

    def first_fit(self, raw: UInt8[np.ndarray, " n"]) -> int | None:
        """Find the first place in some bytes where a known data message fits."""
        ...


@frozen_dataclass
class Block:
    """Whole messages of a stretch of the file.

    `skipped` bytes were passed over as damage, in so many `places`; `trailing` ones at the end are
    no whole message.
    """

    content: bytes
    starts: Int[np.ndarray, " n"]
    skipped: int
    places: int
    trailing: int


def read_blocks(file: BinaryIO, begin: int, end: int, *, judge: Judge) -> Iterator[Block]:
    """Yield the messages from byte `begin` of a file to byte `end`, block by block."""
    file.seek(begin)
    left, rest = end - begin, b""
    while left > 0:
        fresh = file.read(min(BLOCK_BYTES, left))
        left = left - len(fresh) if fresh else 0
        block, used = _walk_messages(rest + fresh, judge, is_last=left == 0)
        yield block
        rest = block.content[used:]


def _walk_messages(content: bytes, judge: Judge, *, is_last: bool) -> tuple[Block, int]:
    """Return the messages of some bytes, and how many of the bytes are done with."""
    parts: list[Int[np.ndarray, " n"]] = []
    position = skipped = places = 0
    while True:
        starts, position = _chain_messages(content, position)
        sound = judge.accept(content, starts)
        cut = sound == len(starts) and _is_cut(content, position)
        position = position if sound == len(starts) else int(starts[sound])
        parts.append(starts[:sound])
        if len(content) - position < 3 or (cut and not is_last):
            break
        found = _next_message(content, position + 1, judge)
        if found is None and cut:
            break
        # Without a find all is passed over but what may begin a message of the next block.
        target = found or (len(content) if is_last else max(len(content) - 16, position + 1))
        places += 1
        refuse_ruin(places)
        skipped += target - position
        position = target
        if found is None:
            break
    block = Block(
        content=content,
        starts=np.concatenate(parts),
        skipped=skipped,
        places=places,
        trailing=len(content) - position if is_last else 0,
    )
    return block, position


def refuse_ruin(places: int) -> None:
    """Raise an error if a file is damaged in so many places that it is hardly a log."""
    if places > MOST_PLACES:
        raise LogError(
            f"damaged in more than {MOST_PLACES} places, expected a log of PX4: copy it again from "
            "the card"
        )


def _chain_messages(content: bytes, position: int) -> tuple[Int[np.ndarray, " n"], int]:
    """Find where whole messages begin that follow each other, and where the next would."""
    starts: list[int] = []
    append, unpack, is_known = starts.append, struct.Struct("<HB").unpack_from, _IS_KNOWN
    length = len(content)
    while position <= length - 3:
        size, kind = unpack(content, position)
        end = position + 3 + size
        if end > length or not is_known[kind] or not size:
            break
        append(position)
        position = end
    return np.array(starts, dtype=np.int64), position


def _is_cut(content: bytes, position: int) -> bool:
    """Return whether what begins at a place looks like a message that goes on past the end."""
    if len(content) - position < 3:
        return True
    size, kind = struct.unpack_from("<HB", content, position)
    return bool(_IS_KNOWN[kind]) and position + 3 + size > len(content)


def _next_message(content: bytes, position: int, judge: Judge) -> int | None:
    """Find the next place where a mark stands or a known data message fits."""
    window = _SEARCH_BYTES[0]
    while position < len(content):
        piece = content[position : position + window + len(SYNC)]
        data, mark = judge.first_fit(np.frombuffer(piece, dtype=np.uint8)), piece.find(SYNC)
        found = [place for place in (data, mark) if place is not None and place >= 0]
        if found:
            return position + min(found)
        position += window
        window = _SEARCH_BYTES[1]
    return None


LARGEST_ROW: Final = 65_533
"""A message is at most 65 535 bytes long, two of which are its number."""
DEEPEST: Final = 4
"""PX4 nests once."""
MOST_FIELDS: Final = 1000

TYPES: Final[Mapping[str, str]] = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "<i1",
}
_FIELD: Final = re.compile(r"([A-Za-z_]\w*)(?:\[(\d{1,5})\])? ([A-Za-z_]\w*)")
_NAME: Final = re.compile(r"[A-Za-z_][\w\-/]*")


@frozen_dataclass
class Field:
    """A field of a format: its type, its name, and how many of it (0: one, not an array)."""

    type: str
    name: str
    count: int


@frozen_dataclass
class Row:
    """The type of a topic's rows without padding at the end; the largest size with it [bytes]."""

    dtype: np.dtype[Any]
    largest: int


def parse_format(text: str) -> tuple[str, tuple[Field, ...]] | None:
    """Parse name and fields of a format such as ``a:uint64_t timestamp;float[3] x;``.

    None where it is no format.
    """
    name, colon, listed = text.partition(":")
    parts = [part for part in listed.split(";") if part]
    if not (colon and parts and _NAME.fullmatch(name)) or len(parts) > MOST_FIELDS:
        return None
    fields: list[Field] = []
    for part in parts:
        match = _FIELD.fullmatch(part)
        if match is None:
            return None
        fields.append(Field(type=match[1], name=match[3], count=int(match[2] or 0)))
    return name, tuple(fields)


def row_of(formats: Mapping[str, tuple[Field, ...]], name: str) -> Row | None:
    """Return the row of a topic; None if its format is missing, circular or too large."""
    fields = formats.get(name, ())
    kept = list(fields)
    while kept and kept[-1].name.startswith("_padding"):
        kept.pop()
    whole = _packed_type(formats, fields, DEEPEST)
    dtype = _packed_type(formats, tuple(kept), DEEPEST)
    if whole is None or dtype is None:
        return None
    return Row(dtype=dtype, largest=whole.itemsize)


def _packed_type(
    formats: Mapping[str, tuple[Field, ...]], fields: tuple[Field, ...], depth: int
) -> np.dtype[Any] | None:
    """Return the packed type of some fields, nested formats as types within it."""
    parts: list[Any] = []
    size = 0
    names = [field.name for field in fields]
    if not fields or depth == 0 or len(set(names)) < len(names):
        return None
    for field in fields:
        inner = (
            np.dtype(TYPES[field.type])
            if field.type in TYPES
            else _packed_type(formats, formats.get(field.type, ()), depth - 1)
        )
        if inner is None:
            return None
        size += inner.itemsize * (field.count or 1)
        if size > LARGEST_ROW:
            return None
        parts.append((field.name, inner, (field.count,)) if field.count else (field.name, inner))
    return np.dtype(parts)


LARGEST_VALUE: Final = 1e100
"""Beyond it a number of double precision is damage, and its square no number."""


@frozen_dataclass
class Topic:
    """The messages of one instance of a topic, in order of time.

    Arrays of rows, and long ones of floats, are without the last elements that say nothing;
    `lengths` are as declared.
    """

    name: str
    instance: int
    rows: np.ndarray
    lengths: Mapping[str, int]

    @property
    def label(self) -> str:
        """As PX4's people write it."""
        return f"{self.name}[{self.instance}]" if self.instance else self.name

    def has(self, *fields: str) -> bool:
        """Return whether the topic has all these fields, as numbers or arrays of numbers."""
        names = self.rows.dtype.names or ()
        return all(name in names for name in fields)

    def column(self, name: str, rows: slice = slice(None)) -> Float[np.ndarray, "*shape"]:
        """Read a field as floats, a value or an array per row; anything but a number is NaN."""
        return _copy_as_floats(self.rows[name][rows])

    def has_vector(self, name: str, columns: int) -> bool:
        """Return whether a field is an array of at least so many numbers."""
        if not self.has(name) or self.rows.dtype[name].names:
            return False
        return self.rows[name].ndim == 2 and self.rows[name].shape[1] >= columns

    def has_number(self, name: str) -> bool:
        """Return whether a field is one number."""
        return self.has(name) and not self.rows.dtype[name].names and self.rows[name].ndim == 1

    def vector(self, name: str, columns: int) -> Float[np.ndarray, "n k"] | None:
        """Return a field that is an array of at least so many numbers; None if it is not."""
        return (
            _copy_as_floats(self.rows[name][:, :columns])
            if self.has_vector(name, columns)
            else None
        )

    def number(self, name: str) -> Float[np.ndarray, " n"] | None:
        """Read a field that is one number; None if it is not."""
        return self.column(name) if self.has_number(name) else None

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """When each message was published, since boot [s]."""
        stamps = self.column("timestamp")
        stamps *= 1e-6
        return stamps

    @property
    def sample_time(self) -> Float[np.ndarray, " n"]:
        """When its content was measured [s]; where it does not say, when it was published."""
        sampled = self.number("timestamp_sample")
        if sampled is None or not sampled.all():
            return self.time
        sampled *= 1e-6
        return sampled

    @property
    def rate(self) -> float:
        """Median rate [Hz]."""
        steps = np.diff(self.time)
        return 1.0 / max(float(np.median(steps)), 1e-6) if len(steps) else 0.0


def _copy_as_floats(recorded: np.ndarray) -> Float[np.ndarray, "*shape"]:
    """Copy as floats; what is no number is NaN."""
    with np.errstate(invalid="ignore"):  # some NaN of single precision signal
        values = recorded.astype(np.float64)
    if recorded.dtype.kind == "f":
        for rows in pieces(len(values)):
            some = values[rows]
            some[~(np.abs(some) < LARGEST_VALUE)] = np.nan
    return values


def part_of(dtype: np.dtype[Any], names: Container[str]) -> np.dtype[Any]:
    """Return the type of some fields of a row, and of the rows in it; of all, if it has none."""
    parts: list[Any] = []
    for name in dtype.names or ():
        if name in names:
            inner = dtype[name]
            base = part_of(inner.base, names) if inner.base.names else inner.base
            parts.append((name, base, inner.shape))
    return np.dtype(parts) if parts else dtype


def appended(kept: np.ndarray | None, rows: np.ndarray, names: Container[str] | None) -> np.ndarray:
    """Append some fields of more rows to those that were kept, in place."""
    if names is None:
        return _append_in_place(np.empty(0, rows.dtype) if kept is None else kept, rows)
    part = np.empty(len(rows), part_of(rows.dtype, names))
    _copy_fields(rows, part)
    # Of arrays of rows (the eight ESCs of a topic) and long ones of floats (twelve controls) only
    # what stands before the last one that ever says anything is kept: most vehicles have four.
    wanted = np.dtype([_cut_array(part, name, kept) for name in part.dtype.names or ()])
    if kept is None or kept.dtype != wanted:
        longer = np.zeros(0 if kept is None else len(kept), wanted)
        if kept is not None:
            _copy_fields(kept, longer)
        kept = longer
    return _append_in_place(kept, part)


def _cut_array(part: np.ndarray, name: str, kept: np.ndarray | None) -> tuple[Any, ...]:
    """Return name, type and shape of a field, an array cut behind the last part with content."""
    dtype = part.dtype[name]
    if len(dtype.shape) != 1 or not (dtype.base.names or _is_long(dtype)):
        return name, dtype.base, dtype.shape
    if dtype.base.names:
        content = np.ascontiguousarray(part[name]).view(np.uint8)
        used = content.reshape(len(part), dtype.shape[0], -1).any(axis=(0, 2))
    else:
        used = ~np.isnan(part[name]).all(axis=0)
    before = 1 if kept is None else int(kept.dtype[name].shape[0])
    return name, dtype.base, (max(int(np.flatnonzero(used)[-1]) + 1 if used.any() else 1, before),)


def _is_long(dtype: np.dtype[Any]) -> bool:
    """Return whether an array is of floats and longer than a quaternion, as that of controls."""
    return dtype.base.kind == "f" and dtype.shape[0] > 4


def _append_in_place(kept: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Append rows in place: pieces that are joined in the end would take twice the memory."""
    known = len(kept)
    kept.resize(known + len(rows), refcheck=False)
    _copy_fields(rows, kept[known:])
    return kept


def _copy_fields(rows: np.ndarray, target: np.ndarray) -> None:
    """Copy the fields that the target has, and as much of them."""
    if not target.dtype.names:
        target[...] = rows
    for name in target.dtype.names or ():
        there, here = target[name], rows[name]
        if there.ndim > 1:
            count = min(there.shape[1], here.shape[1])
            if there.dtype.kind == "f":
                there[:, count:] = np.nan  # what was cut off before
            there, here = there[:, :count], here[:, :count]
        _copy_fields(here, there)
