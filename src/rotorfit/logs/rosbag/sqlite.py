"""ROS 2 bags in an SQLite database (.db3): its tables topics, messages, message_definitions."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import Messages, Tally, Topic, Wanted, kind_of, unfolded_message

MAGIC: Final = b"SQLite format 3\x00"
_LARGEST_VALUE: Final = 64 * 2**20
_STEPS_AT_ONCE: Final = 100_000
_STEPS_PER_BYTE: Final = 20
"""Of SQLite's machine: a sound bag takes less than one."""
_MOST_TOPICS: Final = 65_536


def scan_sqlite(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of the topics that are wanted, in the order of the database.

    Raises
    ------
    LogError
        If it is no ROS 2 bag, or damaged so that nothing of it can be read.
    """
    if path.with_name(path.name + "-wal").exists():
        tally.passed_over("a write-ahead log beside it was not merged (the recorder crashed)")
    try:
        with closing(_opened(path, tally)) as database:
            topics = _topics(database, tally)
            chosen = {number: topic for number, topic in topics.items() if wanted(topic)}
            yield from _messages(database, chosen, tally)
    # A damaged schema may come to light in an error message that is no text.
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        raise LogError(
            f"damaged SQLite database ({str(error)[:200]}): copy it again, or repair it with "
            "sqlite3 .recover"
        ) from error


def _opened(path: Path, tally: Tally) -> sqlite3.Connection:
    """Return the database, opened for reading only, with bounds on memory and time."""
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST_VALUE)
    database.text_factory = lambda value: value.decode("utf-8", "replace")  # pyright: ignore[reportUnknownMemberType, reportUnknownLambdaType]
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA mmap_size = 0")
    left = 1 + 100 + _STEPS_PER_BYTE * tally.file_size // _STEPS_AT_ONCE

    def too_long() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    database.set_progress_handler(too_long, _STEPS_AT_ONCE)
    return database


def _topics(database: sqlite3.Connection, tally: Tally) -> dict[int, Topic]:
    plain = {
        str(name)
        for name, sql in database.execute("SELECT name, sql FROM sqlite_master WHERE type='table'")
        if str(sql).lstrip().upper().startswith("CREATE TABLE")
    }
    if not {"topics", "messages"} <= plain:
        raise LogError(
            "an SQLite database without the tables topics and messages: not a ROS 2 bag; give the "
            ".db3 file that ros2 bag record wrote"
        )
    definitions: dict[str, str] = {}
    if "message_definitions" in plain:
        rows = database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        definitions = {str(kind): str(text) for kind, code, text in rows if code == "ros2msg"}
    topics: dict[int, Topic] = {}
    for number, name, kind, code in database.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        if len(topics) >= _MOST_TOPICS:
            raise LogError(f"more than {_MOST_TOPICS} topics: damaged or no flight log")
        topics[number] = tally.declare(
            Topic(
                name=str(name),
                kind=kind_of(str(kind)),
                encoding="cdr" if code == "cdr" else None,
                definition=definitions.get(str(kind), ""),
            )
        )
    return topics


def _messages(database: sqlite3.Connection, topics: dict[int, Topic], tally: Tally) -> Messages:
    query = "SELECT topic_id, timestamp, data FROM messages"
    rows: Any = database.execute(query)
    seen = 0
    while True:
        try:
            row = next(rows, None)
        except (sqlite3.Error, OverflowError, UnicodeDecodeError):
            tally.passed_over("the database is damaged from some message on")
            return
        if row is None:
            return
        seen += len(row[2]) if isinstance(row[2], bytes) else 0
        tally.reached(seen)
        topic = topics.get(row[0])
        if topic is None or topic.encoding is None:
            continue
        if not isinstance(row[1], int) or not isinstance(row[2], bytes):
            tally.passed_over("a message is damaged")
            continue
        try:
            yield topic, row[1], unfolded_message(row[2], tally)
        except ValueError:
            tally.passed_over("a message is damaged")
