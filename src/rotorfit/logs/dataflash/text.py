"""DataFlash logs in their text form (.log), as Mission Planner writes it, turned into messages.

Each line is a message: its name, then its fields, scaled as their letters say. ``FMT`` lines define
the messages as in the binary form, so that the same reader takes both.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, Final

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash import HEAD
from rotorfit.logs.dataflash.messages import FMT_TYPE, HEAD_BYTES, LETTERS
from rotorfit.logs.files import read_blocks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_PACKED: Final = {
    "b": "b",
    "B": "B",
    "h": "h",
    "H": "H",
    "i": "i",
    "I": "I",
    "q": "q",
    "Q": "Q",
    "g": "e",
    "f": "f",
    "d": "d",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "M": "b",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "a": "64s",
}
"""Letter of `struct` by letter of a definition."""
_TEXTS: Final = "nNZ"
_FLOATS: Final = "gfd"
_DEFINITION: Final = re.compile(r"\s*FMT\s*,\s*(\d+)\s*,\s*\d+\s*,\s*(\w+)\s*,\s*(\w*)\s*,?(.*)")
_BLOCK_LINES: Final = 4096


@frozen_dataclass
class _Line:
    """How the fields of a message are packed behind its head."""

    head: bytes
    letters: str
    packer: struct.Struct
    converters: tuple[Callable[[str], object], ...]


def binary_blocks(path: Path) -> list[bytes]:
    """Return a text log as pieces of the binary form; lines that are no messages stay damage."""
    known: dict[str, _Line] = {}
    return list(_encode_lines(path, known))


def _encode_lines(path: Path, known: dict[str, _Line]) -> Iterator[bytes]:
    rest = ""
    for block in read_blocks(path, (0.0, 0.4)):
        lines = (rest + block.decode("latin-1")).split("\n")
        rest = lines.pop()
        for start in range(0, len(lines), _BLOCK_LINES):
            some = lines[start : start + _BLOCK_LINES]
            yield b"".join([_message_of(line, known) for line in some])
    yield _message_of(rest, known)


def _message_of(line: str, known: dict[str, _Line]) -> bytes:
    """Convert a line to a binary message; return its bytes unchanged if it is no message."""
    name, _, fields = line.partition(",")
    name = name.strip()
    if name == "FMT":
        return _definition_of(line, known)
    form = known.get(name)
    if form is None:
        return line.strip().encode("latin-1")
    cells = fields.split(",", len(form.letters) - 1)
    try:
        values = [to(cell.strip()) for to, cell in zip(form.converters, cells, strict=True)]
        return form.head + form.packer.pack(*values)
    except (ValueError, struct.error, OverflowError):
        return line.strip().encode("latin-1")


def _definition_of(line: str, known: dict[str, _Line]) -> bytes:
    """Take in the definition of a message, and return its binary form."""
    found = _DEFINITION.fullmatch(line.rstrip())
    if found is None or int(found[1]) > 255 or any(c not in _PACKED for c in found[3]):
        return line.strip().encode("latin-1")
    number, name, letters = int(found[1]), found[2], found[3]
    packer = struct.Struct("<" + "".join(_PACKED[letter] for letter in letters))
    length = HEAD_BYTES + packer.size
    if length > 255:
        return line.strip().encode("latin-1")
    labels = ",".join(label.strip() for label in found[4].split(","))
    if number != FMT_TYPE:
        known[name] = _Line(
            head=HEAD + bytes([number]),
            letters=letters,
            packer=packer,
            converters=tuple(_cell_converter(letter) for letter in letters),
        )
    texts = (name.encode("latin-1"), letters.encode("latin-1"), labels.encode("latin-1"))
    return HEAD + bytes([FMT_TYPE]) + struct.pack("<BB4s16s64s", number, length, *texts)


def _cell_converter(letter: str) -> Callable[[str], object]:
    """Return the function from a cell to the number or text that the binary form has."""
    if letter in _TEXTS:
        return lambda cell: cell.encode("latin-1")
    if letter in _FLOATS:
        return float
    if letter == "a":
        return lambda _: bytes(64)
    if letter == "M":
        # Mission Planner writes the flight mode's name, whose number nothing here needs.
        return lambda cell: int(cell) if cell.lstrip("-").isdecimal() else 0
    divisor = LETTERS[letter][1]
    if divisor is not None:
        return lambda cell: round(float(cell) * divisor)
    return lambda cell: int(cell) if "." not in cell else round(float(cell))
