"""ROS 2 bags: SQLite databases (.db3), and MCAP from beginning to end without its index.

Databases are read by rosbags within bounds of time and memory. Its reader of MCAP needs
the index or at least the end of the file, the profile ``ros2`` and sound chunks, and knows no ROS 1
messages in MCAP. So its parsers of records are used here, not its
reader: a record is one byte of opcode, eight of length and the content.
"""

from __future__ import annotations

import itertools
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2.storage_mcap import (
    deserialize_hiqq,
    deserialize_uint16,
    deserialize_uint64,
    read_bytes,
    read_exact,
    read_string,
)
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from rotorfit.errors import LogError
from rotorfit.logs.rosbag import MCAP_MAGIC
from rotorfit.logs.rosbag.stream import (
    DamageError,
    Encoding,
    Messages,
    Source,
    Tally,
    Topic,
    Wanted,
    decoded,
    kind_of,
    unfolded,
    unfolded_message,
)

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

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
            number, name, encoding, text = decoded(_read_schema, content)
            self._schemas[number] = (kind_of(name), text if encoding in _TEXT_SCHEMAS else "")
            return
        number, schema, name, encoding = decoded(_read_channel, content)
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
        for opcode, length in _walk_records(file, tally.file_size):
            left = tally.file_size - file.tell()
            if opcode == _DATA_END:
                return
            if length > left or opcode == 0:
                tally.passed_over("the end is cut off")
                if opcode != _CHUNK or length > _LARGEST_RECORD:
                    return
            if opcode == _CHUNK and length <= _LARGEST_RECORD:
                yield from _chunk_messages(file, min(length, left), declared, tally)
            elif length <= _LARGEST_RECORD:
                yield from _one_record(opcode, file, length, declared, tally)
    except DamageError as error:
        tally.passed_over("the end is cut off", error)


def _walk_records(file: Source, end: int) -> Iterator[tuple[int, int]]:
    """Yield opcode and length of each record, with the file at its content."""
    while (start := file.tell()) < end:
        head = decoded(read_exact, file, 9)
        length = int.from_bytes(head[1:], "little")
        yield head[0], length
        file.seek(min(start + 9 + length, end))


def _chunk_messages(file: Source, length: int, declared: _Declared, tally: Tally) -> Messages:
    """Yield the messages in a chunk, up to where it is damaged."""
    try:
        records = _unfold_chunk(file, length, tally)
        whole = len(records)
        with BytesIO(records) as chunk:
            del records  # one chunk at a time in memory
            for opcode, size in _walk_records(chunk, whole):
                if size > whole - chunk.tell() or opcode in (0, _CHUNK):
                    is_cut = opcode not in (0, _CHUNK)
                    tally.passed_over("a chunk is cut off" if is_cut else "a chunk is damaged")
                    return
                yield from _one_record(opcode, chunk, size, declared, tally)
    except DamageError as error:
        tally.passed_over("a chunk is damaged", error)


def _unfold_chunk(file: Source, length: int, tally: Tally) -> bytes:
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


def _one_record(
    opcode: int, file: Source, length: int, declared: _Declared, tally: Tally
) -> Messages:
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


def _read_schema(content: BytesIO) -> tuple[int, str, str, str]:
    """Return number, name, encoding and text of a schema."""
    (number,) = deserialize_uint16(content.read(2))
    return number, _decode_text(content), _decode_text(content), _decode_text(content)


def _read_channel(content: BytesIO) -> tuple[int, int, str, str]:
    """Return number, schema, topic and encoding of a channel."""
    (number,), (schema,) = (deserialize_uint16(content.read(2)) for _ in range(2))
    return number, schema, _decode_text(content), _decode_text(content)


def _decode_text(content: BytesIO) -> str:
    # Comments of definitions may be in another code, which rosbags' own `read_string` refuses.
    return read_bytes(content).decode("utf-8", "replace")


_LARGEST_VALUE: Final = 64 * 2**20
_STEPS_AT_ONCE: Final = 100_000
_STEPS_PER_BYTE: Final = 20
"""Steps of SQLite's machine: a sound bag takes less than one."""
_MOST_TOPICS: Final = 65_536
_TOPICS: Final = """
CREATE TEMP VIEW topics AS
    SELECT id, name, type, serialization_format,
        '' AS offered_qos_profiles, '' AS type_description_hash
    FROM main.topics
"""
"""In place of the table, without the profiles of quality of service: rosbags reads them as YAML,
20 kB a second, and a word missing in one is an error."""
_DEFINITIONS: Final = """
CREATE TEMP VIEW message_definitions AS
    SELECT * FROM main.message_definitions WHERE encoding = 'ros2msg'
"""
"""In place of the table: other encodings, such as ``unknown`` where the recorder found none,
are an error of rosbags."""
_NO_DEFINITIONS: Final = """
CREATE TEMP TABLE message_definitions (
    id, topic_type, encoding, encoded_message_definition, type_description_hash
)
"""


