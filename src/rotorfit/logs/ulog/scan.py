"""A ULog file to the rows of chosen topics, the parameters, and what was lost or damaged."""

from __future__ import annotations

import hashlib
import math
import os
import re
import struct
from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, BinaryIO, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import open_file, read_head, report_progress
from rotorfit.logs.flight_log import in_order
from rotorfit.logs.ulog import MAGIC
from rotorfit.logs.ulog.messages import (
    HEADER_BYTES,
    Block,
    Field,
    Row,
    Topic,
    appended,
    parse_format,
    read_blocks,
    refuse_ruin,
    row_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from jaxtyping import Int, UInt8

Value = int | float
Wanted = Mapping[str, Container[str] | None]
"""Topics to keep, and the fields of each; None: all."""
MOST_TOPICS: Final = 2000
"""PX4 logs up to 255."""
LONGEST_TEXT: Final = 200
MOST_TEXTS: Final = 10_000
DATA: Final = ord("D")
APPENDED: Final = 1
"""Bit of the first byte of the incompatible flags."""
SYSTEM_DEFAULT, AIRFRAME_DEFAULT = 1, 2
"""Bits of a default's kind: the firmware's, and that of the chosen airframe."""
LARGEST_NUMBER: Final = 1 << 16
LONGEST_DECLARATION: Final = 1 << 14
"""Looked for after damage [bytes]; the longest format of PX4 has about a thousand."""
LONGEST_SUBSCRIPTION: Final = 100
_DECLARATION: Final = re.compile(
    rb"(..)(?=F[A-Za-z_][\w/-]{0,80}:|P.(?:int32_t|float) \w|A...\w)", re.DOTALL
)


@frozen_dataclass
class Scan:
    """What a file has.

    - `topics`: those that were asked for and have messages, by name; instances in order.
    - `counts`: messages of every topic, by name.
    - `parameters`: at the start of the log.
    - `system_defaults`, `airframe_defaults`: defaults of the firmware and of the airframe, where
      they differ from the parameters.
    - `changes`: parameters that changed in the log: name, value before, value after.
    - `info`: texts and numbers such as the version.
    - `dropouts`: how long the logger lost messages, each time [ms].
    - `appended`: number of stretches that were appended later.
    - `damage`: what was damaged, one sentence each.
    """

    topics: Mapping[str, tuple[Topic, ...]]
    counts: Mapping[str, int]
    parameters: Mapping[str, Value]
    system_defaults: Mapping[str, Value]
    airframe_defaults: Mapping[str, Value]
    knows_defaults: bool
    changes: tuple[tuple[str, Value, Value], ...]
    info: Mapping[str, str | int]
    dropouts: tuple[int, ...]
    appended: int
    damage: tuple[str, ...]
    sha256: str

    def without(self, names: Container[str]) -> Scan:
        """Drop the messages of some topics."""
        return replace(self, topics={n: t for n, t in self.topics.items() if n not in names})

    def only(self, names: Container[str]) -> Scan:
        """Keep the messages of some topics alone."""
        return replace(self, topics={n: t for n, t in self.topics.items() if n in names})

    def all(self, name: str) -> tuple[Topic, ...]:
        """Find the instances of a topic."""
        return self.topics.get(name, ())

    def first(self, name: str) -> Topic | None:
        """Find the first instance of a topic."""
        return next(iter(self.all(name)), None)

    def number(self, name: str) -> float | None:
        """Read a parameter; None if the log does not have it."""
        value = self.parameters.get(name)
        return None if value is None else float(value)

    def last(self, name: str) -> float | None:
        """Return a parameter as the log left it; None if the log does not have it."""
        changed = [after for known, _, after in self.changes if known == name]
        return float(changed[-1]) if changed else self.number(name)


@frozen_dataclass
class _Subscription:
    name: str
    instance: int
    row: Row | None


@dataclass(slots=True, kw_only=True)
class _Reading:
    """The state of a file while it is read: what was declared so far, and what was kept."""

    wanted: Wanted
    formats: dict[str, tuple[Field, ...]] = field(default_factory=dict[str, tuple[Field, ...]])
    subscribed: dict[int, _Subscription] = field(default_factory=dict[int, _Subscription])
    layouts: dict[str, Row] = field(default_factory=dict[str, Row])
    rows: dict[int, np.ndarray] = field(default_factory=dict[int, np.ndarray])
    counts: np.ndarray = field(default_factory=lambda: np.zeros(LARGEST_NUMBER, dtype=np.int64))
    # Smallest and largest length of a data message by its number; none fits an unknown number.
    smallest: np.ndarray = field(
        default_factory=lambda: np.full(LARGEST_NUMBER, LARGEST_NUMBER, dtype=np.int64)
    )
    largest: np.ndarray = field(default_factory=lambda: np.zeros(LARGEST_NUMBER, dtype=np.int64))
    is_known: np.ndarray = field(default_factory=lambda: np.zeros(LARGEST_NUMBER, dtype=bool))
    parameters: dict[str, Value] = field(default_factory=dict[str, Value])
    now: dict[str, Value] = field(default_factory=dict[str, Value])
    defaults: dict[int, dict[str, Value]] = field(
        default_factory=lambda: {SYSTEM_DEFAULT: {}, AIRFRAME_DEFAULT: {}}
    )
    changes: list[tuple[str, Value, Value]] = field(default_factory=list[tuple[str, Value, Value]])
    info: dict[str, str | int] = field(default_factory=dict[str, str | int])
    dropouts: list[int] = field(default_factory=list[int])
    skipped: int = 0
    places: int = 0
    trailing: int = 0

    def accept(self, content: bytes, starts: Int[np.ndarray, " n"]) -> int:
        """Take declarations in, and return how many messages come before one that is unsound."""
        raw = np.frombuffer(content, dtype=np.uint8)
        kinds = raw[starts + 2]
        for start in starts[(kinds != DATA) & (kinds != ord("S"))].tolist():
            size, kind = struct.unpack_from("<HB", content, start)
            self._declare_message(chr(kind), content[start + 3 : start + 3 + size])
        data = np.flatnonzero(kinds == DATA)
        places = starts[data]
        sizes = _uint16_at(raw, places)
        numbers = np.where(sizes >= 2, _uint16_at(raw, np.minimum(places + 3, len(raw) - 2)), 0)
        fits = (sizes >= self.smallest[numbers]) & (sizes <= self.largest[numbers])
        # Of a number whose subscription was lost; before the first subscription there are no data.
        doubtful = self.is_known[numbers] | (not self.subscribed)
        bad = np.flatnonzero((sizes < 2) | (doubtful & ~fits))
        return int(data[bad[0]]) if len(bad) else len(starts)

    def first_fit(self, raw: UInt8[np.ndarray, " n"]) -> int | None:
        """Find the first place where a data message of a known number and length fits."""
        if len(raw) < 5:
            return None
        places = np.flatnonzero(raw[2:-2] == DATA)
        numbers, sizes = _uint16_at(raw, places + 3), _uint16_at(raw, places)
        fits = (sizes >= self.smallest[numbers]) & (sizes <= self.largest[numbers])
        # Without the declarations behind the damage, the data behind them say nothing.
        found = [*places[fits][:1].tolist(), *self._first_declaration(raw.tobytes())]
        return min(found, default=None)

    def _first_declaration(self, content: bytes) -> list[int]:
        for match in _DECLARATION.finditer(content):
            begin, end = match.end() + 1, match.end() + 1 + int.from_bytes(match[1], "little")
            if end > min(len(content), begin + LONGEST_DECLARATION):
                continue
            match content[begin - 1 : begin]:
                case b"F":
                    fits = content[end - 1 : end] == b";"
                case b"P":
                    fits = end == begin + 1 + content[begin] + 4
                case _:
                    name = content[begin + 3 : min(end, begin + LONGEST_SUBSCRIPTION)]
                    fits = name.decode("utf-8", "replace") in self.formats
            if fits:
                return [match.start()]
        return []

    def keep(self, block: Block) -> None:
        """Keep the rows of the wanted topics in a block."""
        self.skipped += block.skipped
        self.places += block.places
        self.trailing += block.trailing
        raw = np.frombuffer(block.content, dtype=np.uint8)
        places = block.starts[raw[block.starts + 2] == DATA]
        numbers = _uint16_at(raw, places + 3)
        self.counts += np.bincount(numbers, minlength=LARGEST_NUMBER)
        for number in np.unique(numbers).tolist():
            topic = self.subscribed.get(number)
            if topic is None or topic.row is None or topic.name not in self.wanted:
                continue
            size = topic.row.dtype.itemsize
            windows = np.lib.stride_tricks.sliding_window_view(raw, size)
            picked = windows[places[numbers == number] + 5]
            rows = picked.view(topic.row.dtype)[:, 0]
            names = self.wanted[topic.name]
            self.rows[number] = appended(self.rows.get(number), rows, names)

    def _declare_message(self, kind: str, content: bytes) -> None:
        """Take in a message that is no data; what is no sound message of its kind is passed."""
        match kind:
            case "F":
                parsed = parse_format(content.decode("utf-8", "replace"))
                if parsed is not None:
                    self.formats.setdefault(*parsed)
            case "A":
                self._subscribe_topic(content)
            case "I":
                self._take_information(content)
            case "P":
                self._set_parameter(content)
            case "Q":
                named = _key_and_value(content[1:])
                if named is not None:
                    for bit, values in self.defaults.items():
                        if content[0] & bit:
                            values[named[0]] = named[1]
            case "O" if len(content) == 2:
                self.dropouts.append(int.from_bytes(content, "little"))
            case _:
                pass

    def _subscribe_topic(self, content: bytes) -> None:
        if len(content) < 4:
            return
        instance, number = struct.unpack_from("<BH", content)
        name = content[3:].decode("utf-8", "replace")
        is_useless = number in self.subscribed or name not in self.formats
        if is_useless or len(self.subscribed) >= MOST_TOPICS:
            return
        row = self.layouts.get(name) or row_of(self.formats, name)
        if row is not None:
            self.layouts[name] = row
        self.subscribed[number] = _Subscription(name=name, instance=instance, row=row)
        self.is_known[number] = True
        self.smallest[number] = 2 if row is None else 2 + row.dtype.itemsize
        self.largest[number] = LARGEST_NUMBER if row is None else 2 + row.largest

    def _take_information(self, content: bytes) -> None:
        end = 1 + content[0] if content else 0
        kind, _, key = content[1:end].decode("utf-8", "replace").partition(" ")
        if not key or len(self.info) >= MOST_TEXTS:
            return
        if kind.startswith("char["):
            text = content[end:][:LONGEST_TEXT].decode("utf-8", "replace")
            self.info[key] = "".join(filter(str.isprintable, text))
        elif kind in ("uint32_t", "int32_t") and len(content) == end + 4:
            self.info[key] = int.from_bytes(content[end:], "little", signed=kind[0] == "i")

    def _set_parameter(self, content: bytes) -> None:
        named = _key_and_value(content)
        if named is None:
            return
        name, value = named
        if not self.subscribed or name not in self.parameters:
            self.parameters[name] = value
        elif self.now.get(name, self.parameters[name]) != value:
            self.changes.append((name, self.now.get(name, self.parameters[name]), value))
        self.now[name] = value


def _key_and_value(content: bytes) -> tuple[str, Value] | None:
    """Read name and value of a parameter; None if it is damaged."""
    end = 1 + content[0] if content else 0
    kind, _, key = content[1:end].decode("utf-8", "replace").partition(" ")
    if not key or not key.isprintable() or len(key) > 40 or len(content) != end + 4:
        return None
    if kind == "int32_t":
        return key, int.from_bytes(content[end:], "little", signed=True)
    if kind == "float":
        (value,) = struct.unpack("<f", content[end:])
        if not math.isfinite(value):
            return None
        # The shortest decimal of single precision: 0.15, not 0.15000000596.
        return key, float(str(np.float32(value)))
    return None


def _uint16_at(
    raw: UInt8[np.ndarray, " n"], places: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    return raw[places].astype(np.int64) | raw[places + 1].astype(np.int64) << 8


def scan_file(path: Path, wanted: Wanted) -> Scan:
    """Read the wanted topics of a file, and all its parameters."""
    head = read_head(path, HEADER_BYTES + 3 + 40)
    _refuse_other(head)
    reading = _Reading(wanted=wanted)
    try:
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            size = file.seek(0, os.SEEK_END)
            offsets, damage = _find_appended(head, size)
            _read_sections(file, [HEADER_BYTES, *offsets, size], reading)
    except OSError as error:
        raise LogError(f"cannot be read ({error}): check the path and the disk") from error
    topics, unordered = _ordered_topics(reading)
    return Scan(
        topics=topics,
        counts=_count_messages(reading),
        parameters=reading.parameters,
        system_defaults=reading.defaults[SYSTEM_DEFAULT],
        airframe_defaults=reading.defaults[AIRFRAME_DEFAULT],
        knows_defaults=any(reading.defaults.values()),
        changes=tuple(reading.changes),
        info=reading.info,
        dropouts=tuple(reading.dropouts),
        appended=len(offsets),
        damage=(*damage, *_describe_damage(reading, unordered)),
        sha256=digest,
    )


def _refuse_other(head: bytes) -> None:
    if not head.startswith(MAGIC):
        raise LogError(f"begins with {head[:7].hex(' ')}, expected the mark of a ULog")
    if len(head) < HEADER_BYTES + 3:
        raise LogError(f"{len(head)} bytes, expected a ULog with messages: copy it again")


def _read_sections(file: BinaryIO, edges: list[int], reading: _Reading) -> None:
    """Read the file's stretches one after the other; each begins with a whole message."""
    for begin, end in pairwise(edges):
        for block in read_blocks(file, begin, end, judge=reading):
            reading.keep(block)
            refuse_ruin(reading.places)
            report_progress(file.tell(), edges[-1])


def _find_appended(head: bytes, size: int) -> tuple[list[int], list[str]]:
    """Find where appended stretches begin, from the flags, and doubts about them."""
    length, kind = struct.unpack_from("<HB", head, HEADER_BYTES)
    flags = head[HEADER_BYTES + 3 :][:length]
    if kind != ord("B") or len(flags) < 40:
        return [], []
    if flags[8] & ~APPENDED or any(flags[9:16]):
        raise LogError(
            f"its flags {flags[8:16].hex(' ')} name changes of the format that rotorfit does not "
            "know: it was written by a later PX4, or is damaged; copy it again from the card"
        )
    if not flags[8] & APPENDED:
        return [], []
    given = [offset for offset in struct.unpack_from("<3Q", flags, 16) if offset]
    sound = [offset for offset in given if HEADER_BYTES < offset < size]
    if sound != given or sound != sorted(set(sound)):
        return [], ["the places of appended data are damaged: what was appended may be lost"]
    return sound, []


def _ordered_topics(reading: _Reading) -> tuple[dict[str, tuple[Topic, ...]], int]:
    """Return the topics that have times, in order, and how many messages were out of order."""
    topics: dict[str, list[Topic]] = {}
    unordered = 0
    for number, rows in reading.rows.items():
        subscription = reading.subscribed[number]
        dtype = rows.dtype
        if "timestamp" not in (dtype.names or ()) or dtype["timestamp"] != np.dtype("<u8"):
            continue
        kept = in_order(rows["timestamp"])
        unordered += int(np.count_nonzero(~kept))
        rows = rows if kept.all() else rows[kept]
        topic = Topic(
            name=subscription.name,
            instance=subscription.instance,
            rows=rows,
            lengths=_array_lengths(subscription.row),
        )
        topics.setdefault(topic.name, []).append(topic)
    ordered = {
        name: tuple(sorted(found, key=lambda topic: topic.instance))
        for name, found in topics.items()
    }
    return ordered, unordered


def _array_lengths(row: Row | None) -> dict[str, int]:
    dtype = np.dtype([]) if row is None else row.dtype
    inner = {name: dtype[name] for name in dtype.names or ()}
    return {name: int(dtype.shape[0]) for name, dtype in inner.items() if dtype.shape}


def _count_messages(reading: _Reading) -> dict[str, int]:
    counts: dict[str, int] = {}
    for number, subscription in reading.subscribed.items():
        counts[subscription.name] = counts.get(subscription.name, 0) + int(reading.counts[number])
    return counts


def _describe_damage(reading: _Reading, unordered: int) -> list[str]:
    damage: list[str] = []
    if reading.dropouts:
        total, longest = sum(reading.dropouts), max(reading.dropouts)
        damage.append(
            f"the logger lost messages {len(reading.dropouts)} times, {total / 1000:.2f} s in all, "
            f"{longest} ms at most: gaps are cut out, not bridged; use a faster card, or log less"
        )
    if reading.places:
        damage.append(
            f"{reading.places} damaged places: {reading.skipped} bytes skipped; copy the log again "
            "from the card"
        )
    if reading.trailing:
        damage.append(f"the log was cut off: {reading.trailing} bytes at its end are no message")
    if unordered:
        damage.append(f"{unordered} messages left out: their times are out of order")
    return damage
