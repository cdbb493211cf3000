"""Definitions of messages: those of the file or those that are known, checked, made to stores.

rosbags parses them and makes code of them. It sets no bounds: an array of a milliard of messages
becomes as many lines of code. So what is damaged or made to hurt is kept from it here.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from typing import Any, Final, TypeAlias

from rosbags.interfaces import Msgdef, Nodetype
from rosbags.interfaces.typing import BaseDesc, FieldDesc, NameDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

from rotorfit.logs.rosbag.messages import MESSAGES
from rotorfit.logs.rosbag.stream import DamageError, Encoding, Topic, decoded, kind_of

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


@dataclass(frozen=True, slots=True, kw_only=True)
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
        return tuple(self._made(topic.kind, text, encoding) for text in texts)

    def _made(self, kind: str, text: str, encoding: Encoding) -> Definition:
        key = (kind, text, encoding)
        if key not in self.made:
            try:
                self.made[key] = self._make(normalize_msgtype(kind), text, encoding)
            except DamageError as error:
                self.made[key] = error
        made = self.made[key]
        if isinstance(made, DamageError):
            raise made
        return made

    def _make(self, kind: str, text: str, encoding: Encoding) -> Definition:
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
    lines = [line for raw in text.splitlines() if (line := _plain(raw))]
    plain = "".join(f"{line}\n" for line in lines)
    if len(lines) > _MOST_LINES or len(plain) > _LONGEST_LINES:
        raise DamageError(f"the definition of {kind_of(kind)[:80]} has {len(lines)} lines: damaged")
    try:
        return decoded(get_types_from_msg, plain, kind)
    except DamageError as error:  # which quotes all of the text
        raise DamageError(
            f"the definition of {kind_of(kind)[:80]} is no definition of a message: damaged"
        ) from error.__cause__


def _plain(line: str) -> str:
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
        """Count the fields of one field, and tell whether it takes any room."""
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
        return attrgetter(*map(_attribute, paths))  # nearly always, and much faster
    found = [taken for path in paths if (taken := _taken(types, kind, path)) is not None]
    return lambda message: [number for taken in found for number in taken(message)]


def are_numbers(types: Typesdict, kind: str, paths: Sequence[str]) -> bool:
    """Tell whether each path leads to one number without passing an array."""
    fields = [_field(types, kind, path) for path in paths]
    return all(field is not None and _is_number(field) for field in fields)


def _taken(types: Typesdict, kind: str, path: str) -> Taken | None:
    """Make the function of one path; None where the type does not have it."""
    before, mark, after = path.partition("[")
    field = _field(types, kind, before)
    if field is None:
        return None
    get = attrgetter(_attribute(before))
    if mark:
        return _taken_of_items(types, get, field, after)
    if _is_number(field):
        return lambda message: (get(message),)
    item = _item(field)
    return (lambda message: get(message).tolist()) if item and _is_number(item) else None


def _taken_of_items(
    types: Typesdict, get: Callable[[Any], Any], field: FieldDesc, after: str
) -> Taken | None:
    """Make the function of one item or of all, by what follows the bracket."""
    index, _, rest = after.partition("]")
    item = _item(field)
    if item is None or not _INDEX.fullmatch(index):
        return None
    part = slice(int(index), int(index) + 1) if index else slice(None)
    if rest.startswith(".") and item[0] == Nodetype.NAME:
        inner = _taken(types, item[1], rest[1:])
        if inner is None:
            return None
        return lambda message: [x for one in get(message)[part] for x in inner(one)]
    if rest or not index or not _is_number(item):
        return None
    return lambda message: get(message)[part].tolist()


def _field(types: Typesdict, kind: str, path: str) -> FieldDesc | None:
    """Return the field that names lead to, past no array."""
    field: FieldDesc | None = None
    for name in path.split("."):
        field = dict(types[kind][1]).get(name) if kind else None
        if field is None:
            return None
        kind = field[1] if field[0] == Nodetype.NAME else ""
    return field


def _item(field: FieldDesc) -> BaseDesc | NameDesc | None:
    if field[0] == Nodetype.ARRAY or field[0] == Nodetype.SEQUENCE:
        return field[1][0]
    return None


def _is_number(field: FieldDesc) -> bool:
    return field[0] == Nodetype.BASE and field[1][0] != "string"


def _attribute(path: str) -> str:
    return ".".join(normalize_fieldname(name) for name in path.split("."))
