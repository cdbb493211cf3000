"""ROS 1 bags, version 2.0, from beginning to end; the index at the end is not needed.

See wiki.ros.org/Bags/Format/2.0: records of a header (name=value fields) and data. A bag that was
never closed (``.bag.active``) is read as far as it goes.
"""

from typing import BinaryIO, Final

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import Messages, Tally, Topic, Wanted, kind_of, unfolded

BEGINS: Final = b"#ROSBAG V"
VERSION: Final = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_LARGEST_HEADER: Final = 1 << 20
_LARGEST_RECORD: Final = 1 << 30
_MOST_TOPICS: Final = 65_536

_Connections = dict[bytes, tuple[Topic, bool]]


def scan_ros1(file: BinaryIO, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, in the order of the file.

    Raises
    ------
    LogError
        If the bag has another version, or compression that cannot be read.
    """
    file.seek(0)
    begin = file.read(len(VERSION))
    if begin != VERSION:
        raise LogError(
            f"ROS bag of version {begin[9:13].decode('ascii', 'replace')!r}, expected 2.0: convert "
            "it with rosbag fix or rosbag compress"
        )
    connections: _Connections = {}
    while size := file.read(4):
        header = file.read(min(int.from_bytes(size, "little"), _LARGEST_HEADER))
        length = int.from_bytes(file.read(4), "little")
        fields = _fields(header)
        if len(header) < int.from_bytes(size, "little") or length > _LARGEST_RECORD:
            tally.passed_over("the end is cut off")
            return
        if length > tally.file_size - file.tell():
            tally.passed_over("the end is cut off")
            if fields is None or fields.get(b"compression") != b"none":
                return
        if fields is None or _opcode(fields) not in (_MESSAGE, _CHUNK, _CONNECTION):
            file.seek(length, 1)
            continue
        data = file.read(length)
        if _opcode(fields) != _CHUNK:
            yield from _one(fields, data, connections, wanted, tally)
            continue
        try:
            records = _unfolded_chunk(fields, data, tally)
        except ValueError:
            tally.passed_over("a chunk is damaged")
            continue
        yield from _messages(records, connections, wanted, tally)


def _unfolded_chunk(fields: dict[bytes, bytes], data: bytes, tally: Tally) -> bytes:
    compression = fields.get(b"compression", b"none").decode("ascii", "replace")
    return unfolded(data, compression, int.from_bytes(fields.get(b"size", b""), "little"), tally)


def _messages(records: bytes, connections: _Connections, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages among the records of a chunk."""
    place = 0
    while place + 4 <= len(records):
        start = place + 4
        end = start + int.from_bytes(records[place:start], "little")
        after = end + 4 + int.from_bytes(records[end : end + 4], "little")
        if after > len(records) or end + 4 > len(records):
            tally.passed_over("a chunk is cut off")
            return
        fields = _fields(records[start:end])
        if not fields:
            tally.passed_over("a chunk is damaged")
            return
        yield from _one(fields, records[end + 4 : after], connections, wanted, tally)
        place = after


def _one(
    fields: dict[bytes, bytes],
    data: bytes,
    connections: _Connections,
    wanted: Wanted,
    tally: Tally,
) -> Messages:
    """Take in a connection, or yield a message that is wanted."""
    number = fields.get(b"conn", b"")
    opcode = _opcode(fields)
    if opcode == _MESSAGE:
        topic, is_wanted = connections.get(number, (None, False))
        stamp = fields.get(b"time", b"")
        if topic is not None and is_wanted and len(stamp) == 8:
            seconds, nanoseconds = stamp[:4], stamp[4:]
            received = int.from_bytes(seconds, "little") * 1_000_000_000
            yield topic, received + int.from_bytes(nanoseconds, "little"), data
    elif opcode == _CONNECTION and number not in connections:
        about = _fields(data)
        if about is None:
            tally.passed_over("the description of a topic is damaged")
            return
        if len(connections) >= _MOST_TOPICS:
            raise LogError(f"more than {_MOST_TOPICS} topics: damaged or no flight log")
        topic = tally.declare(
            Topic(
                name=_text(fields.get(b"topic", about.get(b"topic", b""))),
                kind=kind_of(_text(about.get(b"type", b""))),
                encoding="ros1",
                definition=_text(about.get(b"message_definition", b"")),
            )
        )
        connections[number] = (topic, wanted(topic))


def _opcode(fields: dict[bytes, bytes]) -> int:
    return int.from_bytes(fields.get(b"op", b"")[:1], "little")


def _text(value: bytes) -> str:
    return value.decode("utf-8", "replace")


def _fields(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields of a header; None if it is damaged."""
    fields: dict[bytes, bytes] = {}
    place = 0
    while place + 4 <= len(header):
        start = place + 4
        place = start + int.from_bytes(header[place:start], "little")
        name, mark, value = header[start:place].partition(b"=")
        if place > len(header) or not mark:
            return None
        fields[name] = value
    return fields
