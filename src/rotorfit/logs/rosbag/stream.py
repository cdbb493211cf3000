"""What every ROS recording yields: topics, then raw messages, then the numbers in them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BufferedReader, BytesIO
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from rotorfit.logs.progress import report_progress

Encoding = Literal["ros1", "cdr"]


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
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
