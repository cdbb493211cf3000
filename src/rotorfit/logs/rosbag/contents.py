"""One pass through the files of a ROS recording; from here on rosbags is imported."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from rotorfit.errors import LogError
from rotorfit.logs.columns import ColumnSpec
from rotorfit.logs.files import read_head
from rotorfit.logs.rosbag import MCAP_MAGIC, ROS1_BEGINS, SQLITE_MAGIC
from rotorfit.logs.rosbag.decode import Decoder
from rotorfit.logs.rosbag.definitions import Definitions
from rotorfit.logs.rosbag.mapped import mapped_paths
from rotorfit.logs.rosbag.mcap import scan_mcap
from rotorfit.logs.rosbag.messages import MESSAGES, STAMPS
from rotorfit.logs.rosbag.ros1 import scan_ros1
from rotorfit.logs.rosbag.sqlite import scan_sqlite
from rotorfit.logs.rosbag.stream import Contents, Messages, Tally, Topic, Wanted
from rotorfit.logs.rosbag.unfold import ZSTD_MAGIC

_MOST_TOPICS_READ: Final = 256
_SCANS: Final = {ROS1_BEGINS: scan_ros1, MCAP_MAGIC: scan_mcap}


def contents_of(files: Sequence[Path], mapped: Mapping[str, ColumnSpec]) -> Contents:
    """Return the numbers of the topics that are known or named, one pass through every file."""
    definitions = Definitions()
    decoders: dict[tuple[str, str], Decoder] = {}
    others: dict[tuple[str, str], Topic] = {}
    damage: dict[str, int] = {}
    cause: BaseException | None = None

    def wanted(topic: Topic) -> bool:
        key = (topic.name, topic.kind)
        if key in decoders:
            return True
        quantities = _quantities(topic, mapped)
        if not quantities or topic.encoding is None or len(decoders) >= _MOST_TOPICS_READ:
            others[key] = topic
            return False
        decoders[key] = Decoder(topic, quantities, STAMPS, definitions)
        return True

    sizes = [file.stat().st_size for file in files]
    for k, file in enumerate(files):
        tally = Tally(file_size=sizes[k], before=sum(sizes[:k]), recording_size=sum(sizes))
        for topic, received, data in _scan(file, wanted, tally):
            decoders[(topic.name, topic.kind)].add(received, data)
        for what, count in tally.damage.items():
            damage[what] = damage.get(what, 0) + count
        cause = cause or tally.cause
    for decoder in decoders.values():
        cause = cause or decoder.cause
    recorded = [decoder.finish() for decoder in decoders.values()]
    return Contents(topics=recorded, others=list(others.values()), damage=damage, cause=cause)


def _quantities(topic: Topic, mapped: Mapping[str, ColumnSpec]) -> dict[str, tuple[str, ...]]:
    """Return what is wanted of a topic's messages."""
    kind = MESSAGES.get(topic.kind)
    known = {} if kind is None else {name: q.paths for name, q in kind.channels.items()}
    return {**known, **mapped_paths(topic.name, mapped)}


def _scan(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of one file, by its format."""
    head = read_head(path, 16)
    if head.startswith(SQLITE_MAGIC):
        yield from scan_sqlite(path, wanted, tally)
        return
    for begin, scan_file in _SCANS.items():
        if head.startswith(begin):
            with path.open("rb") as file:
                for message in scan_file(file, wanted, tally):
                    yield message
                    tally.reached(file.tell())
            return
    packed = ", compressed as a whole: unpack it with unzstd" if head[:4] == ZSTD_MAGIC else ""
    raise LogError(f"{path.name} is no ROS bag (begins with {head[:8].hex(' ')}){packed}")
