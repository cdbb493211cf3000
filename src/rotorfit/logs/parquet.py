"""Columns of a Parquet file (with the extra ``parquet``).

pyarrow reads them: of the readers at hand it alone answers every damaged file with an exception.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import LogError
from rotorfit.logs.progress import report_progress

MAGIC: Final = b"PAR1"
"""The first four bytes of every Parquet file, and the last four."""

ROWS_AT_ONCE: Final = 65_536
_LARGEST_EXPANSION: Final = 100
_ALWAYS_ALLOWED: Final = 64_000_000
"""A table in memory may be so many times as large as its file, or have so many bytes."""
_LEAST_ELEMENT: Final = 3
"""Bytes in the footer of an element of its long lists: a small one may not declare a million."""

# Types by their names in Arrow.
_NUMBER: Final = re.compile(r"u?int\d+|halffloat|float|double|decimal\d+\(.*\)|null")
_CLOCK: Final = re.compile(r"(?:timestamp|duration|time|date)(32)?(?:64)?\[(s|ms|us|ns|day)\b.*\]")
_SECONDS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "day": 86400.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class ParquetTable:
    """A Parquet file of which only the columns asked for are decoded."""

    data: bytes
    names: tuple[str, ...]

    def numbers(self, names: Sequence[str]) -> Float[np.ndarray, "n k"]:
        """Read columns as numbers, NaN where the file has none.

        Durations and dates become seconds.
        """
        try:
            file = _opened(self.data)
            rows = file.metadata.num_rows
            _check_size(rows, 8 * rows * len(names), len(self.data))
            _check_size(rows, _declared_bytes(file.metadata), len(self.data))
            values, done = np.empty((rows, len(names))), 0
            pieces = file.iter_batches(ROWS_AT_ONCE, columns=list(names), use_threads=False)
            for piece in pieces:
                columns = [_as_float(name, piece.column(name)) for name in names]
                values[done : done + piece.num_rows] = np.stack(columns, axis=1)
                done += piece.num_rows
                report_progress(done, rows)
            return values[:done]
        except LogError:
            raise
        except Exception as error:
            raise _damaged(error) from error

    def place(self, row: int) -> str:
        """Return the words for one row, counted from 0, as a person counts it."""
        return f"row {row + 1}"


def open_parquet(data: bytes) -> ParquetTable:
    """Return the table of a Parquet file given as bytes."""
    if not data.endswith(MAGIC):
        raise LogError("Parquet file without its end: it was cut off, copy or write it again")
    try:
        import_module("pyarrow.parquet")
    except ImportError as error:
        raise LogError(
            "reading Parquet needs pyarrow: pip install 'rotorfit[parquet]', or save as CSV"
        ) from error
    try:
        return ParquetTable(data=data, names=tuple(_opened(data).schema_arrow.names))
    except Exception as error:
        raise _damaged(error) from error


def _opened(data: bytes) -> Any:  # pyarrow has no types
    buffer = import_module("pyarrow").BufferReader(data)
    footer = min(int.from_bytes(data[-8:-4], "little"), len(data))
    return import_module("pyarrow.parquet").ParquetFile(
        buffer, thrift_container_size_limit=max(footer // _LEAST_ELEMENT, 1)
    )


def _damaged(error: Exception) -> LogError:
    """Return the refusal of a file that pyarrow cannot read, with its reason on one line."""
    text = str(error).partition("\n")[0][:200]
    reason = "".join(letter if letter.isprintable() else "\ufffd" for letter in text)
    return LogError(f"damaged Parquet file ({reason or type(error).__name__}): write it again")


def _declared_bytes(metadata: Any) -> int:
    """Return how large the file says that its pages are without compression."""
    return sum(metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups))


def _check_size(rows: int, needed: int, file_size: int) -> None:
    """Raise if a small file declares a table that would fill the memory."""
    if rows < 0 or needed > max(_ALWAYS_ALLOWED, _LARGEST_EXPANSION * file_size):
        raise LogError(
            f"Parquet file of {file_size} bytes declares {rows} rows, {needed / 1e6:.0f} MB: "
            "damaged or no flight log; write it again, or save as CSV"
        )


def _as_float(name: str, column: Any) -> Float[np.ndarray, " n"]:
    """Return an Arrow column of numbers as it is, and one of times in seconds."""
    kind = str(column.type)
    seconds = 1.0
    if clock := _CLOCK.fullmatch(kind):
        seconds = _SECONDS[clock[2]]
        column = column.cast("int32" if clock[1] else "int64")
    elif not _NUMBER.fullmatch(kind):
        raise LogError(f"column {name!r} holds {kind}, expected numbers: convert it first")
    numbers = column.cast("float64", safe=False)
    return seconds * np.array(numbers.to_numpy(zero_copy_only=False), np.float64)
