"""One pass through the files of a ROS recording: numbers of each topic, as rosbags decodes it.

rosbags parses the definitions of messages and makes code of them. It sets no bounds: an array of a
milliard of messages becomes as many lines of code. So what is damaged or made to hurt is kept from
it here.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from rosbags.interfaces import Msgdef, Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import open_file, read_head, unpacked_log
from rotorfit.logs.rosbag import MCAP_MAGIC, ROS1_BEGINS, SQLITE_MAGIC
from rotorfit.logs.rosbag.choose import MESSAGES, STAMPS, mapped_paths
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
    kind_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from jaxtyping import Float, Int
    from rosbags.interfaces.typing import BaseDesc, FieldDesc, NameDesc, Typesdict

    from rotorfit.logs.columns import ColumnSpec

_LARGEST_TEXT: Final = 1 << 20
_LONGEST_LINES: Final = 1 << 16
_MOST_LINES: Final = 2048
_DEEPEST: Final = 12
_MOST_FIELDS: Final = 1024
"""Fields, or elements of arrays that are no numbers, in one message that is read."""
_MOST_FIELDS_OF_ALL: Final = 4096
_LARGEST_ARRAY: Final = 1 << 16
_SEPARATOR: Final = re.compile(r"^={10,}$")
_CONSTANT: Final = re.compile(r"^\S+\s+\w+\s*=")
_SEPARATING: Final = "=" * 80 + "\n"


@frozen_dataclass
class Definition:
    """The messages of a type (``package/msg/Name``), with the functions that rosbags made of it."""

    kind: str
    store: Typestore
    made: Msgdef[object]


@dataclass(slots=True)
class Definitions:
    """Those of one recording, each made once or refused once; has a state, which is these."""

    made: dict[tuple[str, str, Encoding], Definition | DamageError] = field(
        default_factory=dict[tuple[str, str, Encoding], Definition | DamageError]
    )
    fields: int = 0

    def of(self, topic: Topic) -> tuple[Definition, ...]:
        """Return the definition of a topic's messages, or several that may be it."""
        encoding: Encoding = topic.encoding or "cdr"
        known = MESSAGES[topic.kind].definitions if topic.kind in MESSAGES else ("",)
        texts = (topic.definition,) if topic.definition else known
        return tuple(self._made_definition(topic.kind, text, encoding) for text in texts)

    def _made_definition(self, kind: str, text: str, encoding: Encoding) -> Definition:
        key = (kind, text, encoding)
        if key not in self.made:
            try:
                self.made[key] = self._make_definition(normalize_msgtype(kind), text, encoding)
            except DamageError as error:
                self.made[key] = error
        made = self.made[key]
        if isinstance(made, DamageError):
            raise made
        return made

    def _make_definition(self, kind: str, text: str, encoding: Encoding) -> Definition:
        if text:
            types = {**built_in(encoding), **parsed(kind, text)}
        else:
            standard = Stores.ROS1_NOETIC if encoding == "ros1" else Stores.LATEST
            types = get_typestore(standard).fielddefs
        inside, count = needed(types, kind)
        self.fields += count
        if self.fields > _MOST_FIELDS_OF_ALL:
            raise DamageError(f"the topics have more than {_MOST_FIELDS_OF_ALL} fields together")
        store = Typestore(max_sequence_length=_LARGEST_ARRAY)
        decoded(store.register, inside)
        made = decoded(store.get_msgdef, kind)
        return Definition(kind=kind, store=store, made=made)


def parsed(kind: str, text: str) -> Typesdict:
    """Return the types that a definition describes, by name."""
    if len(text) > _LARGEST_TEXT:
        raise DamageError(
            f"the definition of {kind_of(kind)[:80]} has {len(text)} characters: damaged"
        )
    lines = [line for raw in text.splitlines() if (line := _plain_line(raw))]
    plain = "".join(f"{line}\n" for line in lines)
    if len(lines) > _MOST_LINES or len(plain) > _LONGEST_LINES:
        raise DamageError(f"the definition of {kind_of(kind)[:80]} has {len(lines)} lines: damaged")
    try:
        return decoded(get_types_from_msg, plain, kind)
    except DamageError as error:  # which quotes all of the text
        raise DamageError(
            f"the definition of {kind_of(kind)[:80]} is no definition of a message: damaged"
        ) from error.__cause__


def _plain_line(line: str) -> str:
    """Strip a line of all but fields; rosbags is strict about the rest."""
    bare = line.partition("#")[0].strip()
    if bare.startswith("@") or _SEPARATOR.match(bare) or _CONSTANT.match(bare):
        return ""
    return f"{_SEPARATING}{bare}" if bare.startswith("MSG:") else bare


