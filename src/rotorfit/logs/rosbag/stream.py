"""What every ROS container yields: topics, then raw messages; and decompression with a bound."""

import bz2
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from typing import Any, Final, Literal, TypeAlias

from rotorfit.errors import LogError
from rotorfit.logs.progress import tell

Encoding = Literal["ros1", "cdr"]

LARGEST_CHUNK: Final = 128 * 2**20
"""Bytes that one compressed part may unfold to."""
_LARGEST_MESSAGE: Final = 64 * 2**20
_LARGEST_EXPANSION: Final = 40
"""A file may unfold to so many times its size (and one chunk more): sensor data never do."""
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name
        Such as ``/mavros/imu/data_raw``.
    kind
        Type of its messages as ``package/Name``.
    encoding
        Of its messages; None where rotorfit does not know it.
    definition
        Of its messages, as the file has it; empty where it has none.
    """

    name: str
    kind: str
    encoding: Encoding | None
    definition: str


Message: TypeAlias = tuple[Topic, int, bytes]
"""Topic, time of receipt [ns], and the serialised message."""
Wanted: TypeAlias = Callable[[Topic], bool]
Messages: TypeAlias = Iterator[Message]


@dataclass(slots=True, kw_only=True)
class Tally:
    """What was met on the way through a file; filled while it is read.

    Attributes
    ----------
    file_size
        [bytes]
    before
        Bytes of the recording's files that come before this one.
    recording_size
        Bytes of all its files.
    unfolded
        Bytes that compressed parts came to.
    topics
        All of them, by name and type.
    damage
        What was passed over, one phrase each, with how often.
    """

    file_size: int
    before: int
    recording_size: int
    unfolded: int = 0
    topics: dict[tuple[str, str], Topic] = field(default_factory=dict[tuple[str, str], Topic])
    damage: dict[str, int] = field(default_factory=dict[str, int])

    def passed_over(self, what: str) -> None:
        """Count one more piece of damage."""
        self.damage[what] = self.damage.get(what, 0) + 1

    def reached(self, place: int) -> None:
        """Tell how much of the recording was gone through, up to a place in the file."""
        tell(self.before + min(place, self.file_size), self.recording_size)

    def declare(self, topic: Topic) -> Topic:
        """Note a topic, and return it."""
        return self.topics.setdefault((topic.name, topic.kind), topic)


def kind_of(name: str) -> str:
    """Return a type name as ``package/Name``, without the ``msg`` of ROS 2."""
    return name.replace("/msg/", "/")


def unfolded(data: bytes, compression: str, size: int, tally: Tally) -> bytes:
    """Return the bytes of a compressed part.

    Parameters
    ----------
    data
        As stored.
    compression
        ``""`` or ``none``, ``lz4``, ``zstd`` or ``bz2``.
    size
        What it is declared to unfold to.
    tally
        Of the file, whose bound is kept.

    Raises
    ------
    LogError
        If the library is not installed, or the part unfolds to more than can be meant.
    ValueError
        If the part is damaged.
    """
    if compression in ("", "none"):
        return data
    if size > LARGEST_CHUNK:
        raise ValueError("a chunk declares more than can be meant")
    tally.unfolded += size
    if tally.unfolded > LARGEST_CHUNK + _LARGEST_EXPANSION * tally.file_size:
        raise LogError(
            f"{tally.file_size} bytes unfold to more than {_LARGEST_EXPANSION} times as much: "
            "damaged or no flight log; record again without compression"
        )
    result = _decompressed(data, compression, size)
    if len(result) != size:
        raise ValueError("a chunk unfolds to another size than declared")
    return result


def unfolded_message(data: bytes, tally: Tally) -> bytes:
    """Return a message of a ROS 2 bag with ``compression_mode: MESSAGE``, or as it is.

    Raises
    ------
    LogError, ValueError
        As `unfolded`.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    result = _decompressed(data, "zstd", _LARGEST_MESSAGE)
    return unfolded(result, "none", len(result), tally)


def _decompressed(data: bytes, compression: str, limit: int) -> bytes:
    """Return at most one byte more than the limit."""
    parts: list[bytes] = []
    left = limit + 1
    try:
        while data and left > 0:
            decompressor = _decompressor(compression)
            part = decompressor.decompress(data, left)
            parts.append(part)
            left -= len(part)
            if not decompressor.eof:
                break
            data = decompressor.unused_data or b""
    except LogError:
        raise
    except Exception as error:
        raise ValueError(f"a compressed part is damaged ({error})") from error
    return b"".join(parts)


def _decompressor(compression: str) -> Any:  # neither library has types
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "lz4":
        return _imported("lz4.frame").LZ4FrameDecompressor()
    if compression == "zstd":
        return _imported("compression.zstd", "backports.zstd").ZstdDecompressor()
    raise LogError(
        f"the recording is compressed by {compression[:20]!r}, expected lz4, zstd or bz2: record "
        "again, or convert it with the tools of ROS"
    )


@cache  # a name that is not there is searched for a quarter of a millisecond
def _imported(*names: str) -> Any:
    for name in names:
        try:
            return import_module(name)
        except ImportError:
            continue
    raise LogError(
        f"reading this compressed recording needs {names[-1].split('.')[0]}: "
        "pip install 'rotorfit[ros]'"
    )
