"""Where the messages of a DataFlash log are, found block by block, and the bytes of some."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash import HEAD

if TYPE_CHECKING:
    from jaxtyping import Bool, Int, UInt8

HEAD_BYTES: Final = 3
"""Head of a message: the two bytes above and its type."""
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


@frozen_dataclass
class Field:
    """A field of a message: a letter of `LETTERS`, and its offset in the message [bytes]."""

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


@frozen_dataclass
class MessageFormat:
    """One definition of a type of message; `length` is with the head [bytes].

    There are no `fields` where letters and length contradict each other.
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
    letters, labels = _decode_text(body[6:22]), tuple(_decode_text(body[22:86]).split(","))
    length = body[1]
    return MessageFormat(
        type=body[0],
        name=_decode_text(body[2:6]),
        length=length,
        letters=letters,
        labels=labels,
        fields=_lay_out_fields(letters, labels, length),
    )


def _decode_text(data: bytes) -> str:
    """Decode the text before the first null byte."""
    return data.split(b"\0", 1)[0].decode("latin-1")


def _lay_out_fields(letters: str, labels: tuple[str, ...], length: int) -> dict[str, Field]:
    """Lay out the fields of a message; empty if the letters do not add up to its length."""
    if any(letter not in LETTERS for letter in letters):
        return {}
    places: list[Field] = []
    offset = HEAD_BYTES
    for letter in letters:
        places.append(Field(letter=letter, offset=offset))
        offset += places[-1].dtype.itemsize
    if offset != length:
        return {}
    # Long lists of labels are cut off at 64 bytes: then only the first fields have a name.
    return dict(zip(labels, places, strict=False))


AHEAD: Final = 2 * LONGEST + HEAD_BYTES
"""Bytes after a head that decide about it: its message, the next one, and the head after that."""
FEW_HEADS: Final = 64
"""Looked at together while definitions come in; each one changes what the next heads mean."""
MOST_FORMATS: Final = 1000
"""Most formats of one log; a type has one byte, and firmware defines it once."""
MOST_REDEFINITIONS: Final = 2000
GLIMPSES: Final = 8
"""Runs of messages that are looked at together, of names that are only glimpsed."""


@frozen_dataclass
class Messages:
    """The messages of a log.

    - `formats`: all that the log defines, the FMT of FMT first. One defined again is there twice.
    - `rows`: the messages of the formats wanted, in the order of the file, by index of `formats`,
      whose fields say where in them each one is.
    - `damaged_places`, `skipped_bytes`: where no message could be read.
    - `dropped`: messages left out because another begins within them.
    - `trailing_bytes`: after the last message.
    - `bad_formats`: unusable definitions: a length below 3, or FMT itself defined again.
    """

    formats: tuple[MessageFormat, ...]
    counts: tuple[int, ...]
    rows: Mapping[int, UInt8[np.ndarray, "n length"]]
    damaged_places: int
    skipped_bytes: int
    dropped: int
    trailing_bytes: int
    bad_formats: int

    def without(self, names: Container[str]) -> Messages:
        """Drop the bytes of some messages."""
        rows = {i: r for i, r in self.rows.items() if self.formats[i].name not in names}
        return replace(self, rows=rows)

    def only(self, names: Container[str]) -> Messages:
        """Keep the bytes of some messages alone."""
        rows = {i: r for i, r in self.rows.items() if self.formats[i].name in names}
        return replace(self, rows=rows)

    def named(self, name: str) -> list[int]:
        """Find the formats of that name that have messages, as indices."""
        return [i for i, f in enumerate(self.formats) if f.name == name and self.counts[i]]

    def count(self, name: str) -> int:
        """Count the messages of that name."""
        return sum(self.counts[i] for i in self.named(name))


@frozen_dataclass
class Wanted:
    """Which messages are kept, so that a long log need not fit into the memory.

    Attributes
    ----------
    names
        Kept whole; None: all.
    glimpsed
        Names of which some of the first are kept.
    instances
        Names of messages with a one-byte field I, of which only this number is kept.
    labels
        Names of messages of which only the fields with these labels are kept.
    """

    names: Container[str] | None = None
    glimpsed: Container[str] = ()
    instances: Mapping[str, int] = field(default_factory=dict[str, int])
    labels: Mapping[str, Container[str]] = field(default_factory=dict[str, Container[str]])


ALL: Final = Wanted()


@dataclass(slots=True, kw_only=True)
class _Walk:
    """What is known on the way through the file: the one thing here that changes."""

    wanted: Wanted
    formats: list[MessageFormat] = field(default_factory=lambda: [FMT_OF_FMT])
    indices: dict[bytes, int] = field(default_factory=dict[bytes, int])
    lengths: Int[np.ndarray, " 256"] = field(default_factory=lambda: np.zeros(256, np.int64))
    current: Int[np.ndarray, " 256"] = field(default_factory=lambda: np.zeros(256, np.int64))
    counts: list[int] = field(default_factory=lambda: [0])
    rows: dict[int, UInt8[np.ndarray, "n length"]] = field(default_factory=dict[int, np.ndarray])
    glimpses: dict[int, int] = field(default_factory=dict[int, int])
    searching: bool = False
    searched_bytes: int = 0
    redefinitions: int = 0
    damaged_places: int = 0
    skipped_bytes: int = 0
    dropped: int = 0
    bad_formats: int = 0