def needed(types: Typesdict, kind: str) -> tuple[Typesdict, int]:
    """Collect a type and those inside it; also count their fields."""
    found: Typesdict = {}

    def walk(name: str, depth: int) -> tuple[int, bool]:
        """Return the fields of a type, and whether a message of it takes any room."""
        if name not in types or depth > _DEEPEST:
            why = "is not defined in the file" if name not in types else "goes too deep"
            raise DamageError(f"the message {kind_of(name)[:80]} {why}")
        found[name] = ([], types[name][1])
        count, takes_room = 0, False
        for _, desc in types[name][1]:
            fields, fills = one(desc, name, depth)
            count, takes_room = count + fields, takes_room or fills
            if count > _MOST_FIELDS:
                raise DamageError(f"a message has more than {_MOST_FIELDS} fields")
        return count, takes_room

    def one(desc: FieldDesc, owner: str, depth: int) -> tuple[int, bool]:
        """Count the fields of one field, and test whether it takes any room."""
        if desc[0] == Nodetype.BASE:
            return 1, True
        if desc[0] == Nodetype.NAME:
            fields, fills = walk(desc[1], depth + 1)
            return 1 + fields, fills
        item, size = desc[1]
        if not 0 <= size <= _LARGEST_ARRAY:
            raise DamageError(
                f"the definition of {kind_of(owner)[:80]} has an array of {size}: damaged"
            )
        fields, fills = one(item, owner, depth)
        if desc[0] == Nodetype.ARRAY:
            is_numbers = item[0] == Nodetype.BASE and item[1][0] != "string"
            return 1 if is_numbers else 1 + size * fields, fills and size > 0
        if not fills:  # any number of them would fit into any message
            raise DamageError(
                f"the definition of {kind_of(owner)[:80]} has an array of nothing: damaged"
            )
        return 1 + fields, True

    count, _ = walk(kind, 0)
    return found, count


@cache
def built_in(encoding: Encoding) -> Typesdict:
    """Return the types that a file may leave out."""
    header = "time stamp\nstring frame_id\n"
    text = f"uint32 seq\n{header}" if encoding == "ros1" else header
    times = get_typestore(Stores.EMPTY).fielddefs
    return {**times, **get_types_from_msg(text, "std_msgs/msg/Header")}


Numbers: TypeAlias = Sequence[int | float]
Taken: TypeAlias = Callable[[Any], Numbers]
"""Takes numbers from a message, which has any class."""
_INDEX: Final = re.compile("[0-9]{0,9}")


def taken_by(types: Typesdict, kind: str, paths: Sequence[str]) -> Taken:
    """Make a function that takes the numbers of paths from messages of a type."""
    if len(paths) > 1 and are_numbers(types, kind, paths):
        return attrgetter(*map(_attribute_path, paths))  # nearly always, and much faster
    found = [taken for path in paths if (taken := _taking_function(types, kind, path)) is not None]
    return lambda message: [number for taken in found for number in taken(message)]


def are_numbers(types: Typesdict, kind: str, paths: Sequence[str]) -> bool:
    """Return whether each path leads to one number without passing an array."""
    fields = [_field_of_path(types, kind, path) for path in paths]
    return all(field is not None and _is_number(field) for field in fields)


def _taking_function(types: Typesdict, kind: str, path: str) -> Taken | None:
    """Make the function of one path; None if the type does not have it."""
    before, mark, after = path.partition("[")
    field = _field_of_path(types, kind, before)
    if field is None:
        return None
    get = attrgetter(_attribute_path(before))
    if mark:
        return _taken_of_items(types, get, field, after)
    if _is_number(field):
        return lambda message: (get(message),)
    item = _item_of_field(field)
    return (lambda message: get(message).tolist()) if item and _is_number(item) else None


def _taken_of_items(
    types: Typesdict, get: Callable[[Any], Any], field: FieldDesc, after: str
) -> Taken | None:
    """Make the function of one item or of all, by what follows the bracket."""
    index, _, rest = after.partition("]")
    item = _item_of_field(field)
    if item is None or not _INDEX.fullmatch(index):
        return None
    part = slice(int(index), int(index) + 1) if index else slice(None)
    if rest.startswith(".") and item[0] == Nodetype.NAME:
        inner = _taking_function(types, item[1], rest[1:])
        if inner is None:
            return None
        return lambda message: [x for one in get(message)[part] for x in inner(one)]
    if rest or not index or not _is_number(item):
        return None
    return lambda message: get(message)[part].tolist()