def scan_sqlite(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, by the time of receipt."""
    if path.with_name(path.name + "-wal").exists():
        tally.passed_over("a write-ahead log beside it was not merged (the recorder crashed)")
    # rosbags puts the path into a URI as it is.
    quoted = Path(quote(str(path.absolute())))
    reader = Sqlite3Reader(quoted)
    with _bound_database(tally.file_size):
        try:
            decoded(_check_database, quoted)
            decoded(reader.open)
        except DamageError as error:
            raise LogError(
                f"damaged SQLite database ({error}): copy it again, or repair it with "
                "sqlite3 .recover"
            ) from error.__cause__
    try:
        topics = {one.id: tally.declare(_topic_of_connection(one)) for one in reader.connections}
        chosen = [one for one in reader.connections if wanted(topics[one.id])]
        yield from _database_messages(reader, chosen, topics, tally)
    finally:
        reader.close()


@contextmanager
def _bound_database(file_size: int) -> Generator[None]:
    """Bound the memory and time of the databases that are opened meanwhile, and what they show."""
    left = 1 + 100 + _STEPS_PER_BYTE * file_size // _STEPS_AT_ONCE

    def too_long() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    def bound(database: Any) -> None:  # whose types are half known
        database.limit(apsw.SQLITE_LIMIT_LENGTH, _LARGEST_VALUE)
        database.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)
        database.set_progress_handler(too_long, _STEPS_AT_ONCE)
        database.execute(_TOPICS)
        tables = "SELECT count(*) FROM main.sqlite_master WHERE name = 'message_definitions'"
        database.execute(_DEFINITIONS if database.execute(tables).get else _NO_DEFINITIONS)

    apsw.connection_hooks.append(bound)
    try:
        yield
    finally:
        apsw.connection_hooks.remove(bound)


def _check_database(path: Path) -> None:
    """Raise an error if the database is no bag."""
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    opened: Any = apsw.Connection(f"file:{path}?immutable=1", flags=flags)
    with closing(opened) as database:
        # A view or a virtual table may compute for ever.
        tables = database.execute(
            "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN "
            "('topics', 'messages') AND ltrim(sql) LIKE 'CREATE TABLE%'"
        ).get
        if tables != 2:
            raise LogError(
                "an SQLite database without the tables topics and messages: not a ROS 2 bag; give "
                "the .db3 file that ros2 bag record wrote"
            )
        if database.execute("SELECT count(*) FROM topics").get > _MOST_TOPICS:
            raise LogError(f"more than {_MOST_TOPICS} topics: damaged or no flight log")


def _topic_of_connection(connection: Connection) -> Topic:
    about, definition = connection.ext, connection.msgdef
    is_cdr = isinstance(about, ConnectionExtRosbag2) and about.serialization_format == "cdr"
    is_text = definition.format == MessageDefinitionFormat.MSG
    return Topic(
        name=str(connection.topic),
        kind=kind_of(str(connection.msgtype)),
        encoding="cdr" if is_cdr else None,
        definition=str(definition.data) if is_text else "",
    )


def _database_messages(
    reader: Sqlite3Reader, chosen: list[Connection], topics: dict[int, Topic], tally: Tally
) -> Messages:
    if not chosen:
        return
    rows = reader.messages(chosen)
    count = max(sum(one.msgcount for one in chosen), 1)
    for seen in itertools.count(1):
        try:
            row = decoded(next, rows, None)
        except DamageError as error:
            tally.passed_over("the database is damaged from some message on", error)
            return
        if row is None:
            return
        tally.reached(tally.file_size * seen // count)
        connection, received, data = row
        # SQLite keeps what it is given, whatever the type of the column.
        if type(received) is not int or type(data) is not bytes:
            tally.passed_over("a message is damaged")
            continue
        try:
            message = unfolded_message(data, tally)
        except DamageError as error:
            tally.passed_over("a message is damaged", error)
            continue
        yield topics[connection.id], received, message
