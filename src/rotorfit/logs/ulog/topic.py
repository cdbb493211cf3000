"""The messages of one topic of a ULog: rows grown block by block, then fields as numbers."""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rotorfit.logs.flight_log import pieces

LARGEST_VALUE: Final = 1e100
"""Beyond it a number of double precision is damage, and its square no number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """The messages of one instance of a topic, in order of time.

    Arrays of rows, and long ones of floats, are without the last elements that say nothing;
    `lengths` are as declared.
    """

    name: str
    instance: int
    rows: np.ndarray
    lengths: Mapping[str, int]

    @property
    def label(self) -> str:
        """As PX4's people write it."""
        return f"{self.name}[{self.instance}]" if self.instance else self.name

    def has(self, *fields: str) -> bool:
        """Tell whether the topic has all these fields, as numbers or arrays of numbers."""
        names = self.rows.dtype.names or ()
        return all(name in names for name in fields)

    def column(self, name: str, rows: slice = slice(None)) -> Float[np.ndarray, "*shape"]:
        """Read a field as floats: one value a row, or one array; what is no number is NaN."""
        return _floats(self.rows[name][rows])

    def has_vector(self, name: str, columns: int) -> bool:
        """Tell whether a field is an array of at least so many numbers."""
        if not self.has(name) or self.rows.dtype[name].names:
            return False
        return self.rows[name].ndim == 2 and self.rows[name].shape[1] >= columns

    def has_number(self, name: str) -> bool:
        """Tell whether a field is one number."""
        return self.has(name) and not self.rows.dtype[name].names and self.rows[name].ndim == 1

    def vector(self, name: str, columns: int) -> Float[np.ndarray, "n k"] | None:
        """Return a field that is an array of at least so many numbers; None if it is not."""
        return _floats(self.rows[name][:, :columns]) if self.has_vector(name, columns) else None

    def number(self, name: str) -> Float[np.ndarray, " n"] | None:
        """Read a field that is one number; None if it is not."""
        return self.column(name) if self.has_number(name) else None

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """When each message was published, since boot [s]."""
        stamps = self.column("timestamp")
        stamps *= 1e-6
        return stamps

    @property
    def sample_time(self) -> Float[np.ndarray, " n"]:
        """When what it tells was measured [s]; where it does not say, when it was published."""
        sampled = self.number("timestamp_sample")
        if sampled is None or not sampled.all():
            return self.time
        sampled *= 1e-6
        return sampled

    @property
    def rate(self) -> float:
        """Median rate [Hz]."""
        steps = np.diff(self.time)
        return 1.0 / max(float(np.median(steps)), 1e-6) if len(steps) else 0.0


def _floats(recorded: np.ndarray) -> Float[np.ndarray, "*shape"]:
    """Copy as floats; what is no number is NaN."""
    with np.errstate(invalid="ignore"):  # some NaN of single precision signal
        values = recorded.astype(np.float64)
    if recorded.dtype.kind == "f":
        for rows in pieces(len(values)):
            some = values[rows]
            some[~(np.abs(some) < LARGEST_VALUE)] = np.nan
    return values


def part_of(dtype: np.dtype[Any], names: Container[str]) -> np.dtype[Any]:
    """Return the type of some fields of a row, and of the rows in it; of all, if it has none."""
    parts: list[Any] = []
    for name in dtype.names or ():
        if name in names:
            inner = dtype[name]
            base = part_of(inner.base, names) if inner.base.names else inner.base
            parts.append((name, base, inner.shape))
    return np.dtype(parts) if parts else dtype


def appended(kept: np.ndarray | None, rows: np.ndarray, names: Container[str] | None) -> np.ndarray:
    """Append some fields of more rows to those that were kept, in place.

    Of arrays of rows (the eight ESCs of a topic) and long ones of floats (twelve controls) only
    what stands before the last one that ever says anything is kept: most vehicles have four.
    """
    if names is None:
        return _grown(np.empty(0, rows.dtype) if kept is None else kept, rows)
    part = np.empty(len(rows), part_of(rows.dtype, names))
    _copy(rows, part)
    wanted = np.dtype([_cut(part, name, kept) for name in part.dtype.names or ()])
    if kept is None or kept.dtype != wanted:
        longer = np.zeros(0 if kept is None else len(kept), wanted)
        if kept is not None:
            _copy(kept, longer)
        kept = longer
    return _grown(kept, part)


def _cut(part: np.ndarray, name: str, kept: np.ndarray | None) -> tuple[Any, ...]:
    """Return name, type and shape of a field, an array cut behind the last part with content."""
    dtype = part.dtype[name]
    if len(dtype.shape) != 1 or not (dtype.base.names or _is_long(dtype)):
        return name, dtype.base, dtype.shape
    if dtype.base.names:
        content = np.ascontiguousarray(part[name]).view(np.uint8)
        used = content.reshape(len(part), dtype.shape[0], -1).any(axis=(0, 2))
    else:
        used = ~np.isnan(part[name]).all(axis=0)
    before = 1 if kept is None else int(kept.dtype[name].shape[0])
    return name, dtype.base, (max(int(np.flatnonzero(used)[-1]) + 1 if used.any() else 1, before),)


def _is_long(dtype: np.dtype[Any]) -> bool:
    """Tell whether an array is of floats and longer than a quaternion, as that of controls."""
    return dtype.base.kind == "f" and dtype.shape[0] > 4


def _grown(kept: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Append rows in place: pieces that are joined in the end would take twice the memory."""
    known = len(kept)
    kept.resize(known + len(rows), refcheck=False)
    _copy(rows, kept[known:])
    return kept


def _copy(rows: np.ndarray, target: np.ndarray) -> None:
    """Copy the fields that the target has, and as much of them."""
    if not target.dtype.names:
        target[...] = rows
    for name in target.dtype.names or ():
        there, here = target[name], rows[name]
        if there.ndim > 1:
            count = min(there.shape[1], here.shape[1])
            if there.dtype.kind == "f":
                there[:, count:] = np.nan  # what was cut off before
            there, here = there[:, :count], here[:, :count]
        _copy(here, there)
