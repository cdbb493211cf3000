"""One pass through the files of a ROS recording: numbers of each topic, as rosbags decodes it."""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from rotorfit.errors import LogError
from rotorfit.logs.columns import ColumnSpec
from rotorfit.logs.files import read_head
from rotorfit.logs.rosbag import MCAP_MAGIC, ROS1_BEGINS, SQLITE_MAGIC
from rotorfit.logs.rosbag.choose import mapped_paths
from rotorfit.logs.rosbag.definitions import (
    Definition,
    Definitions,
    Numbers,
    Taken,
    are_numbers,
    taken_by,
)
from rotorfit.logs.rosbag.messages import MESSAGES, STAMPS
from rotorfit.logs.rosbag.ros1 import scan_ros1
from rotorfit.logs.rosbag.ros2 import scan_mcap, scan_sqlite
from rotorfit.logs.rosbag.stream import (
    ZSTD_MAGIC,
    Contents,
    DamageError,
    Encoding,
    Messages,
    Recorded,
    Tally,
    Topic,
    Wanted,
    decoded,
)

_LARGEST_TIME: Final = 2**63 - 1
_LARGEST_MESSAGE: Final = 1 << 18
_MOST_COLUMNS: Final = 64
"""Numbers of one quantity in a message: one long message would widen the rows of all."""
_LATEST: Final = (9e9, 9e15)
"""Seconds, and micro- or nanoseconds, that still count nanoseconds in 64 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Form:
    """What is taken from messages of one definition: the stamp, then the quantities."""

    definition: Definition
    taken: tuple[Taken, ...]

    def numbers(self, data: bytes, encoding: Encoding) -> tuple[list[Numbers], int]:
        """Read what is taken from a message, and the place where the message ends."""
        if len(data) > _LARGEST_MESSAGE:
            raise DamageError(f"a message has {len(data)} bytes: no sensor's")
        message, end = decoded(self._message, data, encoding)
        numbers = [taken(message) for taken in self.taken]
        if max(map(len, numbers)) > _MOST_COLUMNS:
            raise DamageError(f"a message has more than {_MOST_COLUMNS} numbers of one kind")
        return numbers, end

    def _message(self, data: bytes, encoding: Encoding) -> tuple[object, int]:
        """Return a message; `Typestore.deserialize_cdr` would refuse a longer one."""
        made, store = self.definition.made, self.definition.store
        if encoding == "ros1":
            return made.deserialize_ros1(data, 0, made.cls, store)
        if data[:2] not in (b"\x00\x00", b"\x00\x01"):
            raise DamageError("a message is not plain CDR")
        call = made.deserialize_cdr_le if data[1] else made.deserialize_cdr_be
        message, end = call(data[4:], 0, made.cls, store)
        return message, 4 + end


class _Rows:
    """Rows of numbers, some perhaps shorter than others; has a state, which is the rows."""

    __slots__ = ("_lengths", "_numbers")

    def __init__(self) -> None:
        self._lengths = array("B")
        self._numbers = array("d")

    def add(self, row: Numbers) -> None:
        self._lengths.append(len(row))
        self._numbers.extend(row)

    def table(self) -> Float[np.ndarray, "n k"]:
        """Stack the rows, with NaN where one is shorter."""
        lengths = np.asarray(self._lengths)
        numbers = np.asarray(self._numbers)
        width = int(lengths.max(initial=0))
        if (lengths == width).all():
            return numbers.reshape(len(lengths), width)
        table = np.full((len(lengths), width), np.nan)
        table[np.arange(width) < lengths[:, None]] = numbers
        return table


class Decoder:
    """Collects the messages of a topic; has a state, which is what was collected.

    `stamps` are paths: seconds and nanoseconds, or microseconds; the first that is there counts.
    `cause` was raised for the first message that did not fit its definition.
    """

    def __init__(
        self,
        topic: Topic,
        quantities: Mapping[str, Sequence[str]],
        stamps: Sequence[Sequence[str]],
        definitions: Definitions,
    ) -> None:
        self.topic = topic
        self.cause: BaseException | None = None
        self._encoding: Encoding = topic.encoding or "cdr"
        self._received = array("q")
        self._stamps = _Rows()
        self._values = {name: _Rows() for name in quantities}
        self._rows = (self._stamps, *self._values.values())
        self._forms: tuple[_Form, ...] = ()
        self._unreadable = 0
        self._why = ""
        try:
            self._forms = tuple(_form(one, quantities, stamps) for one in definitions.of(topic))
        except DamageError as error:
            self._note(error, str(error))

    def add(self, received: int, data: bytes) -> None:
        """Take in a message."""
        numbers = self._numbers(data)
        if numbers is None:
            self._unreadable += 1
            return
        self._received.append(min(received, _LARGEST_TIME))
        for rows, row in zip(self._rows, numbers, strict=True):
            rows.add(row)

    def finish(self) -> Recorded:
        """Return all that was collected, in order."""
        return Recorded(
            topic=self.topic,
            received=np.asarray(self._received).view(np.int64),
            stamps=_nanoseconds(self._stamps.table()),
            values={name: rows.table() for name, rows in self._values.items()},
            unreadable=(self._unreadable, self._why),
        )

    def _numbers(self, data: bytes) -> list[Numbers] | None:
        """Read what is taken from a message by the first definition that it fits."""
        best: list[Numbers] | None = None
        for form in self._forms:
            try:
                numbers, end = form.numbers(data, self._encoding)
            except DamageError as error:
                self._note(error, _misfit(error))
                continue
            # CDR may be followed by three bytes that fill a word.
            if len(data) <= end + 3:
                return numbers
            best = best or numbers
        return best

    def _note(self, error: DamageError, why: str) -> None:
        """Keep the first reason why messages cannot be read, without the trace that holds them."""
        if not self._why:
            self._why = why
            self.cause = (error.__cause__ or error).with_traceback(None)


def _form(
    definition: Definition, quantities: Mapping[str, Sequence[str]], stamps: Sequence[Sequence[str]]
) -> _Form:
    types, kind = definition.store.fielddefs, definition.kind
    stamp = next((paths for paths in stamps if are_numbers(types, kind, paths)), ())
    taken = [taken_by(types, kind, paths) for paths in (stamp, *quantities.values())]
    return _Form(definition=definition, taken=tuple(taken))


def _misfit(error: DamageError) -> str:
    """Say why a message could not be decoded; what rosbags says of it is in its own terms."""
    if error.__cause__ is None:
        return str(error)
    return f"a message does not fit its definition ({error})"


def _nanoseconds(stamps: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
    """Return stamps, of seconds and nanoseconds or of microseconds [ns]; -1 where there is none."""
    if stamps.shape[1] == 0:
        return np.full(len(stamps), -1, dtype=np.int64)
    # Below 2^53 the numbers are exact; they are put together as integers.
    scales = (1_000_000_000, 1) if stamps.shape[1] == 2 else (1_000,)
    latest = _LATEST if stamps.shape[1] == 2 else _LATEST[1:]
    limited = np.clip(np.nan_to_num(stamps), -1, latest).astype(np.int64)
    return (limited * np.array(scales)).sum(axis=1)


_MOST_TOPICS_READ: Final = 256
_SCANS: Final = {ROS1_BEGINS: scan_ros1, MCAP_MAGIC: scan_mcap}


def contents_of(files: Sequence[Path], mapped: Mapping[str, ColumnSpec]) -> Contents:
    """Read the numbers of the topics that are known or named, one pass through every file."""
    definitions = Definitions()
    decoders: dict[tuple[str, str], Decoder] = {}
    others: dict[tuple[str, str], Topic] = {}
    damage: dict[str, int] = {}
    cause: BaseException | None = None

    def wanted(topic: Topic) -> bool:
        key = (topic.name, topic.kind)
        if key in decoders:
            return True
        kind = MESSAGES.get(topic.kind)
        known = {} if kind is None else {name: q.paths for name, q in kind.channels.items()}
        quantities = {**known, **mapped_paths(topic.name, mapped)}
        if not quantities or topic.encoding is None or len(decoders) >= _MOST_TOPICS_READ:
            others[key] = topic
            return False
        decoders[key] = Decoder(topic, quantities, STAMPS, definitions)
        return True

    sizes = [file.stat().st_size for file in files]
    for k, file in enumerate(files):
        tally = Tally(file_size=sizes[k], before=sum(sizes[:k]), recording_size=sum(sizes))
        for topic, received, data in _scan(file, wanted, tally):
            decoders[(topic.name, topic.kind)].add(received, data)
        for what, count in tally.damage.items():
            damage[what] = damage.get(what, 0) + count
        cause = cause or tally.cause
    for decoder in decoders.values():
        cause = cause or decoder.cause
    recorded = [decoder.finish() for decoder in decoders.values()]
    return Contents(topics=recorded, others=list(others.values()), damage=damage, cause=cause)


def _scan(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of one file, by its format."""
    head = read_head(path, 16)
    if head.startswith(SQLITE_MAGIC):
        yield from scan_sqlite(path, wanted, tally)
        return
    for begin, scan_file in _SCANS.items():
        if head.startswith(begin):
            with path.open("rb") as file:
                for message in scan_file(file, wanted, tally):
                    yield message
                    tally.reached(file.tell())
            return
    packed = ", compressed as a whole: unpack it with unzstd" if head[:4] == ZSTD_MAGIC else ""
    raise LogError(f"{path.name} is no ROS bag (begins with {head[:8].hex(' ')}){packed}")
