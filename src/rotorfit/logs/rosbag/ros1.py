"""ROS 1 bags, version 2.0, from beginning to end; the index at the end is not needed.

The reader of rosbags needs that index, which a bag that was cut off or never closed
(``.bag.active``) has not, and keeps 180 bytes for every message of every topic in memory. So its
parser of records is used here, not its reader: a record is a header (name=value fields) and data.
"""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Final

from rosbags.rosbag1.reader import Header, read_uint32

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import (
    DamageError,
    Messages,
    Source,
    Tally,
    Topic,
    Wanted,
    decoded,
    kind_of,
    unfolded,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

_VERSION: Final = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_LARGEST_HEADER: Final = 1 << 20
_LARGEST_RECORD: Final = 1 << 30
_MOST_TOPICS: Final = 65_536

_Topics = dict[bytes, tuple[Topic, bool]]
"""The topic of each connection's number, and whether it is wanted."""


def scan_ros1(file: Source, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, in the order of the file."""
    begin = file.read(len(_VERSION))
    if begin != _VERSION:
        raise LogError(
            f"ROS bag of version {begin[9:13].decode('ascii', 'replace')!r}, expected 2.0: convert "
            "it with rosbag fix or rosbag compress"
        )
    topics: _Topics = {}
    try:
        for header, length in _walk_records(file, tally.file_size):
            is_chunk = _opcode_of(header) == _CHUNK
            if length > min(tally.file_size - file.tell(), _LARGEST_RECORD):
                tally.passed_over("the end is cut off")
                is_plain = is_chunk and header.get("compression") == b"none"
                if not is_plain or length > _LARGEST_RECORD:
                    return
            if is_chunk:
                yield from _chunk_messages(header, file.read(length), topics, wanted, tally)
            else:
                yield from _one_record(header, file, length, topics, wanted, tally)
    except DamageError as error:
        tally.passed_over("the end is cut off", error)


def _walk_records(file: Source, end: int) -> Iterator[tuple[Header, int]]:
    """Yield header and length of each record, with the file at its data."""
    while (start := file.tell()) < end:
        size = decoded(read_uint32, file)
        if size > _LARGEST_HEADER:
            raise DamageError(f"a header of {size} bytes")
        file.seek(start + 4 + size)
        length = decoded(read_uint32, file)
        data = file.tell()
        file.seek(start)
        try:
            header = decoded(Header.read, file)
        except DamageError:
            header = Header()  # its lengths are sound: the record is passed over
        file.seek(data)
        yield header, length
        file.seek(data + length)


def _chunk_messages(
    header: Header, stored: bytes, topics: _Topics, wanted: Wanted, tally: Tally
) -> Messages:
    """Yield the messages in a chunk, up to where it is damaged."""
    compression = header.get("compression", b"none").decode("ascii", "replace")
    size = int.from_bytes(header.get("size", b""), "little")
    try:
        records = unfolded(stored, compression, size, tally)
        whole = len(records)
        with BytesIO(records) as file:
            del records, stored  # one chunk at a time in memory
            for inner, length in _walk_records(file, whole):
                if length > whole - file.tell():
                    tally.passed_over("a chunk is cut off")
                    return
                yield from _one_record(inner, file, length, topics, wanted, tally)
    except DamageError as error:
        tally.passed_over("a chunk is damaged", error)


def _one_record(
    header: Header, file: Source, length: int, topics: _Topics, wanted: Wanted, tally: Tally
) -> Messages:
    """Take in a connection, or yield a message that is wanted."""
    number, opcode = header.get("conn", b""), _opcode_of(header)
    if opcode == _MESSAGE:
        topic, is_wanted = topics.get(number, (None, False))
        if topic is None or not is_wanted:
            return
        try:
            received = decoded(header.get_time, "time")
        except DamageError as error:
            tally.passed_over("a message is damaged", error)
            return
        yield topic, received, file.read(length)
    elif opcode == _CONNECTION and number not in topics:
        if len(topics) >= _MOST_TOPICS:
            raise LogError(f"more than {_MOST_TOPICS} topics: damaged or no flight log")
        try:
            topic = tally.declare(_topic_of_connection(header, file.read(length)))
        except DamageError as error:
            tally.passed_over("the description of a topic is damaged", error)
            return
        topics[number] = (topic, wanted(topic))
    elif not header:
        tally.passed_over("a record is damaged")


def _topic_of_connection(header: Header, data: bytes) -> Topic:
    """Return the topic of a connection; its data have the form of a header."""
    about = decoded(Header.read, BytesIO(len(data).to_bytes(4, "little") + data))
    return Topic(
        name=_decode_text(header.get("topic", about.get("topic", b""))),
        kind=kind_of(_decode_text(about.get("type", b""))),
        encoding="ros1",
        definition=_decode_text(about.get("message_definition", b"")),
    )


def _opcode_of(header: Header) -> int:
    return int.from_bytes(header.get("op", b"")[:1], "little")


def _decode_text(value: bytes) -> str:
    # Comments of definitions may be in another code, which rosbags' own `get_string` refuses.
    return value.decode("utf-8", "replace")
