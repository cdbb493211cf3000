"""The numbers of one topic, taken from its messages some thousand at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.definitions import KNOWN, Types, types_of
from rotorfit.logs.rosbag.layout import Layout, columns_of, layout_of
from rotorfit.logs.rosbag.stream import Encoding, Topic

_AT_ONCE: Final = 4096
_BYTES_AT_ONCE: Final = 1 << 24
_LARGEST_TIME: Final = 2**63 - 1
_MOST_LAYOUTS: Final = 1000
_MOST_UNREADABLE: Final = 10
"""Of messages that are tried one by one, before those of their size are given up together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """What one topic recorded.

    Attributes
    ----------
    topic
        Its name and type.
    received
        When each message was received [ns].
    stamps
        When its data were taken, by the message itself [ns]; empty where it does not say.
    values
        Numbers by quantity, one row a message; NaN for elements that a message does not have.
    unreadable
        How many messages did not fit their definition, and why the first did not.
    """

    topic: Topic
    received: Int[np.ndarray, " n"]
    stamps: Int[np.ndarray, " m"]
    values: Mapping[str, Float[np.ndarray, "n k"]]
    unreadable: tuple[int, str]


class Decoder:
    """Collects the messages of a topic; has a state, which is what was collected.

    Parameters
    ----------
    topic
        Whose messages come.
    quantities
        Paths of numbers by quantity.
    stamp
        Paths of the stamp: seconds and nanoseconds, or microseconds; the first that is there.
    """

    def __init__(
        self,
        topic: Topic,
        quantities: Mapping[str, Sequence[str]],
        stamp: Sequence[Sequence[str]],
    ) -> None:
        self.topic = topic
        self._quantities = quantities
        self._stamp = stamp
        self._encoding: Encoding = topic.encoding or "cdr"
        self._types = _variants(topic, self._encoding)
        self._waiting: list[tuple[int, bytes]] = []
        self._bytes = 0
        self._received: list[Int[np.ndarray, " n"]] = []
        self._stamps: list[Int[np.ndarray, " n"]] = []
        self._values: dict[str, list[Float[np.ndarray, "n k"]]] = {name: [] for name in quantities}
        self._layouts = 0
        self._unreadable = 0
        self._why = ""

    def add(self, received: int, data: bytes) -> None:
        """Take in a message."""
        self._waiting.append((min(received, _LARGEST_TIME), data))
        self._bytes += len(data)
        if len(self._waiting) >= _AT_ONCE or self._bytes > _BYTES_AT_ONCE:
            self._decode()

    def finish(self) -> Recorded:
        """Return everything, in the order in which it came."""
        self._decode()
        received = _joined(self._received)
        return Recorded(
            topic=self.topic,
            received=received,
            stamps=_joined(self._stamps),
            values={name: _padded(parts) for name, parts in self._values.items()},
            unreadable=(self._unreadable, self._why),
        )

    def _decode(self) -> None:
        waiting, self._waiting, self._bytes = self._waiting, [], 0
        sizes = np.array([len(data) for _, data in waiting], dtype=np.int64)
        done: list[tuple[Int[np.ndarray, " r"], dict[str, Float[np.ndarray, "r k"]]]] = []
        stamps = np.full(len(waiting), -1, dtype=np.int64)
        for size in np.unique(sizes).tolist():
            rows = np.flatnonzero(sizes == size)
            block = np.frombuffer(b"".join(waiting[i][1] for i in rows), np.uint8)
            block = block.reshape(len(rows), size)
            while len(rows):
                layout = self._layout(block[0].tobytes())
                if layout is None:
                    lost = len(rows) if self._unreadable > _MOST_UNREADABLE else 1
                    self._unreadable += lost
                    rows, block = rows[lost:], block[lost:]
                    continue
                alike = _alike(block, layout, self._encoding)
                done.append((rows[alike], self._columns(layout, block[alike])))
                stamps[rows[alike]] = self._stamped(layout, block[alike])
                rows, block = rows[~alike], block[~alike]
        self._keep([received for received, _ in waiting], done, stamps)

    def _keep(
        self,
        received: list[int],
        done: list[tuple[Int[np.ndarray, " _"], dict[str, Float[np.ndarray, "_ _"]]]],
        stamps: Int[np.ndarray, " n"],
    ) -> None:
        """Put what was decoded back into the order in which it came."""
        if not done:
            return
        rows = np.concatenate([rows for rows, _ in done])
        order = np.argsort(rows, kind="stable")
        self._received.append(np.array(received, dtype=np.int64)[rows[order]])
        self._stamps.append(stamps[rows[order]])
        for name, parts in self._values.items():
            parts.append(_padded([columns[name] for _, columns in done])[order])

    def _layout(self, data: bytes) -> Layout | None:
        """Return the layout of a message by the first definition that it fits."""
        self._layouts += 1
        if self._layouts > _MOST_LAYOUTS:
            raise LogError(
                f"the messages of {self.topic.name} differ in shape more than {_MOST_LAYOUTS} "
                "times: damaged or no flight log"
            )
        best: Layout | None = None
        for types in self._types:
            try:
                layout = layout_of(data, self.topic.kind, types, self._encoding)
            except LogError as error:
                self._why = self._why or str(error)
                continue
            # CDR may be followed by three bytes that fill a word.
            if layout.end <= len(data) <= layout.end + 3:
                return layout
            best = best or layout
        return best

    def _columns(
        self, layout: Layout, block: UInt8[np.ndarray, "n size"]
    ) -> dict[str, Float[np.ndarray, "n k"]]:
        return {
            name: columns_of(layout, block, patterns) for name, patterns in self._quantities.items()
        }

    def _stamped(self, layout: Layout, block: UInt8[np.ndarray, "n size"]) -> Int[np.ndarray, " n"]:
        """Return the stamps [ns]; -1 where a message has none."""
        for paths in self._stamp:
            parts = [columns_of(layout, block, [path]) for path in paths]
            if not all(part.shape[1] == 1 for part in parts):
                continue
            # Below 2^53 the numbers are exact; nanoseconds are put together as integers.
            scales = (1_000_000_000, 1) if len(paths) == 2 else (1_000,)
            whole = [
                np.clip(np.nan_to_num(part[:, 0]), -1, 9e9 if scale > 1000 else 9e15).astype(
                    np.int64
                )
                * scale
                for part, scale in zip(parts, scales, strict=True)
            ]
            return np.sum(whole, axis=0)
        return np.full(len(block), -1, dtype=np.int64)


def _variants(topic: Topic, encoding: Encoding) -> tuple[Types, ...]:
    """Return the definitions of a topic's messages: the file's, else those that are known."""
    if topic.definition:
        return (types_of(topic.kind, topic.definition, encoding),)
    return tuple(types_of(topic.kind, text, encoding) for text in KNOWN.get(topic.kind, ()))


def _alike(
    block: UInt8[np.ndarray, "n size"], layout: Layout, encoding: Encoding
) -> Bool[np.ndarray, " n"]:
    """Return which messages have the lengths of the first, and so its layout."""
    places = [place + byte for place in layout.lengths for byte in range(4)]
    if encoding == "cdr":
        places += [0, 1]  # the byte order
    return (block[:, places] == block[0, places]).all(axis=1)


def _joined(parts: list[Int[np.ndarray, " _"]]) -> Int[np.ndarray, " n"]:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def _padded(parts: list[Float[np.ndarray, "_ _"]]) -> Float[np.ndarray, "n k"]:
    """Return blocks below each other, with NaN where one has fewer columns."""
    width = max((part.shape[1] for part in parts), default=0)
    return np.concatenate(
        [
            np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=np.nan)
            for part in parts
        ]
        or [np.zeros((0, width))]
    )
