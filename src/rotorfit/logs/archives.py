"""The log in a zip or gzip archive, as issue trackers and mail take files."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.logs.foreign import ZIP

if TYPE_CHECKING:
    from pathlib import Path
    from typing import IO

_TAR: Final = slice(257, 262)
"""Where a tar archive says that it is one."""
LARGEST: Final = 1 << 30
"""Bytes of a log that is unpacked into the memory."""
_HEAD: Final = 65536
_OTHER_ZIPS: Final = ("[Content_Types].xml", "mimetype")
"""Members of zip archives that are documents of an office program."""
_ENCRYPTED: Final = 1
_MOST_FILES: Final = 100
"""Files of an archive that are looked into; and how many a refusal names."""
_NAMED: Final = 3

_DAMAGE: Final = (
    *(zipfile.BadZipFile, gzip.BadGzipFile),
    *(EOFError, zlib.error, NotImplementedError),
)
"""What the standard library raises about an archive that it cannot unpack."""

_latest: dict[tuple[str, int, int], bytes | None] = {}
"""What `unpack_log` found last, by path, time and size of the file."""


def unpack_log(path: Path) -> bytes | None:
    """Return the log in an archive; None if the file is a document that only looks like one.

    Raises
    ------
    LogError
        If the archive is damaged, encrypted or too large, or no single file in it is a log.
    """
    state = path.stat()
    key = (str(path), state.st_mtime_ns, state.st_size)
    if key not in _latest:
        try:
            found = _unpack_file(path)
        except _DAMAGE as error:
            raise LogError(f"{path}: a damaged archive ({error}): copy it again") from error
        _latest.clear()  # one at a time: it may be large
        _latest[key] = found
    return _latest[key]


def _unpack_file(path: Path) -> bytes | None:
    with path.open("rb") as file:
        if file.read(len(ZIP)) == ZIP:
            return _unpack_zip(path, file)
        file.seek(0)
        with gzip.GzipFile(fileobj=file) as unpacked:
            content = _read_at_most(path, unpacked)
    if content[_TAR] == b"ustar":
        raise LogError(
            f"{path}: an archive of several files (tar): unpack it, and give one of them"
        )
    return content


def _unpack_zip(path: Path, file: IO[bytes]) -> bytes | None:
    with zipfile.ZipFile(file) as archive:
        names = [one.filename for one in archive.infolist() if not one.is_dir()]
        if any(name.endswith((*_OTHER_ZIPS, ".npy")) for name in names):
            return None
        seen = [name for name in names if not _is_hidden(name)]
        logs = seen if len(seen) == 1 else _find_logs(archive, seen)
        if len(logs) != 1:
            shown = ", ".join(seen[:_NAMED]) + (", ..." if len(seen) > _NAMED else "")
            raise LogError(
                f"{path}: an archive of {len(seen)} files ({shown}), and not of one log: unpack "
                "it, and give the log"
            )
        if archive.getinfo(logs[0]).flag_bits & _ENCRYPTED:
            raise LogError(f"{path}: an encrypted archive: unpack it first")
        with archive.open(logs[0]) as unpacked:
            return _read_at_most(path, unpacked)


def _is_hidden(name: str) -> bool:
    """Return whether an operating system put a file beside what was packed."""
    return name.startswith("__MACOSX/") or name.rsplit("/", maxsplit=1)[-1].startswith(".")


def _find_logs(archive: zipfile.ZipFile, names: list[str]) -> list[str]:
    """Find the files of an archive that are logs for sure, by their first bytes."""
    from rotorfit.logs.formats import recognise  # its readers open files, and these archives

    found = list[str]()
    for name in names[:_MOST_FILES]:
        if not archive.getinfo(name).flag_bits & _ENCRYPTED:
            with archive.open(name) as member:
                form = recognise(member.read(_HEAD))
            found += [name] * (form is not None and form.certain)
    return found


def _read_at_most(path: Path, unpacked: IO[bytes] | gzip.GzipFile) -> bytes:
    content = unpacked.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise LogError(f"{path}: unpacks to more than {LARGEST >> 30} GB: unpack it, give the log")
    return content
