"""Whole files: their bytes and their fingerprint, how far they are read, errors to act on."""

from __future__ import annotations

import hashlib
import mmap
import os
import shlex
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from io import BufferedReader, BytesIO
from pathlib import Path

from rotorfit.errors import LogError, OutputError
from rotorfit.logs.foreign import GZIP, ZIP

Progress = Callable[[float], None]
"""Told how much of a file was gone through: from 0 to 1, never less than before."""
Watcher = Callable[[Path, float], None]
"""Told the same of every file."""
SMALLEST_STEP = 0.01

_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)
_progress: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def watched(watcher: Watcher) -> Generator[None]:
    """Report to a function how far each log is that is read meanwhile.

    For long work that reads logs on its way, such as `identify`. `read_log` itself takes a
    function for its one file.
    """
    before = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(before)


@contextmanager
def read_for(path: Path, progress: Progress | None) -> Generator[None]:
    """Pass on the progress of a file's reader, in steps of a hundredth, ending with 1."""
    watcher = _watcher.get()
    reported = -1.0

    def pass_on(done: float) -> None:
        nonlocal reported
        done = min(done, 1.0)
        # A file that is gone through again begins anew: the first time is what counts.
        if done < reported + SMALLEST_STEP and not (done == 1.0 > reported):
            return
        reported = done
        if progress is not None:
            progress(done)
        if watcher is not None:
            watcher(path, done)

    is_watched = progress is not None or watcher is not None
    before = _progress.set(pass_on if is_watched else None)
    try:
        yield
        pass_on(1.0)
    finally:
        _progress.reset(before)


def report_progress(done: int, size: int) -> None:
    """Tell, as a reader, that so many of a file's bytes were gone through."""
    progress = _progress.get()
    if progress is not None and size > 0:
        progress(done / size)


BLOCK = 4 << 20

Content = bytes | mmap.mmap
"""Content of a file: in memory, or mapped."""


def unpacked_log(path: Path) -> bytes | None:
    """Return the log in an archive; None if the file is none, or cannot be opened."""
    begin = b""
    with suppress(OSError, ValueError), path.open("rb") as file:  # whoever reads it says why
        begin = file.read(4)
    if not begin.startswith((ZIP, GZIP)):
        return None
    from rotorfit.logs.archives import unpack_log  # what most logs need not is not imported

    return unpack_log(path)


def open_file(path: Path) -> BufferedReader | BytesIO:
    """Open a file, or the log in an archive, to read its bytes."""
    unpacked = unpacked_log(path)
    return path.open("rb") if unpacked is None else BytesIO(unpacked)


def open_mapped(path: Path) -> Content:
    """Return a file as bytes that come into memory when they are looked at."""
    read_head(path, 1)  # refuses what cannot be read
    unpacked = unpacked_log(path)
    if unpacked is not None:
        return unpacked
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError):  # ValueError: emptied since
        # Where the system maps no files, as in a browser, they are in memory at once.
        return read_bytes(path)


def file_name(path: str) -> str:
    """Return the last part of a path of any system; folders are nobody else's business."""
    return path.replace("\\", "/").rstrip("/").rsplit("/", maxsplit=1)[-1] or path


def read_blocks(path: Path, turn: tuple[float, float] = (0.0, 1.0)) -> Iterator[bytes]:
    """Yield a file in pieces: a log need not fit into the memory.

    The turn is what was read before of all that is to be read, and what share this is.
    """
    try:
        with open_file(path) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(0)
            while block := file.read(BLOCK):
                yield block
                report_progress(round(size * turn[0] + file.tell() * turn[1]), size)
    except OSError as error:
        raise LogError(f"cannot be read ({error}): check the path and the disk") from error


def let_go(data: Content) -> None:
    """Give back the memory of a mapped file; what is looked at again is read again."""
    if isinstance(data, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        with suppress(OSError):  # advice that the system does not take
            data.madvise(mmap.MADV_DONTNEED)


def read_bytes(path: Path) -> bytes:
    """Read everything in a file."""
    return read_head(path, -1)


def read_head(path: Path, size: int) -> bytes:
    """Read the first bytes of a file, at most `size`; all of them if it is negative."""
    try:
        with open_file(path) as file:
            data = file.read(size)
    except FileNotFoundError as error:
        is_address = str(path).startswith(("http:/", "https:/"))
        cure = "download the log, and give the file" if is_address else "check the path"
        raise LogError(f"{path}: no such file: {cure}") from error
    except IsADirectoryError as error:
        raise LogError(
            f"{path}: is a directory, expected a log file: name the file in it (rotorfit "
            f"inspect {shlex.quote(str(path))} looks at every log there)"
        ) from error
    except PermissionError as error:
        raise LogError(f"{path}: permission denied: make the file readable") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise LogError(f"{path}: cannot be read ({error}): check the path and the disk") from error
    if not data:
        raise LogError(f"{path}: is empty (0 bytes), expected a flight log: copy it again")
    return data


def sha256_of(path: Path) -> str:
    """Compute the SHA-256 of a file."""
    read_head(path, 1)  # refuses what cannot be read
    try:
        with open_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error}): check the path and the disk") from error


def refuse_special_file(path: Path) -> None:
    """Raise if a path is a device or a pipe, in whose place a file would be moved."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OutputError(f"{path} is a device or a pipe, and no file; name a file")


def write_whole(path: Path, content: str | bytes, *, force: bool = False) -> None:
    """Write a file whole or not at all: under another name first, then moved into place."""
    write_all_whole({path: content}, force=force)


def write_all_whole(files: Mapping[Path, str | bytes], *, force: bool = False) -> None:
    """Write all of several files or none: move them into place once the last is complete."""
    for path in files:
        refuse_special_file(path)
        if path.exists() and not force:
            raise OutputError(f"{path}: is there already: choose another name, or force")
    unfinished = {path: path.with_name(f".{path.name}.{os.getpid()}.unfinished") for path in files}
    path = Path()
    try:
        for path, content in files.items():
            with unfinished[path].open("xb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
        for path, complete in unfinished.items():
            complete.replace(path)
    except OSError as error:
        for left in unfinished.values():
            left.unlink(missing_ok=True)
        reason = error.strerror or str(error)
        raise OutputError(f"{path}: cannot be written ({reason}): check the folder") from error
