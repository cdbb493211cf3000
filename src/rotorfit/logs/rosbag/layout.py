"""Where the numbers stand in serialised messages, and the columns that they make of many.

A message of ROS 1 has its fields one after the other, little-endian. CDR (OMG, as in ROS 2) has
four bytes before them, and each number at a multiple of its size. Strings and sequences have their
length before them; messages of one size whose lengths agree have all numbers in the same places,
and a thousand of them are read at once.
"""

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.definitions import PRIMITIVES, SEQUENCE, STRING, Field, Types
from rotorfit.logs.rosbag.stream import Encoding

_DEEPEST: Final = 12
_MOST_NUMBERS: Final = 1024
"""Fields, or elements of an array of messages, in one message that is read."""
_INDEX: Final = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Numbers:
    """Numbers of one kind that stand side by side in a message.

    Attributes
    ----------
    offset
        Of the first one [bytes].
    kind
        As in NumPy, with byte order.
    count
        How many.
    """

    offset: int
    kind: str
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The places in messages of one size whose lengths agree.

    Attributes
    ----------
    numbers
        By path, such as ``header.stamp.sec``, ``esc[0].rpm`` or ``data`` for a whole array.
    lengths
        Places of the lengths of strings and sequences.
    end
        Where the definition ends; a message may be longer.
    """

    numbers: Mapping[str, Numbers]
    lengths: tuple[int, ...]
    end: int

    def find(self, pattern: str) -> list[Numbers]:
        """Return the numbers of a path; ``[]`` in it stands for every element, in order."""
        if pattern in self.numbers:
            return [self.numbers[pattern]]
        if found := _INDEX.fullmatch(pattern):
            array, index = self.numbers.get(found[1]), int(found[2])
            if array is not None and index < array.count:
                size = int(array.kind[-1])
                return [Numbers(offset=array.offset + index * size, kind=array.kind, count=1)]
        before, mark, after = pattern.partition("[]")
        if not mark:
            return []
        elements: list[Numbers] = []
        while (path := f"{before}[{len(elements)}]{after}") in self.numbers:
            elements.append(self.numbers[path])
        return elements


class _Walk:
    """Goes through one message; has a state, which is the place in it."""

    __slots__ = ("_aligned", "_data", "_order", "_types", "_visited", "lengths", "numbers", "place")

    def __init__(self, data: bytes, types: Types, encoding: Encoding) -> None:
        self._data = data
        self._types = types
        self._aligned = encoding == "cdr"
        self._order = "<"
        self._visited = 0
        self.place = 0
        self.numbers: dict[str, Numbers] = {}
        self.lengths: list[int] = []
        if self._aligned:
            if data[:2] not in (b"\x00\x00", b"\x00\x01"):
                raise LogError("a message is not plain CDR")
            self._order = "<" if data[1] else ">"
            self.place = 4

    def message(self, kind: str, path: str, depth: int = 0) -> None:
        """Go through a message inside."""
        fields = self._types.get(kind)
        if fields is None or depth > _DEEPEST:
            why = "is not defined in the file" if fields is None else "goes too deep"
            raise LogError(f"the message {kind[:80]} {why}")
        for field in fields:
            self._field(field, f"{path}.{field.name}" if path else field.name, depth)

    def _field(self, field: Field, path: str, depth: int) -> None:
        self._count()
        count = field.count
        if count == SEQUENCE:
            count = self._length()
        if field.kind in PRIMITIVES:
            self._numbers(path, PRIMITIVES[field.kind], 1 if count is None else count)
        elif count is None:
            self._one(field.kind, path, depth)
        else:
            for index in range(count):
                self._count()
                self._one(field.kind, f"{path}[{index}]", depth)

    def _one(self, kind: str, path: str, depth: int) -> None:
        if kind == STRING:
            length = self._length()  # moves the place itself
            self.place += length
            self._refuse_end()
        else:
            self.message(kind, path, depth + 1)

    def _numbers(self, path: str, kind: str, count: int) -> None:
        size = int(kind[1])
        if count:
            self._align(size)
        self.numbers[path] = Numbers(offset=self.place, kind=f"{self._order}{kind}", count=count)
        self.place += size * count
        self._refuse_end()

    def _length(self) -> int:
        self._align(4)
        self.lengths.append(self.place)
        self.place += 4
        self._refuse_end()
        (length,) = struct.unpack_from(f"{self._order}I", self._data, self.place - 4)
        return int(length)

    def _align(self, size: int) -> None:
        if self._aligned:
            self.place = 4 + -(-(self.place - 4) // size) * size

    def _refuse_end(self) -> None:
        if self.place > len(self._data):
            raise LogError("a message is shorter than its definition")

    def _count(self) -> None:
        self._visited += 1
        if self._visited > _MOST_NUMBERS:
            raise LogError(f"a message has more than {_MOST_NUMBERS} fields")


def layout_of(data: bytes, kind: str, types: Types, encoding: Encoding) -> Layout:
    """Return the places in one message.

    Raises
    ------
    LogError
        If the message does not fit its definition.
    """
    walk = _Walk(data, types, encoding)
    walk.message(kind, "")
    return Layout(numbers=walk.numbers, lengths=tuple(walk.lengths), end=walk.place)


def columns_of(
    layout: Layout, messages: UInt8[np.ndarray, "n size"], patterns: Sequence[str]
) -> Float[np.ndarray, "n k"]:
    """Return numbers of many messages of one layout, one row each."""
    parts = [
        np.ascontiguousarray(messages[:, place.offset : place.offset + width])
        .view(place.kind)
        .astype(np.float64)
        for pattern in patterns
        for place in layout.find(pattern)
        if (width := place.count * int(place.kind[-1]))
    ]
    return np.concatenate(parts, axis=1) if parts else np.zeros((len(messages), 0))