def _field_of_path(types: Typesdict, kind: str, path: str) -> FieldDesc | None:
    """Return the field that names lead to, past no array."""
    field: FieldDesc | None = None
    for name in path.split("."):
        field = dict(types[kind][1]).get(name) if kind else None
        if field is None:
            return None
        kind = field[1] if field[0] == Nodetype.NAME else ""
    return field


def _item_of_field(field: FieldDesc) -> BaseDesc | NameDesc | None:
    if field[0] == Nodetype.ARRAY or field[0] == Nodetype.SEQUENCE:
        return field[1][0]
    return None


def _is_number(field: FieldDesc) -> bool:
    return field[0] == Nodetype.BASE and field[1][0] != "string"


def _attribute_path(path: str) -> str:
    return ".".join(normalize_fieldname(name) for name in path.split("."))


_LARGEST_TIME: Final = 2**63 - 1
_LARGEST_MESSAGE: Final = 1 << 18
_MOST_COLUMNS: Final = 64
"""Numbers of one quantity in a message: one long message would widen the rows of all."""
_LATEST: Final = (9e9, 9e15)
"""Seconds, and micro- or nanoseconds, that still count nanoseconds in 64 bits."""


@frozen_dataclass
class _Form:
    """What is taken from messages of one definition: the stamp, then the quantities."""

    definition: Definition
    taken: tuple[Taken, ...]

    def numbers(self, data: bytes, encoding: Encoding) -> tuple[list[Numbers], int]:
        """Read what is taken from a message, and the place where the message ends."""
        if len(data) > _LARGEST_MESSAGE:
            raise DamageError(f"a message has {len(data)} bytes: no sensor's")
        message, end = decoded(self._decode_message, data, encoding)
        numbers = [taken(message) for taken in self.taken]
        if max(map(len, numbers)) > _MOST_COLUMNS:
            raise DamageError(f"a message has more than {_MOST_COLUMNS} numbers of one kind")
        return numbers, end

    def _decode_message(self, data: bytes, encoding: Encoding) -> tuple[object, int]:
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
            self._forms = tuple(
                _form_of_messages(one, quantities, stamps) for one in definitions.of(topic)
            )
        except DamageError as error:
            self._note_error(error, str(error))

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
            stamps=_stamps_in_nanoseconds(self._stamps.table()),
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
                self._note_error(error, _explain_misfit(error))
                continue
            # CDR may be followed by three bytes that fill a word.
            if len(data) <= end + 3:
                return numbers
            best = best or numbers
        return best

    def _note_error(self, error: DamageError, why: str) -> None:
        """Keep the first reason why messages cannot be read, without the trace that holds them."""
        if not self._why:
            self._why = why
            self.cause = (error.__cause__ or error).with_traceback(None)


def _form_of_messages(
    definition: Definition, quantities: Mapping[str, Sequence[str]], stamps: Sequence[Sequence[str]]
) -> _Form:
    types, kind = definition.store.fielddefs, definition.kind
    stamp = next((paths for paths in stamps if are_numbers(types, kind, paths)), ())
    taken = [taken_by(types, kind, paths) for paths in (stamp, *quantities.values())]
    return _Form(definition=definition, taken=tuple(taken))


def _explain_misfit(error: DamageError) -> str:
    """Explain why a message could not be decoded; the text of rosbags uses its own terms."""
    if error.__cause__ is None:
        return str(error)
    return f"a message does not fit its definition ({error})"


def _stamps_in_nanoseconds(stamps: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
    """Return stamps, of seconds and nanoseconds or of microseconds [ns]; -1 if there is none."""
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
        for topic, received, data in _scan_file(file, wanted, tally):
            decoders[(topic.name, topic.kind)].add(received, data)
        for what, count in tally.damage.items():
            damage[what] = damage.get(what, 0) + count
        cause = cause or tally.cause
    for decoder in decoders.values():
        cause = cause or decoder.cause
    recorded = [decoder.finish() for decoder in decoders.values()]
    return Contents(topics=recorded, others=list(others.values()), damage=damage, cause=cause)


def _scan_file(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of one file, by its format."""
    head = read_head(path, 16)
    if head.startswith(SQLITE_MAGIC):
        if unpacked_log(path) is not None:
            raise LogError("a ROS 2 database in an archive: unpack it first")
        yield from scan_sqlite(path, wanted, tally)
        return
    for begin, scan_file in _SCANS.items():
        if head.startswith(begin):
            with open_file(path) as file:
                for message in scan_file(file, wanted, tally):
                    yield message
                    tally.reached(file.tell())
            return
    packed = ", compressed as a whole: unpack it with unzstd" if head[:4] == ZSTD_MAGIC else ""
    raise LogError(f"{path.name} is no ROS bag (begins with {head[:8].hex(' ')}){packed}")
