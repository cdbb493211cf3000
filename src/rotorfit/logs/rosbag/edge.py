"""The one place where rosbags ends: whatever it raises is a LogError from here on.

On damaged files rosbags raises its own errors and, as they come, those of Python, NumPy, SQLite,
lz4 and zstd.
"""

import bz2
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, Final, ParamSpec, TypeVar

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import Tally

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
    _count(size, tally)
    result = _decompressed(data, compression, size)
    if len(result) != size:
        raise DamageError("a chunk unfolds to another size than declared")
    return result


def unfolded_message(data: bytes, tally: Tally) -> bytes:
    """Decompress a message of a bag with ``compression_mode: MESSAGE``; others as they are."""
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
    """Decompress to at most one byte more than the limit."""
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
