"""Which files a ROS recording consists of, and how each is read."""

from pathlib import Path
from typing import Final

from rotorfit.errors import LogError
from rotorfit.logs.files import read_head
from rotorfit.logs.rosbag import mcap, ros1, sqlite
from rotorfit.logs.rosbag.stream import ZSTD_MAGIC, Messages, Tally, Wanted

_ENDINGS: Final = (".db3", ".mcap", ".bag")
_PACKED: Final = tuple(f"{ending}.zstd" for ending in _ENDINGS)


def is_rosbag(head: bytes) -> bool:
    """Return whether bytes from the beginning of a file are a ROS recording, perhaps one."""
    return head.startswith((ros1.BEGINS, mcap.MAGIC, sqlite.MAGIC))


def is_rosbag_folder(path: Path) -> bool:
    """Return whether a path is a folder as ``ros2 bag record`` makes it."""
    return path.is_dir() and bool(_in_folder(path, (*_ENDINGS, *_PACKED)))


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of a recording, in the order in which they were written.

    Raises
    ------
    LogError
        If they are compressed as a whole.
    """
    if not path.is_dir():
        return (path,)
    files = _in_folder(path, _ENDINGS)
    if packed := _in_folder(path, _PACKED):
        raise LogError(
            f"{packed[0].name} is compressed as a whole: unpack it with  unzstd {packed[0].name}"
        )
    return files


def scan(path: Path, wanted: Wanted, tally: Tally) -> Messages:
    """Yield the messages of one file of a recording.

    Raises
    ------
    LogError
        If it is none, or cannot be read.
    """
    head = read_head(path, 16)
    if head.startswith(sqlite.MAGIC):
        yield from sqlite.scan_sqlite(path, wanted, tally)
        return
    readers = {ros1.BEGINS: ros1.scan_ros1, mcap.MAGIC: mcap.scan_mcap}
    for begin, reader in readers.items():
        if head.startswith(begin):
            with path.open("rb") as file:
                for message in reader(file, wanted, tally):
                    yield message
                    tally.reached(file.tell())
            return
    packed = ", compressed as a whole: unpack it with unzstd" if head[:4] == ZSTD_MAGIC else ""
    raise LogError(f"{path.name} is no ROS bag (begins with {head[:8].hex(' ')}){packed}")


def _in_folder(path: Path, endings: tuple[str, ...]) -> tuple[Path, ...]:
    """Return files of a folder by ending, the numbers in their names counted as numbers."""
    files = (file for file in path.iterdir() if file.name.endswith(endings) and file.is_file())
    return tuple(sorted(files, key=lambda file: (len(file.name), file.name)))
