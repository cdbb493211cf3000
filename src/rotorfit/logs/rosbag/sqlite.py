"""ROS 2 bags in an SQLite database (.db3), read by rosbags within bounds of time and memory."""

import itertools
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.edge import DamageError, decoded, unfolded_message
from rotorfit.logs.rosbag.stream import Messages, Tally, Topic, Wanted, kind_of

_LARGEST_VALUE: Final = 64 * 2**20
_STEPS_AT_ONCE: Final = 100_000
_STEPS_PER_BYTE: Final = 20
"""Of SQLite's machine: a sound bag takes less than one."""
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
    with _bounded(tally.file_size):
        try:
            decoded(_check, quoted)
            decoded(reader.open)
        except DamageError as error:
            raise LogError(
                f"damaged SQLite database ({error}): copy it again, or repair it with "
                "sqlite3 .recover"
            ) from error.__cause__
    try:
        topics = {one.id: tally.declare(_topic(one)) for one in reader.connections}
        chosen = [one for one in reader.connections if wanted(topics[one.id])]
        yield from _messages(reader, chosen, topics, tally)
    finally:
        reader.close()


@contextmanager
def _bounded(file_size: int) -> Generator[None]:
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


def _check(path: Path) -> None:
    """Raise where the database is no bag."""
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


def _topic(connection: Connection) -> Topic:
    about, definition = connection.ext, connection.msgdef
    is_cdr = isinstance(about, ConnectionExtRosbag2) and about.serialization_format == "cdr"
    is_text = definition.format == MessageDefinitionFormat.MSG
    return Topic(
        name=str(connection.topic),
        kind=kind_of(str(connection.msgtype)),
        encoding="cdr" if is_cdr else None,
        definition=str(definition.data) if is_text else "",
    )


def _messages(
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