@frozen_dataclass
class _Block:
    """A piece of the file: its bytes, where heads are, and up to where those can be decided."""

    raw: UInt8[np.ndarray, " n"]
    heads: Int[np.ndarray, " h"]
    stop: int
    is_last: bool


def find_messages(blocks: Iterable[bytes], *, wanted: Wanted = ALL) -> Messages:
    """Find the messages of a log."""
    walk = _Walk(wanted=wanted)
    walk.lengths[FMT_TYPE] = FMT_OF_FMT.length
    rest = b""
    for block in blocks:
        data = rest + block
        # Each message's length says where the next one begins. Where no message of a known type
        # begins, the search goes on at the next one that another one follows; a message within
        # which that one begins is left out.
        rest = data[_read_block(walk, data, is_last=False) :]
    trailing = len(rest) - _read_block(walk, rest, is_last=True)
    return Messages(
        formats=tuple(_pack_format(form, wanted) for form in walk.formats),
        counts=tuple(walk.counts),
        rows=walk.rows,
        damaged_places=walk.damaged_places,
        skipped_bytes=walk.skipped_bytes,
        dropped=walk.dropped,
        trailing_bytes=trailing + walk.searched_bytes,
        bad_formats=walk.bad_formats,
    )


def _pack_format(form: MessageFormat, wanted: Wanted) -> MessageFormat:
    """Return a format with the fields that are kept, one behind the other."""
    if form.name not in wanted.labels:
        return form
    fields: dict[str, Field] = {}
    offset = 0
    for label, one in _fields_kept(form, wanted):
        fields[label] = replace(one, offset=offset)
        offset += one.dtype.itemsize
    return replace(form, fields=fields)


def _fields_kept(form: MessageFormat, wanted: Wanted) -> list[tuple[str, Field]]:
    labels = wanted.labels[form.name]
    return [(label, one) for label, one in form.fields.items() if label in labels]


def _read_block(walk: _Walk, data: bytes, *, is_last: bool) -> int:
    """Take the messages of a piece, and return how many of its bytes are done with."""
    raw = np.frombuffer(data, np.uint8)
    stop = len(raw) if is_last else len(raw) - AHEAD
    if stop <= 0:
        return 0
    heads = np.flatnonzero((raw[:-2] == HEAD[0]) & (raw[1:-1] == HEAD[1]))
    block = _Block(raw=raw, heads=heads, stop=stop, is_last=is_last)
    decided = int(np.searchsorted(heads, stop))
    position, span = 0, FEW_HEADS
    while (first := int(np.searchsorted(heads, position))) < decided:
        redefinitions = walk.redefinitions
        reached = _read_heads(walk, block, (first, min(first + span, decided)), position)
        if reached == position:  # the file ends within the message there
            return position
        position = reached
        span = FEW_HEADS if walk.redefinitions > redefinitions else 4 * span
    if position >= stop - (HEAD_BYTES - 1) * is_last and not walk.searching:
        return position
    walk.searching = True
    walk.searched_bytes += stop - position
    return stop


def _read_heads(walk: _Walk, block: _Block, span: tuple[int, int], position: int) -> int:
    """Take the messages of some heads while definitions stay; return where to go on."""
    first, last = span
    heads = block.heads[first:last]
    lengths = walk.lengths[block.raw[heads + 2]]
    ends = heads + lengths
    is_joined = np.zeros(len(heads), dtype=bool)
    is_joined[:-1] = (lengths[:-1] > 0) & (lengths[1:] > 0) & (ends[:-1] == heads[1:])
    # Every definition is looked at by itself: it may change what follows.
    breaks = np.flatnonzero(~is_joined | (block.raw[heads + 2] == FMT_TYPE))
    runs: list[tuple[int, int]] = []
    formats = walk.current.copy()
    while position < heads[-1] + 1:
        k = int(np.searchsorted(heads, position))
        if walk.searching or heads[k] != position or lengths[k] == 0:
            position = _search_head(walk, block, heads[k:], position)
            if walk.searching:
                break
            continue
        e = int(breaks[np.searchsorted(breaks, k)])
        position = int(ends[e])
        if position > len(block.raw):
            position = int(heads[e])
            runs.append((k, e))
            break
        is_changed = _define_message(walk, block, int(heads[e]))
        inner = _inner_message(walk, block, int(heads[e]), position)
        runs.append((k, e + (inner is None)))
        if inner is not None:
            position = _after_damage(walk, int(heads[e]), inner)
        if is_changed:
            break
    _keep_messages(walk, block, heads, runs, formats)
    return position


