"""Tables as files: Parquet where pyarrow is installed, else CSV."""

import csv
import io
from importlib import import_module
from importlib.util import find_spec

from rotorfit.fleet.records import Columns


def has_parquet() -> bool:
    """Return whether tables can be written as Parquet."""
    return find_spec("pyarrow") is not None


def csv_bytes(columns: Columns) -> bytes:
    """Return a table as CSV (UTF-8); numbers with all their digits, empty cells for nothing."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow("" if cell is None else cell for cell in row)
    return text.getvalue().encode()


def parquet_bytes(columns: Columns) -> bytes:
    """Return a table as Parquet; a column of nothing but None is one of numbers."""
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    arrays = {
        name: arrow.array(cells, type=arrow.float64() if _empty(cells) else None)
        for name, cells in columns.items()
    }
    sink = io.BytesIO()
    parquet.write_table(arrow.table(arrays), sink, compression="zstd")
    return sink.getvalue()


def _empty(cells: list[object]) -> bool:
    return all(cell is None for cell in cells)


def table_bytes(name: str, columns: Columns) -> tuple[str, bytes]:
    """Return the file of a table, by the format that can be written: its name, and what is in it.

    Parameters
    ----------
    name
        Of the table, without an ending.
    columns
        The table.
    """
    if has_parquet():
        return f"{name}.parquet", parquet_bytes(columns)
    return f"{name}.csv", csv_bytes(columns)
