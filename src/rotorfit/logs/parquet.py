"""Columns of a Parquet file (with the extra ``parquet``)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import LogError

if TYPE_CHECKING:
    import polars

MAGIC: Final = b"PAR1"
"""The first four bytes of every Parquet file, and the last four."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParquetTable:
    """A Parquet file of which only the columns asked for are decoded.

    Attributes
    ----------
    data
        The whole file.
    names
        Names of its columns.
    """

    data: bytes
    names: tuple[str, ...]

    def numbers(self, names: Sequence[str]) -> Float[np.ndarray, "n k"]:
        """Return columns as numbers, NaN where the file has none.

        Durations and dates become seconds.
        """
        frame = _read(self.data, list(names))
        columns = [_as_float(frame[name]) for name in names]
        return np.stack(columns, axis=1)

    def place(self, row: int) -> str:
        """Return the words for one row, counted from 0, as a person counts it."""
        return f"row {row + 1}"


def open_parquet(data: bytes) -> ParquetTable:
    """Return the table of a Parquet file given as bytes.

    Raises
    ------
    LogError
        If polars is not installed or cannot read the file.
    """
    if not data.endswith(MAGIC):
        raise LogError("Parquet file without its end: it was cut off, copy or write it again")
    return ParquetTable(data=data, names=tuple(_read(data, None, rows=0).columns))


def _read(data: bytes, columns: list[str] | None, *, rows: int | None = None) -> polars.DataFrame:
    try:
        import polars
        from polars.exceptions import PanicException
    except ImportError as error:
        raise LogError(
            "reading Parquet needs polars: pip install 'rotorfit[parquet]', or save as CSV"
        ) from error
    # PanicException, polars' answer to some damaged files, is no Exception.
    try:
        return polars.read_parquet(
            io.BytesIO(data), columns=columns, n_rows=rows, use_pyarrow=False
        )
    except (Exception, PanicException) as error:
        reason = str(error).partition("\n")[0]
        raise LogError(f"damaged Parquet file ({reason}): write it again") from error


def _as_float(column: polars.Series) -> Float[np.ndarray, " n"]:
    import polars

    if column.dtype == polars.Date:
        column = column.cast(polars.Datetime("ns"))
    if isinstance(column.dtype, polars.Datetime | polars.Duration):
        return 1e-9 * _plain(column.dt.cast_time_unit("ns").to_physical())
    if not column.dtype.is_numeric() and column.dtype != polars.Null:
        raise LogError(
            f"column {column.name!r} holds {column.dtype}, expected numbers: convert it first"
        )
    return _plain(column)


def _plain(column: polars.Series) -> Float[np.ndarray, " n"]:
    import polars

    return np.array(column.cast(polars.Float64).fill_null(float("nan")).to_numpy(), np.float64)
