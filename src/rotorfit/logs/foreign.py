"""Files that are met where flight logs are kept, but not read: what they are, and what to give."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

ZIP, GZIP = b"PK\x03\x04", b"\x1f\x8b"
"""First bytes of archives."""

_TOML_TABLE: Final = re.compile(
    rb"(?:[ \t]*(?:#[^\r\n]*|[A-Za-z_]\w*[ \t]*=[^\r\n]*)?\r?\n)*"
    rb"[ \t]*\[\[?[A-Za-z_][\w.-]*\]\]?[ \t]*(?:#[^\r\n]*)?\r?\n"
)
_PARAMETERS: Final = re.compile(
    rb"(?:#[^\n]*\n)*(?:[A-Z][A-Z0-9_]{2,15}[,\t ]+-?[\d.eE+-]+\s*\n){3}"
)
_MESSAGES: Final = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+: \w+ \{")
_CELLS: Final = re.compile(r"[,;\t|]")
_EARLIEST, _LATEST = 1.1e15, 4.1e15
"""Times that a ground station stamps [us since 1970]: 2004 to 2099."""
_LINES_OF_TEXT: Final = 60
"""Lines at the beginning of a text of which one must hold numbers, if it is to be a table."""
_MOST_WORDS: Final = 6
"""Words of a cell; the clauses of a sentence have more."""
_LEAST_NUMBERS: Final = 0.25
"""Share of the words of a line without commas, tabs or the like that must be numbers."""


def _begins_with(*magic: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magic)


def _is_toml(head: bytes) -> bool:
    # A table after comments and plain keys; a list of JSON has no bare word in its brackets.
    return _TOML_TABLE.match(head) is not None


def _is_c3d(head: bytes) -> bool:
    # The block in which its parameters begin, nearly always the second, and its mark.
    return head[1:2] == b"\x50" and 0 < head[0] < 9


def _is_npz(head: bytes) -> bool:
    return head.startswith(ZIP) and head[30:200].find(b".npy") > 0


def _is_workbook(head: bytes) -> bool:
    is_office = b"[Content_Types].xml" in head[:4096] or b"xl/work" in head[:4096]
    return head.startswith(ZIP) and is_office


def _is_tlog(head: bytes) -> bool:
    """Return whether a MAVLink packet (1 or 2) follows a time in big-endian microseconds."""
    time = int.from_bytes(head[:8], "big")
    return len(head) > 8 and head[8] in (0xFE, 0xFD) and _EARLIEST < time < _LATEST


def _is_dji(head: bytes) -> bool:
    return head[16:21] == b"BUILD" or head[242:252] == b"DJI_LOG_V3"


def _is_pickle(head: bytes) -> bool:
    return head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05")


def _is_prose(head: bytes) -> bool:
    """Return whether a text has several lines, and no numbers in any of the first ones."""
    if b"\0" in head:
        return False
    lines = [line.strip() for line in head.decode("latin-1").splitlines()]
    lines = [line for line in lines if line and line[0] not in "#%"][:_LINES_OF_TEXT]
    return len(lines) > 1 and not any(_holds_numbers(line) for line in lines)


def _holds_numbers(line: str) -> bool:
    """Return whether a line may be a row of a table."""
    cells = [cell.strip().strip("\"'") for cell in _CELLS.split(line)]
    if len(cells) > 1:
        if any(len(cell.split()) > _MOST_WORDS for cell in cells):
            return False
        return any(map(_is_number, cells)) or not any(cells)
    words = line.split()
    return sum(map(_is_number, words)) >= max(1.0, _LEAST_NUMBERS * len(words))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


FOREIGN: Final[tuple[tuple[str, Callable[[bytes], bool]], ...]] = (
    ("a NumPy archive (.npz): save its arrays as the columns of a CSV or Parquet file", _is_npz),
    ("a spreadsheet: save the sheet as CSV", _is_workbook),
    ("a zip archive without files: pack the log again", _begins_with(b"PK\x05\x06")),
    ("a zip archive: unpack it first", _begins_with(ZIP)),
    ("a gzip archive: unpack it first", _begins_with(GZIP)),
    ("a zstd archive: unpack it first", _begins_with(b"\x28\xb5\x2f\xfd")),
    (
        "an xz, bzip2 or 7z archive: unpack it first",
        _begins_with(b"\xfd7zXZ", b"BZh", b"7z\xbc\xaf"),
    ),
    ("a PDF document", _begins_with(b"%PDF")),
    ("an image", _begins_with(b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"II*\x00", b"MM\x00*")),
    (
        "a MATLAB file: give the log from which it was made (.bin of ArduPilot), or save its "
        "signals with writetable as CSV",
        _begins_with(b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"),
    ),
    (
        "an HDF5 file: save its signals as the columns of a CSV or Parquet file",
        _begins_with(b"\x89HDF\r\n"),
    ),
    (
        "a NumPy array (.npy): save it as CSV, with the names of the columns",
        _begins_with(b"\x93NUMPY"),
    ),
    ("a Python pickle: save the table as CSV or Parquet", _is_pickle),
    (
        "a telemetry log of a ground station (.tlog), too slow for an identification: download "
        "the autopilot's own log (.bin of ArduPilot, .ulg of PX4)",
        _is_tlog,
    ),
    ("a DJI flight record (.DAT): convert it to CSV with DatCon", _is_dji),
    ("a C3D file: export the rigid bodies as text", _is_c3d),
    (
        "messages printed by mavlogdump: give the .bin or .log from which they were printed",
        lambda head: _MESSAGES.match(head) is not None,
    ),
    (
        "parameters of an autopilot: give a flight log",
        lambda head: (
            head.startswith((b"# Onboard parameters", b"# Vehicle-Id"))
            or _PARAMETERS.match(head) is not None
        ),
    ),
    (
        "settings of Betaflight or INAV (diff, dump): give the Blackbox log",
        _begins_with(b"# version", b"# dump", b"# diff", b"# Betaflight", b"# INAV"),
    ),
    ("a mission of a ground station: give a flight log", _begins_with(b"QGC WPL")),
    (
        "a pointer of Git LFS, not the file itself: fetch it with git lfs pull",
        _begins_with(b"version https://git-lfs"),
    ),
    ("a TOML file: name the log itself, and an airframe file with --airframe", _is_toml),
    ("JSON: save a recording as the columns of a CSV or Parquet file", _begins_with(b"{", b"[")),
    ("a web page or other XML", _begins_with(b"<")),
    ("text without rows of numbers: give a flight log, or a table of numbers", _is_prose),
)
"""What a file is and, behind a colon, what to do, how to recognise it; the first counts."""
