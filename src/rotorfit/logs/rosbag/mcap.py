"""MCAP from its beginning to its end, chunk by chunk; the index at the end is not needed.

See the MCAP format specification (mcap.dev): magic, then records of one byte of opcode, eight of
length and the content. A recording that was cut off is read as far as it goes.
"""

import struct
from typing import BinaryIO, Final

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import (
    Encoding,
    Messages,
    Tally,
    Topic,
    Wanted,
    kind_of,
    unfolded,
    unfolded_message,
)

MAGIC: Final = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_ENCODINGS: Final[dict[str, Encoding]] = {"cdr": "cdr", "ros1": "ros1"}
_TEXT_SCHEMAS: Final = ("ros2msg", "ros1msg")
_LARGEST_RECORD: Final = 1 << 30
_MOST_NAMES: Final = 65_536

_Schemas = dict[int, tuple[str, str]]
_Channels = dict[int, tuple[Topic, bool]]


def scan_mcap(file: BinaryIO, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, in the order of the file.

    Raises
    ------
    LogError
        If compression needs a library that is not there, or unfolds without end.
    """
    file.seek(len(MAGIC))
    schemas: _Schemas = {}
    channels: _Channels = {}
    while head := file.read(9):
        if len(head) < 9:
            tally.passed_over("the end is cut off")
            return
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if opcode == _DATA_END:
            return
        left = tally.file_size - file.tell()
        if length > left or opcode == 0:
            tally.passed_over("the end is cut off")
            if opcode != _CHUNK or length > _LARGEST_RECORD:
                return
            length = left
        if opcode not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK) or length > _LARGEST_RECORD:
            file.seek(length, 1)
            continue
        try:
            content = _chunk(file.read(length), tally) if opcode == _CHUNK else None
        except (ValueError, struct.error):
            tally.passed_over("a chunk is damaged")
            continue
        whole = _record(opcode, file.read(length)) if content is None else content
        yield from _messages(whole, schemas, channels, wanted, tally)
        del whole, content  # one chunk at a time in memory


def _record(opcode: int, content: bytes) -> bytes:
    """Return a record as it would stand in a chunk."""
    return bytes([opcode]) + len(content).to_bytes(8, "little") + content


def _chunk(content: bytes, tally: Tally) -> bytes:
    """Return the records in a chunk; raise ValueError or struct.error if it is damaged."""
    (size,) = struct.unpack_from("<Q", content, 16)
    name, place = _string(content, 28)
    (length,) = struct.unpack_from("<Q", content, place)
    stored = content[place + 8 : place + 8 + length]
    if len(stored) < length and name:
        raise ValueError("cut off")
    return unfolded(stored, name, size, tally)


def _messages(
    records: bytes, schemas: _Schemas, channels: _Channels, wanted: Wanted, tally: Tally
) -> Messages:
    """Yield the messages among records that follow each other."""
    place = 0
    while place + 9 <= len(records):
        opcode = records[place]
        start = place + 9
        place = start + int.from_bytes(records[place + 1 : start], "little")
        if place > len(records) or opcode == 0:
            tally.passed_over("a chunk is cut off" if opcode else "a chunk is damaged")
            return
        if opcode == _MESSAGE and place - start >= 22:
            topic, is_wanted = channels.get(
                int.from_bytes(records[start : start + 2], "little"), (None, False)
            )
            if topic is not None and is_wanted:
                received = int.from_bytes(records[start + 6 : start + 14], "little")
                try:
                    yield topic, received, unfolded_message(records[start + 22 : place], tally)
                except ValueError:
                    tally.passed_over("a message is damaged")
        elif opcode in (_SCHEMA, _CHANNEL):
            try:
                _declare(opcode, records[start:place], schemas, channels, wanted, tally)
            except (ValueError, struct.error):
                tally.passed_over("the description of a topic is damaged")


def _declare(
    opcode: int,
    content: bytes,
    schemas: _Schemas,
    channels: _Channels,
    wanted: Wanted,
    tally: Tally,
) -> None:
    """Take in a schema or a channel."""
    (number,) = struct.unpack_from("<H", content)
    if opcode == _SCHEMA:
        name, place = _string(content, 2)
        encoding, place = _string(content, place)
        text, _ = _string(content, place)
        schemas[number] = (kind_of(name), text if encoding in _TEXT_SCHEMAS else "")
        return
    (schema,) = struct.unpack_from("<H", content, 2)
    topic, place = _string(content, 4)
    encoding, _ = _string(content, place)
    kind, definition = schemas.get(schema, ("", ""))
    if len(tally.topics) >= _MOST_NAMES:
        raise LogError(f"more than {_MOST_NAMES} topics: damaged or no flight log")
    declared = tally.declare(
        Topic(name=topic, kind=kind, encoding=_ENCODINGS.get(encoding), definition=definition)
    )
    channels[number] = (declared, declared.encoding is not None and wanted(declared))


def _string(content: bytes, place: int) -> tuple[str, int]:
    """Return a string with its length before it, and the place after it."""
    (length,) = struct.unpack_from("<I", content, place)
    end = place + 4 + length
    if end > len(content):
        raise ValueError("a string is cut off")
    return content[place + 4 : end].decode("utf-8", "replace"), end
