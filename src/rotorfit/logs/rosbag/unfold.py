"""Decompression with a bound, which rosbags does not have: a kilobyte may unfold to gigabytes.

The libraries are those that rosbags brings.
"""

import bz2
import sys
from importlib import import_module
from typing import Any, Final

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.edge import DamageError, decoded
from rotorfit.logs.rosbag.stream import Tally

LARGEST_CHUNK: Final = 128 * 2**20
"""Bytes that one compressed part may unfold to."""
_LARGEST_MESSAGE: Final = 64 * 2**20
_LARGEST_EXPANSION: Final = 40
_ALWAYS_ALLOWED: Final = 1 << 25
"""A file may unfold to so many times its size and so many bytes more: sensor data never do."""
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


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
    DamageError
        If the part is damaged.
    LogError
        If the file unfolds to more than can be meant, or how is not known.
    """
    if compression in ("", "none"):
        return data
    if size > LARGEST_CHUNK:
        raise DamageError("a chunk declares more than can be meant")
    _count(size, tally)
    result = _decompressed(data, compression, size)
    if len(result) != size:
        raise DamageError("a chunk unfolds to another size than declared")
    return result


def unfolded_message(data: bytes, tally: Tally) -> bytes:
    """Return a message of a ROS 2 bag with ``compression_mode: MESSAGE``, or as it is.

    Raises
    ------
    LogError
        As `unfolded`.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    result = _decompressed(data, "zstd", _LARGEST_MESSAGE)
    _count(len(result), tally)
    return result


def _count(size: int, tally: Tally) -> None:
    """Raise where all parts of a file together come to more than can be meant."""
    tally.unfolded += size
    if tally.unfolded > _ALWAYS_ALLOWED + _LARGEST_EXPANSION * tally.file_size:
        raise LogError(
            f"{tally.file_size} bytes unfold to more than {_LARGEST_EXPANSION} times as much: "
            "damaged or no flight log; record again without compression"
        )


def _decompressed(data: bytes, compression: str, limit: int) -> bytes:
    """Return at most one byte more than the limit."""
    parts: list[bytes] = []
    left = limit + 1
    while data and left > 0:
        decompressor = _decompressor(compression)
        part: bytes = decoded(decompressor.decompress, data, left)
        parts.append(part)
        left -= len(part)
        if not decompressor.eof:
            break
        data = decompressor.unused_data or b""
    return b"".join(parts)


def _decompressor(compression: str) -> Any:  # neither library has types
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
