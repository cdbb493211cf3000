"""Paths to numbers in messages, as ``ros2 topic echo`` shows them, made to functions."""

import re
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Final, TypeAlias

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import BaseDesc, FieldDesc, NameDesc, Typesdict
from rosbags.typesys.base import normalize_fieldname

Numbers: TypeAlias = Sequence[int | float]
Taken: TypeAlias = Callable[[Any], Numbers]
"""Takes numbers from a message, which has any class."""
_INDEX: Final = re.compile("[0-9]{0,9}")


def taken_by(types: Typesdict, kind: str, paths: Sequence[str]) -> Taken:
    """Return what takes the numbers of paths from messages of a type, those that it has.

    Parameters
    ----------
    types
        Definitions by type.
    kind
        Type of the messages, as ``package/msg/Name``.
    paths
        Such as ``header.stamp.sec``, ``esc[0].rpm``, ``esc[].rpm`` for that of every element,
        ``data`` for a whole array.
    """
    if len(paths) > 1 and are_numbers(types, kind, paths):
        return attrgetter(*map(_attribute, paths))  # nearly always, and much faster
    found = [taken for path in paths if (taken := _taken(types, kind, path)) is not None]
    return lambda message: [number for taken in found for number in taken(message)]


def are_numbers(types: Typesdict, kind: str, paths: Sequence[str]) -> bool:
    """Tell whether each path leads to one number without passing an array."""
    fields = [_field(types, kind, path) for path in paths]
    return all(field is not None and _is_number(field) for field in fields)


def _taken(types: Typesdict, kind: str, path: str) -> Taken | None:
    """Return what takes the numbers of one path."""
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
    """Return what takes numbers from one item or from all, by what follows the bracket."""
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
