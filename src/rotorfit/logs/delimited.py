"""Columns of numbers in delimited text: any common delimiter, comments, gaps, quoted cells."""

from __future__ import annotations

import contextlib
import csv
import io
import mmap
import re
import warnings
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import Content, let_go, report_progress
from rotorfit.logs.units import is_unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float, Int

_DELIMITERS: Final = (",", ";", "\t", "|")
_COMMENTS: Final = ("#", "%")
_ABSENT: Final = frozenset({"", "nan", "na", "n/a", "null", "none"})
_NEWLINE: Final = b"\n"
_SETTINGS_BYTES: Final = 65536
"""Settings above a table are looked for in so many bytes; Blackbox Explorer writes some 10 kB."""
_MOST_LINES_ABOVE: Final = 100
"""Lines above a table among which its row of names is looked for."""
_FEWEST_COLUMNS: Final = 3
"""A line of fewer cells, above a table, is a setting with its value."""
_DECIMAL_COMMA: Final = re.compile(rb"\b0,\d|\d,(?:\d{1,2}(?!\d)|\d{4,})")
"""A comma that cannot part thousands."""
_POINT: Final = re.compile(rb"\d\.\d")
_MANY: Final = 20
"""Whole lines above a shorter last one from which that is one cut off, and no mistake."""
PIECE_BYTES: Final = 1 << 20
_LINES_PER_WORD: Final = 100
"""Looked at together: numbers need a tenth of the memory of what finds them."""


@frozen_dataclass
class DelimitedText:
    """A text file that begins with a row of names.

    - `text`: the whole file, its lines ended by line feeds; in memory, or mapped.
    - `start`: where the rows of numbers begin in it.
    - `delimiter`: between cells; None: any run of spaces and tabs.
    - `first_line`: number of the line at `start`, from 1.
    - `has_decimal_commas`: whether decimals are written with a comma.
    - `is_cut`: whether a last line was left out that a recorder did not end.
    """

    text: Content
    start: int
    names: tuple[str, ...]
    delimiter: str | None
    first_line: int
    has_decimal_commas: bool = False
    is_cut: bool = False

    def numbers(self, names: Sequence[str]) -> Float[np.ndarray, "n k"]:
        """Read columns as numbers, NaN if a cell is empty; dates with a time become seconds."""
        # Looked up one by one, a header of 100 000 names takes minutes.
        places = {name: place for place, name in reversed([*enumerate(self.names)])}
        columns = [places[name] for name in names]
        fast = fast_numbers(self, columns)
        return careful_numbers(self, columns) if fast is None else fast

    def place(self, row: int) -> str:
        """Return the words for one row, counted from 0: its line in the file."""
        line, _ = next(islice(_table_rows(self), row, None))
        return f"line {line}"


def open_delimited(data: Content) -> DelimitedText:
    """Return the table in a text file given as bytes, or mapped."""
    text = data if isinstance(data, mmap.mmap) and _is_plain(data) else with_line_feeds(data[:])
    start = _after_settings(text)
    line_number, comment = text[:start].count(_NEWLINE) + 1, ""
    while start < len(text):
        end = text.find(_NEWLINE, start)
        end = len(text) if end < 0 else end
        line = _decode_line(text[start:end])
        if line.strip() and not line.lstrip().startswith(_COMMENTS):
            table = _without_cut_line(_table_from(text, start, end, line_number, comment))
            return replace(table, has_decimal_commas=_find_decimal_commas(table))
        comment = line.strip().lstrip("#%") if line.strip() else comment
        start, line_number = end + 1, line_number + 1
    raise LogError("no row of column names: the file holds only comments and blank lines")


def _after_settings(text: Content) -> int:
    """Find where the table begins behind what is written above it: settings, a title, a date.

    Each line of the settings of Blackbox Explorer has a name and a value, up to the row of names of
    the table. Whatever else is there, the row of names is followed by numbers, one for each.
    """
    head = bytes(text[:_SETTINGS_BYTES])
    found = re.search(rb'\n"?loopIteration"?[,;\t]', head)
    if found is not None:
        return found.start() + 1
    starts = [0, *(match.end() for match in re.finditer(rb"\n", head))]
    for start, after in pairwise(starts[:_MOST_LINES_ABOVE]):
        line, below = (_decode_line(head[at:].partition(_NEWLINE)[0]) for at in (start, after))
        if not line.lstrip().startswith(_COMMENTS) and _are_names_above(line, below):
            return start
    return 0


def _are_names_above(line: str, below: str) -> bool:
    """Return whether one line holds names, and the line below it a number or a unit for most."""
    names, delimiter = _cells_of_header(line)
    cells, same = _cells_of_header(below)
    if len(names) != len(cells) or same != delimiter or len(names) < _FEWEST_COLUMNS:
        return False
    stated = sum(
        is_unit(cell) or (bool(cell) and _is_number(cell.replace(",", "."))) for cell in cells
    )
    return stated > len(cells) / 2 and not any(name and _is_number(name) for name in names)


