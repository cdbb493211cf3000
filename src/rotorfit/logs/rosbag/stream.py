"""The stream of a ROS recording: topics, then raw messages, then the numbers in them.

A message says when its data were taken, the recorder when it arrived. The first is better, unless
it is empty, jumps, or belongs to a clock that has nothing to do with the recorder's. A clock that
only began elsewhere (the autopilot's, at power-on) is moved: the fastest messages took no time.

Here rosbags ends: on damaged files it raises its own errors and, as they come, those of Python,
NumPy, SQLite, lz4 and zstd; all are LogErrors from here on.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from io import BufferedReader, BytesIO
from typing import TYPE_CHECKING, Any, Final, Literal, ParamSpec, TypeAlias, TypeVar

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import report_progress

if TYPE_CHECKING:
    from jaxtyping import Float, Int

Encoding = Literal["ros1", "cdr"]


@frozen_dataclass
class Topic:
    """A topic of a recording; `kind` is the type of its messages as ``package/Name``.

    `encoding` is None where rotorfit does not know it, `definition` empty where the file has none.
    """

    name: str
    kind: str
    encoding: Encoding | None
    definition: str


Source: TypeAlias = BufferedReader | BytesIO
"""A file, or a part of one that was unfolded."""
Message: TypeAlias = tuple[Topic, int, bytes]
"""Topic, time of receipt [ns], and the serialised message."""
Wanted: TypeAlias = Callable[[Topic], bool]
Messages: TypeAlias = Iterator[Message]


@frozen_dataclass
class Recorded:
    """What one topic recorded: times of receipt and of the messages' own stamps [ns], numbers.

    NaN stands for elements that a message does not have; `unreadable` counts the messages that did
    not fit their definition, and says why the first did not.
    """

    topic: Topic
    received: Int[np.ndarray, " n"]
    stamps: Int[np.ndarray, " m"]
    values: Mapping[str, Float[np.ndarray, "n k"]]
    unreadable: tuple[int, str]


@frozen_dataclass
class Contents:
    """What the files of a recording hold: topics that were read, others, and damage by phrase."""

    topics: list[Recorded]
    others: list[Topic]
    damage: dict[str, int]
    cause: BaseException | None


@dataclass(slots=True, kw_only=True)
class Tally:
    """What was met on the way through a file, filled while it is read.

    `before` are the bytes of the recording's files before this one, `unfolded` those that
    compressed parts came to.
    """

    file_size: int
    before: int
    recording_size: int
    unfolded: int = 0
    topics: dict[tuple[str, str], Topic] = field(default_factory=dict[tuple[str, str], Topic])
    damage: dict[str, int] = field(default_factory=dict[str, int])
    cause: BaseException | None = None

    def passed_over(self, what: str, error: BaseException | None = None) -> None:
        """Count one more piece of damage."""
        self.damage[what] = self.damage.get(what, 0) + 1
        if self.cause is None and error is not None:
            # Without its trace, which holds the chunk that was being read.
            self.cause = (error.__cause__ or error).with_traceback(None)

    def reached(self, place: int) -> None:
        """Tell how much of the recording was gone through, up to a place in the file."""
        report_progress(self.before + min(place, self.file_size), self.recording_size)

    def declare(self, topic: Topic) -> Topic:
        """Note a topic, and return it."""
        return self.topics.setdefault((topic.name, topic.kind), topic)


def kind_of(name: str) -> str:
    """Return a type name as ``package/Name``, without the ``msg`` of ROS 2."""
    return name.replace("/msg/", "/")


_SAME_CLOCK: Final = 1.0
"""Median delay up to which stamps count as the recorder's own clock [s]."""
_STEADY: Final = 1.0
"""Spread of the delay of a clock that only began elsewhere [s]."""
_ONE_SOURCE: Final = 0.25
"""Offsets closer than this belong to one clock [s]."""
_BACKWARDS: Final = 0.1
"""Share of stamps before the one received before: messages overtake each other, now and then."""
_REPEATED: Final = 0.2


Basis: TypeAlias = Literal["stamps", "moved", "receipt"]
"""Stamps by the recorder's clock, stamps of a clock that began elsewhere, or times of receipt."""


@frozen_dataclass
class Timing:
    """The clock of one topic, since the beginning of the recording [s].

    `why` has the numbers that decided, `basis` says whose times they are.
    """

    time: Float[np.ndarray, " n"]
    why: str
    basis: Basis


def timings(topics: Sequence[Recorded], start: int) -> list[Timing]:
    """Choose the clock of each topic."""
    offsets = [_stamp_offset(topic) for topic in topics]
    return [
        _topic_timing(topic, offset, _shared_offset(offset, offsets), start)
        for topic, offset in zip(topics, offsets, strict=True)
    ]


def _stamp_offset(topic: Recorded) -> float | None:
    """Compute by how much stamps are to be moved [s]: 0 or more than that; None: no good stamps."""
    stamps, received = topic.stamps, topic.received
    if len(stamps) == 0 or (stamps <= 0).any():
        return None
    steps = np.diff(stamps)
    if len(steps) and ((steps < 0).mean() > _BACKWARDS or (steps == 0).mean() > _REPEATED):
        return None
    delay = _seconds_between(received, stamps)
    low, middle, high = np.percentile(delay, [5.0, 50.0, 95.0]).tolist()
    if abs(middle) < _SAME_CLOCK:
        return 0.0
    return float(delay.min()) if high - low < _STEADY else None


