"""MCAP from its beginning to its end, chunk by chunk; the index at the end is not needed.

The reader of rosbags needs that index or at least the end of the file, the profile ``ros2`` and
sound chunks, and knows no ROS 1 messages in MCAP. So its parsers of records are used here, not its
reader: a record is one byte of opcode, eight of length and the content.
"""

from collections.abc import Iterator
from io import BytesIO
from typing import Final

from rosbags.rosbag2.storage_mcap import (
    deserialize_hiqq,
    deserialize_uint16,
    deserialize_uint64,
    read_bytes,
    read_exact,
    read_string,
)

from rotorfit.errors import LogError
from rotorfit.logs.rosbag import MCAP_MAGIC
from rotorfit.logs.rosbag.edge import DamageError, decoded, unfolded, unfolded_message
from rotorfit.logs.rosbag.stream import (
    Encoding,
    Messages,
    Source,
    Tally,
    Topic,
    Wanted,
    kind_of,
)

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_MESSAGE_HEAD: Final = 22
_ENCODINGS: Final[dict[str, Encoding]] = {"cdr": "cdr", "ros1": "ros1"}
_TEXT_SCHEMAS: Final = ("ros2msg", "ros1msg")
_LARGEST_RECORD: Final = 1 << 30
_MOST_NAMES: Final = 65_536


class _Declared:
    """The schemas and channels met so far; has a state, which is these."""

    def __init__(self, wanted: Wanted, tally: Tally) -> None:
        self._wanted = wanted
        self._tally = tally
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, tuple[Topic, bool]] = {}

    def add(self, opcode: int, content: BytesIO) -> None:
        """Take in a schema or a channel."""
        if opcode == _SCHEMA:
            number, name, encoding, text = decoded(_schema, content)
            self._schemas[number] = (kind_of(name), text if encoding in _TEXT_SCHEMAS else "")
            return
        number, schema, name, encoding = decoded(_channel, content)
        kind, definition = self._schemas.get(schema, ("", ""))
        if len(self._tally.topics) >= _MOST_NAMES:
            raise LogError(f"more than {_MOST_NAMES} topics: damaged or no flight log")
        topic = self._tally.declare(
            Topic(name=name, kind=kind, encoding=_ENCODINGS.get(encoding), definition=definition)
        )
        self._channels[number] = (topic, topic.encoding is not None and self._wanted(topic))

    def wanted(self, number: int) -> Topic | None:
        """Return the topic of a channel, if it is one whose messages are wanted."""
        topic, is_wanted = self._channels.get(number, (None, False))
        return topic if is_wanted else None


def scan_mcap(file: Source, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, in the order of the file."""
    file.seek(len(MCAP_MAGIC))
    declared = _Declared(wanted, tally)
    try:
        for opcode, length in _records(file, tally.file_size):
            left = tally.file_size - file.tell()
            if opcode == _DATA_END:
                return
            if length > left or opcode == 0:
                tally.passed_over("the end is cut off")
                if opcode != _CHUNK or length > _LARGEST_RECORD:
                    return
            if opcode == _CHUNK and length <= _LARGEST_RECORD:
                yield from _chunk(file, min(length, left), declared, tally)
            elif length <= _LARGEST_RECORD:
                yield from _one(opcode, file, length, declared, tally)
    except DamageError as error:
        tally.passed_over("the end is cut off", error)


def _records(file: Source, end: int) -> Iterator[tuple[int, int]]:
    """Yield opcode and length of each record, with the file at its content."""
    while (start := file.tell()) < end:
        head = decoded(read_exact, file, 9)
        length = int.from_bytes(head[1:], "little")
        yield head[0], length
        file.seek(min(start + 9 + length, end))


def _chunk(file: Source, length: int, declared: _Declared, tally: Tally) -> Messages:
    """Yield the messages in a chunk, up to where it is damaged."""
    try:
        records = _unfolded(file, length, tally)
        whole = len(records)
        with BytesIO(records) as chunk:
            del records  # one chunk at a time in memory
            for opcode, size in _records(chunk, whole):
                if size > whole - chunk.tell() or opcode in (0, _CHUNK):
                    is_cut = opcode not in (0, _CHUNK)
                    tally.passed_over("a chunk is cut off" if is_cut else "a chunk is damaged")
                    return
                yield from _one(opcode, chunk, size, declared, tally)
    except DamageError as error:
        tally.passed_over("a chunk is damaged", error)


def _unfolded(file: Source, length: int, tally: Tally) -> bytes:
    """Return the records in a chunk; one that is not compressed may be cut off."""
    start = file.tell()
    # Not from the file itself: a name declared to be gigabytes long would be made room for.
    head = BytesIO(file.read(min(length, 256)))
    head.seek(16)
    (size,) = deserialize_uint64(decoded(read_exact, head, 8))
    head.seek(28)
    compression = decoded(read_string, head)
    (stored,) = deserialize_uint64(decoded(read_exact, head, 8))
    file.seek(start + head.tell())
    left = length - head.tell()
    if stored > left and compression:
        raise DamageError("a compressed chunk is cut off")
    return unfolded(file.read(min(stored, left)), compression, size, tally)


def _one(opcode: int, file: Source, length: int, declared: _Declared, tally: Tally) -> Messages:
    """Take in a schema or channel, or yield a message that is wanted."""
    if opcode == _MESSAGE and length >= _MESSAGE_HEAD:
        number, _, received, _ = deserialize_hiqq(file.read(_MESSAGE_HEAD))
        topic = declared.wanted(number)
        if topic is None:
            return
        try:
            data = unfolded_message(file.read(length - _MESSAGE_HEAD), tally)
        except DamageError as error:
            tally.passed_over("a message is damaged", error)
            return
        yield topic, received, data
    elif opcode in (_SCHEMA, _CHANNEL):
        try:
            declared.add(opcode, BytesIO(file.read(length)))
        except DamageError as error:
            tally.passed_over("the description of a topic is damaged", error)


def _schema(content: BytesIO) -> tuple[int, str, str, str]:
    """Return number, name, encoding and text of a schema."""
    (number,) = deserialize_uint16(content.read(2))
    return number, _text(content), _text(content), _text(content)


def _channel(content: BytesIO) -> tuple[int, int, str, str]:
    """Return number, schema, topic and encoding of a channel."""
    (number,), (schema,) = (deserialize_uint16(content.read(2)) for _ in range(2))
    return number, schema, _text(content), _text(content)


def _text(content: BytesIO) -> str:
    # Comments of definitions may be in another code, which rosbags' own `read_string` refuses.
    return read_bytes(content).decode("utf-8", "replace")
