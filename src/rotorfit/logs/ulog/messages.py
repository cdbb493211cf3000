"""A ULog as bytes: where each message begins, across damage, in bounded memory.

After a header of 16 bytes come messages of a length (2 bytes), a letter and a content. The file is
read in blocks; a step through the lengths finds the messages of a block, and where it meets what is
no message, the search goes on at the next synchronisation mark or data message that fits.
Format: docs.px4.io, "ULog File Format".
"""

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO, Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int, UInt8

from rotorfit.errors import LogError

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


@dataclass(frozen=True, slots=True, kw_only=True)
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
        block, used = _walk(rest + fresh, judge, is_last=left == 0)
        yield block
        rest = block.content[used:]


def _walk(content: bytes, judge: Judge, *, is_last: bool) -> tuple[Block, int]:
    """Return the messages of some bytes, and how many of the bytes are done with."""
    parts: list[Int[np.ndarray, " n"]] = []
    position = skipped = places = 0
    while True:
        starts, position = _chain(content, position)
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
    """Raise where a file is damaged in so many places that it is hardly a log."""
    if places > MOST_PLACES:
        raise LogError(
            f"damaged in more than {MOST_PLACES} places, expected a log of PX4: copy it again from "
            "the card"
        )


def _chain(content: bytes, position: int) -> tuple[Int[np.ndarray, " n"], int]:
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
    """Tell whether what begins at a place looks like a message that goes on past the end."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A field of a format: its type, its name, and how many of it (0: one, not an array)."""

    type: str
    name: str
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The type of a topic's rows without padding at the end; the largest size with it [bytes]."""

    dtype: np.dtype[Any]
    largest: int


def parse_format(text: str) -> tuple[str, tuple[Field, ...]] | None:
    """Return name and fields of a format such as ``a:uint64_t timestamp;float[3] x;``.

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
    """Return the row of a topic; None where its format is missing, circular or too large."""
    fields = formats.get(name, ())
    kept = list(fields)
    while kept and kept[-1].name.startswith("_padding"):
        kept.pop()
    whole = _dtype(formats, fields, DEEPEST)
    dtype = _dtype(formats, tuple(kept), DEEPEST)
    if whole is None or dtype is None:
        return None
    return Row(dtype=dtype, largest=whole.itemsize)


def _dtype(
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
            else _dtype(formats, formats.get(field.type, ()), depth - 1)
        )
        if inner is None:
            return None
        size += inner.itemsize * (field.count or 1)
        if size > LARGEST_ROW:
            return None
        parts.append((field.name, inner, (field.count,)) if field.count else (field.name, inner))
    return np.dtype(parts)
