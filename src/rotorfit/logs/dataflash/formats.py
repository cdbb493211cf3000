"""What a DataFlash log declares: the formats of its messages, their fields and units.

A message is the bytes A3 95, a type, and a body of fixed length. Messages of type 128 (FMT) tell
the others' name, length, letters and labels; FMTU, UNIT and MULT, where they are, the units.
Sources: AP_Logger/LogStructure.h of ArduPilot, and its page "Adding a new log message".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

HEAD_BYTES: Final = 3
"""Of a message: the two bytes above and its type."""
FMT_TYPE: Final = 128
FMT_BYTES: Final = 89
LONGEST: Final = 255

LETTERS: Final[Mapping[str, tuple[str, float | None]]] = {
    "a": ("(32,)<i2", None),
    "b": ("<i1", None),
    "B": ("<u1", None),
    "h": ("<i2", None),
    "H": ("<u2", None),
    "i": ("<i4", None),
    "I": ("<u4", None),
    "q": ("<i8", None),
    "Q": ("<u8", None),
    "g": ("<f2", None),
    "f": ("<f4", None),
    "d": ("<f8", None),
    "n": ("S4", None),
    "N": ("S16", None),
    "Z": ("S64", None),
    "M": ("<i1", None),
    "c": ("<i2", 1e2),
    "C": ("<u2", 1e2),
    "e": ("<i4", 1e2),
    "E": ("<u4", 1e2),
    "L": ("<i4", 1e7),
}
"""NumPy type of each letter, and what its integers are divided by."""

TIMES: Final[Mapping[str, float]] = {"TimeUS": 1e-6, "TimeMS": 1e-3}
"""Labels of a message's time, and their units [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A field of a message.

    Attributes
    ----------
    letter
        Of `LETTERS`.
    offset
        From the first byte of the message.
    """

    letter: str
    offset: int

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """As the file has it."""
        return np.dtype(LETTERS[self.letter][0])

    @property
    def divisor(self) -> float | None:
        """What scaled integers are divided by; None: nothing."""
        return LETTERS[self.letter][1]


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageFormat:
    """One definition of a type of message.

    Attributes
    ----------
    type
        Its number.
    name
        Such as ``"IMU"``.
    length
        With the head [bytes].
    letters, labels
        Of the fields, as declared.
    fields
        By label; empty where letters and length contradict each other, and nothing can be read.
    """

    type: int
    name: str
    length: int
    letters: str
    labels: tuple[str, ...]
    fields: Mapping[str, Field]


FMT_OF_FMT: Final = MessageFormat(
    type=FMT_TYPE,
    name="FMT",
    length=FMT_BYTES,
    letters="BBnNZ",
    labels=("Type", "Length", "Name", "Format", "Columns"),
    fields={
        label: Field(letter=letter, offset=offset)
        for label, letter, offset in (
            *(("Type", "B", 3), ("Length", "B", 4), ("Name", "n", 5)),
            *(("Format", "N", 9), ("Columns", "Z", 25)),
        )
    },
)


def message_format(body: bytes) -> MessageFormat:
    """Return the definition in the body of an FMT message (86 bytes, without its head)."""
    letters, labels = _text(body[6:22]), tuple(_text(body[22:86]).split(","))
    length = body[1]
    return MessageFormat(
        type=body[0],
        name=_text(body[2:6]),
        length=length,
        letters=letters,
        labels=labels,
        fields=_fields(letters, labels, length),
    )


def _text(data: bytes) -> str:
    """Return what stands before the first null byte."""
    return data.split(b"\0", 1)[0].decode("latin-1")


def _fields(letters: str, labels: tuple[str, ...], length: int) -> dict[str, Field]:
    """Return the fields of a message; none where the letters do not add up to its length.

    Long lists of labels are cut off at 64 bytes: then only the first fields have a name.
    """
    if any(letter not in LETTERS for letter in letters):
        return {}
    places: list[Field] = []
    offset = HEAD_BYTES
    for letter in letters:
        places.append(Field(letter=letter, offset=offset))
        offset += places[-1].dtype.itemsize
    if offset != length:
        return {}
    return dict(zip(labels, places, strict=False))