def _is_plain(text: mmap.mmap) -> bool:
    """Return whether a mapped text needs no change before it is looked at line by line."""
    if text[:3] == b"\xef\xbb\xbf" or text[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return False
    for start in range(0, len(text), PIECE_BYTES):
        if text.find(b"\r", start, start + PIECE_BYTES) >= 0:
            return False
        let_go(text)
    return True


def _table_from(
    text: Content, start: int, end: int, line_number: int, comment: str
) -> DelimitedText:
    """Return the table whose first line that is no comment lies between start and end."""
    first = _decode_line(text[start:end])
    names, delimiter = _cells_of_header(first)
    if not all(_is_number(name) for name in names):
        table = DelimitedText(
            text=text,
            start=min(end + 1, len(text)),
            names=names,
            delimiter=delimiter,
            first_line=line_number + 1,
        )
        return _take_units(table)
    # numpy.savetxt and others write the names as the last comment before the numbers.
    commented, comment_delimiter = _cells_of_header(comment)
    if len(commented) != len(names) or comment_delimiter != delimiter or not any(commented):
        raise LogError(
            f"no row of column names: line {line_number} holds numbers only; "
            "write the names above, time,gyro_x,... in the order of the columns"
        )
    return DelimitedText(
        text=text, start=start, names=commented, delimiter=delimiter, first_line=line_number
    )


def _without_cut_line(table: DelimitedText) -> DelimitedText:
    """Leave out a last line that ends early, as where a recorder lost its power."""
    last = table.text.rfind(_NEWLINE) + 1
    if last == len(table.text) or last <= table.start or table.delimiter is None:
        return table
    cells = _split_line(_decode_line(table.text[last:]), table.delimiter)
    if len(cells) >= len(table.names) or table.text[table.start : last].count(_NEWLINE) < _MANY:
        return table
    return replace(table, text=table.text[:last], is_cut=True)


def _take_units(table: DelimitedText) -> DelimitedText:
    """Put units that have a row of their own, below the names, behind the names they belong to."""
    end = table.text.find(_NEWLINE, table.start)
    units, delimiter = _cells_of_header(_decode_line(table.text[table.start : max(end, 0)]))
    stated = [unit for unit in units if unit and unit != "-"]
    if len(units) != len(table.names) or delimiter != table.delimiter or len(stated) < 2:
        return table
    # A row of ones may be a row of numbers.
    if not all(is_unit(unit) for unit in stated) or all(_is_number(unit) for unit in units):
        return table
    names = (
        f"{name} [{unit.strip('[]()')}]" if is_unit(unit) and not _is_number(unit) else name
        for name, unit in zip(table.names, units, strict=True)
    )
    return replace(table, names=tuple(names), start=end + 1, first_line=table.first_line + 1)


def _find_decimal_commas(table: DelimitedText) -> bool:
    """Return whether decimals have a comma: a number shows it, and no number has a point."""
    if table.delimiter == "," or table.text.find(b",", table.start) < 0:
        return False
    piece, _ = next(_whole_lines(table), (b"", 0))
    return _DECIMAL_COMMA.search(piece) is not None and not _POINT.search(piece)


def with_line_feeds(data: bytes) -> bytes:
    """Return the text in an ASCII superset, without byte-order mark, with line feeds only."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            data = data.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise LogError(f"damaged UTF-16 text ({error.reason}): save it as UTF-8") from error
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in data:
        data = data.replace(b"\r\n", _NEWLINE).replace(b"\r", _NEWLINE)
    # One line feed at the end is left: stripping it would copy every file.
    return data.rstrip(_NEWLINE) if data.endswith(b"\n\n") else data


def _decode_line(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _cells_of_header(line: str) -> tuple[tuple[str, ...], str | None]:
    """Split a line by the delimiter that makes most cells."""
    delimiter = max(_DELIMITERS, key=lambda candidate: len(_split_line(line, candidate)))
    cells = _split_line(line, delimiter)
    if len(cells) < 2 and '"' not in line and len(line.split()) > 1:
        return tuple(line.split()), None
    return tuple(cell.strip().strip("\"'") for cell in cells), delimiter


def _split_line(line: str, delimiter: str) -> list[str]:
    try:
        return [
            cell
            for cells in csv.reader([line], delimiter=delimiter, skipinitialspace=True)
            for cell in cells
        ]
    except csv.Error as error:
        raise LogError(f"no row of column names ({error})") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return not cell.strip()
    return True


def fast_numbers(table: DelimitedText, columns: Sequence[int]) -> Float[np.ndarray, "n k"] | None:
    """Read the columns piece by piece; None if the text is not plain enough."""
    numbers = np.empty((0, len(columns)))
    for piece, end in _whole_lines(table):
        found = _fast_piece(replace(table, text=piece, start=0), columns)
        if found is None:
            return None
        known = len(numbers)
        numbers.resize((known + len(found), len(columns)), refcheck=False)
        numbers[known:] = found
        report_progress(end, len(table.text))
    return numbers if len(numbers) else None


def _whole_lines(table: DelimitedText) -> Iterator[tuple[bytes, int]]:
    """Yield whole lines of the rows of numbers, and where in the text they end."""
    start, size = table.start, len(table.text)
    while start < size:
        end = table.text.find(_NEWLINE, min(start + PIECE_BYTES, size)) + 1 or size
        piece = table.text[start:end]
        let_go(table.text)
        if end == size and piece.endswith(b"\n\n"):
            piece = piece.rstrip(_NEWLINE)
        if table.has_decimal_commas:
            piece = piece.replace(b",", b".")
        if piece:
            yield piece, end
        start = end


def _fast_piece(table: DelimitedText, columns: Sequence[int]) -> Float[np.ndarray, "n k"] | None:
    """Return the columns by numpy's parser in C; None if the text is not plain enough."""
    if table.delimiter is None or table.text.find(b'"', table.start) >= 0:
        return None
    gaps = _gaps_in_even_rows(table)
    if gaps is None:
        return None
    rows = io.BytesIO(_with_nan_in_gaps(table, gaps) if len(gaps) else table.text)
    rows.seek(0 if len(gaps) else table.start)
    # numpy is a fifth faster when it need not pick columns.
    every = len(columns) == len(table.names)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            numbers = np.loadtxt(
                rows,
                delimiter=table.delimiter,
                usecols=None if every else list(columns),
                ndmin=2,
                encoding="latin-1",
            )
    except (ValueError, UserWarning):
        return None
    if not every:
        return numbers
    # A number sign in every row ends numpy's rows early.
    return numbers[:, columns] if numbers.shape[1] == len(table.names) else None


def _gaps_in_even_rows(table: DelimitedText) -> Int[np.ndarray, " g"] | None:
    """Return the ends of the empty cells, counted from the rows; None if the rows are uneven."""
    text = np.frombuffer(table.text, np.uint8)[table.start :]
    is_end = text == ord(_NEWLINE)
    separators = np.flatnonzero(is_end | (text == ord(table.delimiter or " ")))
    if table.text[-1:] != _NEWLINE:
        separators = np.append(separators, len(text))
    columns = len(table.names)
    ends = separators[columns - 1 :: columns]
    # numpy.loadtxt looks only at the columns it is asked for, and knows no empty cells.
    if len(separators) % columns or np.count_nonzero(is_end) != len(ends[ends < len(text)]):
        return None
    if not is_end[ends[ends < len(text)]].all():
        return None
    return separators[np.diff(separators, prepend=-1) == 1]


def _with_nan_in_gaps(table: DelimitedText, gaps: Int[np.ndarray, " g"]) -> bytes:
    """Return the rows of numbers with "nan" in their empty cells."""
    rows = table.text[table.start :]
    pieces = (rows[a:b] for a, b in pairwise([0, *gaps.tolist(), len(rows)]))
    return b"nan".join(pieces)


def careful_numbers(table: DelimitedText, columns: Sequence[int]) -> Float[np.ndarray, "n k"]:
    """Read the columns cell by cell, with the line in every complaint."""
    values: list[list[float]] = []
    for line, cells in _table_rows(table):
        if len(cells) != len(table.names):
            raise LogError(
                f"line {line} has {len(cells)} cells, the header has {len(table.names)}: "
                "complete or remove the line"
            )
        if table.has_decimal_commas:
            cells = [cell.replace(",", ".") for cell in cells]
        values.append([_parse_number(cells[i], line, table.names[i]) for i in columns])
    return np.array(values, dtype=np.float64).reshape(len(values), len(columns))


def _parse_number(cell: str, line: int, column: str) -> float:
    try:
        return float(cell)
    except ValueError:
        text = cell.strip()
    if text.lower() in _ABSENT:
        return float("nan")
    if ":" in text and (seconds := _seconds_of_date(text)) is not None:
        return seconds
    comma = ": write decimals with a point" if _is_number(text.replace(",", ".", 1)) else ""
    raise LogError(f"line {line}, column {column!r}: {text[:40]!r} is not a number{comma}")


def _seconds_of_date(text: str) -> float | None:
    """Return the seconds since 1970 of a date with a time, or since midnight of a time (ISO 8601).

    Without a zone it is UTC. None if it is neither.
    """
    for written in (text, f"1970-01-01T{text}"):
        with contextlib.suppress(ValueError):
            moment = datetime.fromisoformat(written)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return None


def _table_rows(table: DelimitedText) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of every line that is neither blank nor a comment."""
    lines = _decode_line(table.text[table.start :]).split("\n")
    if table.delimiter is None:
        split = ((number, line.split()) for number, line in enumerate(lines, table.first_line))
    else:
        split = _quoted_rows(lines, table.delimiter, table.first_line)
    for number, cells in split:
        if number % _LINES_PER_WORD == 0:
            report_progress(number - table.first_line, len(lines))
        blank = not any(cell.strip() for cell in cells) and len(cells) < 2
        if not blank and not cells[0].lstrip().startswith(_COMMENTS):
            yield number, cells


def _quoted_rows(
    lines: list[str], delimiter: str, first_line: int
) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        for cells in reader:
            yield first_line + reader.line_num - 1, cells
    except csv.Error as error:
        raise LogError(f"line {first_line + reader.line_num - 1}: {error}") from error
