"""ROS recordings (ROS 1 bags, ROS 2 SQLite bags and MCAP): how to detect one, and its files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError

if TYPE_CHECKING:
    from pathlib import Path

ROS1_BEGINS: Final = b"#ROSBAG V"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE_MAGIC: Final = b"SQLite format 3\x00"
_ENDINGS: Final = (".db3", ".mcap", ".bag")
_PACKED: Final = tuple(f"{ending}.zstd" for ending in _ENDINGS)


def is_rosbag(head: bytes) -> bool:
    """Return whether bytes from the beginning of a file are a ROS recording, perhaps one."""
    return head.startswith((ROS1_BEGINS, MCAP_MAGIC, SQLITE_MAGIC))


def is_rosbag_folder(path: Path) -> bool:
    """Return whether a path is a folder as ``ros2 bag record`` makes it."""
    return path.is_dir() and bool(_in_folder(path, (*_ENDINGS, *_PACKED)))


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of a recording, in the order in which they were written."""
    if not path.is_dir():
        return (path,)
    files = _in_folder(path, _ENDINGS)
    if packed := _in_folder(path, _PACKED):
        raise LogError(
            f"{packed[0].name} is compressed as a whole: unpack it with  unzstd {packed[0].name}"
        )
    return files


def _in_folder(path: Path, endings: tuple[str, ...]) -> tuple[Path, ...]:
    """Return files of a folder by ending, the numbers in their names counted as numbers."""
    files = (file for file in path.iterdir() if file.name.endswith(endings) and file.is_file())
    return tuple(sorted(files, key=lambda file: (len(file.name), file.name)))
