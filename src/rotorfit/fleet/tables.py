"""Tables as files: Parquet where pyarrow is installed, else CSV; some rows at a time."""

import csv
import io
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

from rotorfit.fleet.records import Columns

ROWS: Final = 500
"""Of a table in memory as Python's own numbers, which take ten times the room."""
TEXTS: Final = frozenset(
    (
        *("file", "sha256", "vehicle", "configuration", "started", "warnings", "refused"),
        *("first", "last", "airframe"),
    )
)
COUNTS: Final = frozenset(("log_number", "flights", "identified"))


def has_parquet() -> bool:
    """Return whether tables can be written as Parquet."""
    return find_spec("pyarrow") is not None


def csv_bytes(parts: Iterable[Columns]) -> bytes:
    """Return a table as CSV (UTF-8); numbers with all their digits, empty cells for nothing."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for number, columns in enumerate(parts):
        if number == 0:
            writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow("" if cell is None else cell for cell in row)
    return text.getvalue().encode()


def parquet_bytes(parts: Iterable[Columns]) -> bytes:
    """Return a table as Parquet, a group of rows for each part."""
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    sink, writer = io.BytesIO(), None
    for columns in parts:
        schema = arrow.schema([(name, _type(arrow, name)) for name in columns])
        writer = writer or parquet.ParquetWriter(sink, schema, compression="zstd")
        writer.write_table(arrow.table(columns, schema=schema))
    if writer is not None:
        writer.close()
    return sink.getvalue()


def _type(arrow: Any, name: str) -> Any:
    """Return the type of a column, which its name tells: a part may hold nothing but None."""
    if name in TEXTS or name.endswith("_verdict"):
        return arrow.string()
    if name in COUNTS:
        return arrow.int64()
    return arrow.bool_() if name.endswith("_apart") else arrow.float64()


def stacked(tables: Sequence[Columns]) -> Columns:
    """Return tables with different columns as one, None where a row has nothing."""
    names = dict.fromkeys(name for columns in tables for name in columns)
    rows = [len(next(iter(columns.values()))) for columns in tables]
    return {
        name: [
            cell
            for columns, count in zip(tables, rows, strict=True)
            for cell in columns.get(name, [None] * count)
        ]
        for name in names
    }


def table_file(name: str, parts: Iterable[Columns]) -> tuple[str, bytes]:
    """Return the file of a table, by the format that can be written: its name, and what is in it.

    Parameters
    ----------
    name
        Of the table, without an ending.
    parts
        The table, some rows after the other; each with the same columns.
    """
    if has_parquet():
        return f"{name}.parquet", parquet_bytes(parts)
    return f"{name}.csv", csv_bytes(parts)