def _shared_offset(offset: float | None, offsets: Sequence[float | None]) -> float | None:
    """Return the offset of the clock that several topics share: the least, of the fastest one."""
    if not offset:
        return offset
    return min(o for o in offsets if o and abs(o - offset) < _ONE_SOURCE)


def _topic_timing(topic: Recorded, own: float | None, offset: float | None, start: int) -> Timing:
    received = _seconds_between(topic.received, np.full(1, start))
    if own is None or offset is None:
        return Timing(time=received, why=_why_not(topic), basis="receipt")
    delay = _seconds_between(topic.received, topic.stamps)
    time = received - delay + offset
    if offset == 0.0:
        why = f"stamps, received {1e3 * float(np.median(delay)):.1f} ms later (median)"
        return Timing(time=time, why=why, basis="stamps")
    why = f"stamps of a clock that began elsewhere, moved by {offset:.3f} s to the recorder's"
    return Timing(time=time, why=why, basis="moved")


def _why_not(topic: Recorded) -> str:
    if len(topic.stamps) == 0 or (topic.stamps < 0).all():
        return "times of receipt: its messages have no stamp"
    if (topic.stamps <= 0).any():
        return "times of receipt: its stamps are zero"
    steps = np.diff(topic.stamps)
    if len(steps) and (steps < 0).mean() > _BACKWARDS:
        return "times of receipt: its stamps go back"
    if len(steps) and (steps == 0).mean() > _REPEATED:
        return "times of receipt: its stamps repeat"
    return "times of receipt: its stamps belong to no steady clock"


def _seconds_between(
    later: Int[np.ndarray, " n"], earlier: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " n"]:
    """Subtract nanoseconds without overflow [s]."""
    whole = later // 1_000_000_000 - earlier // 1_000_000_000
    return whole + 1e-9 * (later % 1_000_000_000 - earlier % 1_000_000_000)


P = ParamSpec("P")
R = TypeVar("R")

_LONGEST: Final = 160


class DamageError(LogError):
    """What rosbags was given cannot be decoded; the cause says why."""


def require_rosbags() -> None:
    """Raise LogError where rosbags is not installed."""
    try:
        import_module("rosbags.interfaces")
    except ImportError as error:
        raise LogError("reading ROS bags needs rosbags: pip install 'rotorfit[ros]'") from error


def decoded(call: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Call a function of rosbags, raising DamageError for what it raises."""
    try:
        return call(*args, **kwargs)
    except (LogError, MemoryError):
        raise
    except Exception as error:
        # Of the disk's errors: bz2 has one of the same class, without a number.
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise DamageError(in_words(error)) from error


def in_words(error: BaseException) -> str:
    """Return one short line for an error; its text may quote what is no text."""
    try:
        text = " ".join(str(error).split())
    except UnicodeDecodeError:
        text = ""
    shown = "".join(letter if letter.isprintable() else "\ufffd" for letter in text[:_LONGEST])
    return f"{type(error).__name__}: {shown}" if shown else type(error).__name__


LARGEST_CHUNK: Final = 128 * 2**20
"""Bytes that one compressed part may unfold to."""
_LARGEST_MESSAGE: Final = 64 * 2**20
_LARGEST_EXPANSION: Final = 40
_ALWAYS_ALLOWED: Final = 1 << 25
"""A file may unfold to so many times its size and so many bytes more: sensor data never do."""
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


def unfolded(data: bytes, compression: str, size: int, tally: Tally) -> bytes:
    """Decompress a part."""
    if compression in ("", "none"):
        return data
    if size > LARGEST_CHUNK:
        raise DamageError("a chunk declares more than can be meant")
    _count_unfolded(size, tally)
    result = _decompress_limited(data, compression, size)
    if len(result) != size:
        raise DamageError("a chunk unfolds to another size than declared")
    return result


def unfolded_message(data: bytes, tally: Tally) -> bytes:
    """Decompress a message of a bag with ``compression_mode: MESSAGE``; others as they are."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    result = _decompress_limited(data, "zstd", _LARGEST_MESSAGE)
    _count_unfolded(len(result), tally)
    return result


def _count_unfolded(size: int, tally: Tally) -> None:
    """Raise an error if all parts of a file together come to more than can be meant."""
    tally.unfolded += size
    if tally.unfolded > _ALWAYS_ALLOWED + _LARGEST_EXPANSION * tally.file_size:
        raise LogError(
            f"{tally.file_size} bytes unfold to more than {_LARGEST_EXPANSION} times as much: "
            "damaged or no flight log; record again without compression"
        )


def _decompress_limited(data: bytes, compression: str, limit: int) -> bytes:
    """Decompress to at most one byte more than the limit."""
    parts: list[bytes] = []
    left = limit + 1
    while data and left > 0:
        decompressor = _make_decompressor(compression)
        part: bytes = decoded(decompressor.decompress, data, left)
        parts.append(part)
        left -= len(part)
        if not decompressor.eof:
            break
        data = decompressor.unused_data or b""
    return b"".join(parts)


def _make_decompressor(compression: str) -> Any:  # neither library has types
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "lz4":
        return import_module("lz4.frame").LZ4FrameDecompressor()
    if compression == "zstd":
        package = "compression" if sys.version_info >= (3, 14) else "backports"
        return import_module(f"{package}.zstd").ZstdDecompressor()
    raise LogError(
        f"the recording is compressed by {compression[:20]!r}, expected lz4, zstd or bz2: record "
        "again, or convert it with the tools of ROS"
    )