def _linked_heads(
    walk: _Walk, block: _Block, heads: Int[np.ndarray, " h"]
) -> Bool[np.ndarray, " h"]:
    """Select which heads are of a known type, and their messages end where another one begins."""
    raw, size = block.raw, len(block.raw)
    lengths = walk.lengths[raw[heads + 2]]
    ends = heads + lengths
    at_end = (ends <= size) & (ends > size - HEAD_BYTES) & block.is_last
    places = np.minimum(ends, size - HEAD_BYTES)
    follows = (raw[places] == HEAD[0]) & (raw[places + 1] == HEAD[1])
    follows &= (walk.lengths[raw[places + 2]] > 0) & (places == ends)
    return (lengths > 0) & (follows | at_end)


def _search_head(walk: _Walk, block: _Block, heads: Int[np.ndarray, " h"], position: int) -> int:
    """Find the first head that can be trusted, else the place after the last one."""
    first, span = 0, FEW_HEADS
    while first < len(heads):
        good = np.flatnonzero(_linked_heads(walk, block, heads[first : first + span]))
        if len(good):
            found = int(heads[first + good[0]])
            walk.skipped_bytes += walk.searched_bytes + found - position
            walk.damaged_places += 1
            walk.searching, walk.searched_bytes = False, 0
            return found
        first, span = first + span, 4 * span
    walk.searching = True
    walk.searched_bytes += int(heads[-1]) + 1 - position
    return int(heads[-1]) + 1


def _inner_message(walk: _Walk, block: _Block, start: int, end: int) -> int | None:
    """Find a message that begins inside one that no message follows; None if there is none."""
    following = block.raw[end : end + HEAD_BYTES]
    if len(following) < HEAD_BYTES:
        return None
    if bytes(following[:2]) == HEAD and walk.lengths[following[2]] > 0:
        return None
    first, last = np.searchsorted(block.heads, [start + 1, end])
    inner = block.heads[first:last]
    good = inner[_linked_heads(walk, block, inner)]
    return int(good[0]) if len(good) else None


def _after_damage(walk: _Walk, start: int, inner: int) -> int:
    """Count a message that is left out for the one that begins within it; return where."""
    walk.dropped += 1
    walk.damaged_places += 1
    walk.skipped_bytes += inner - start
    return inner


def _define_message(walk: _Walk, block: _Block, position: int) -> bool:
    """Take in the definition at a position, if one is there; return whether anything changed."""
    if block.raw[position + 2] != FMT_TYPE:
        return False
    body = block.raw[position + HEAD_BYTES : position + FMT_OF_FMT.length].tobytes()
    number, length = body[0], body[1]
    if length < HEAD_BYTES or number == FMT_TYPE:
        walk.bad_formats += message_format(body) != FMT_OF_FMT
        return False
    index = walk.indices.get(body)
    if index is None:
        index = walk.indices[body] = len(walk.formats)
        walk.formats.append(message_format(body))
        walk.counts.append(0)
    if walk.current[number] == index and walk.lengths[number] == length:
        return False
    walk.current[number], walk.lengths[number] = index, length
    walk.redefinitions += 1
    if len(walk.formats) > MOST_FORMATS or walk.redefinitions > MOST_REDEFINITIONS:
        raise LogError(
            f"defines its messages {walk.redefinitions} times, expected once each: the file is "
            "damaged, or no log; download it from the autopilot again"
        )
    return True


def _keep_messages(
    walk: _Walk,
    block: _Block,
    heads: Int[np.ndarray, " h"],
    runs: list[tuple[int, int]],
    formats: Int[np.ndarray, " 256"],
) -> None:
    """Count the messages of some runs of heads, and copy the bytes of those that are wanted."""
    if not runs:
        return
    found = np.concatenate([heads[first:last] for first, last in runs])
    indices = formats[block.raw[found + 2]]
    for index, count in enumerate(np.bincount(indices).tolist()):
        if count == 0:
            continue
        walk.counts[index] += count
        form = walk.formats[index]
        wanted, glimpses = walk.wanted, walk.glimpses.get(index, 0)
        is_glimpsed = form.name in wanted.glimpsed and glimpses < GLIMPSES
        walk.glimpses[index] = glimpses + is_glimpsed
        if wanted.names is None or form.name in wanted.names or is_glimpsed:
            windows = np.lib.stride_tricks.sliding_window_view(block.raw, form.length)
            rows = windows[found[indices == index]]
            number = form.fields.get("I")
            if form.name in wanted.instances and number is not None and number.letter in "bB":
                rows = rows[rows[:, number.offset] == wanted.instances[form.name]]
            _append_rows(walk, index, rows)


def _append_rows(walk: _Walk, index: int, rows: UInt8[np.ndarray, "n length"]) -> None:
    """Add messages to those of their format, grown where they are: joined pieces take twice."""
    form = walk.formats[index]
    if form.name in walk.wanted.labels:
        kept = [one for _, one in _fields_kept(form, walk.wanted)]
        spans = [np.arange(one.offset, one.offset + one.dtype.itemsize) for one in kept]
        rows = rows[:, np.concatenate([np.arange(0), *spans])]
    grown = walk.rows.setdefault(index, np.empty((0, rows.shape[1]), np.uint8))
    known = len(grown)
    grown.resize((known + len(rows), rows.shape[1]), refcheck=False)
    grown[known:] = rows
