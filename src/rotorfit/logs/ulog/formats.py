"""Message formats of a ULog, from their text to NumPy types of bounded size."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

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
    """How a row of a topic lies in its message.

    Attributes
    ----------
    dtype
        Without the padding at the end, which the logger leaves out.
    largest
        Bytes with that padding.
    """

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
