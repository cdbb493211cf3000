"""Messages of a topic as rows of the fields that are used, grown block by block."""

from collections.abc import Container
from typing import Any

import numpy as np


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
    """Return the rows that were kept with some fields of others below; grown where they are.

    Of arrays of rows (the eight ESCs of a topic) and long ones of floats (twelve controls) only
    what stands before the last one that ever says anything is kept: most vehicles have four.

    Parameters
    ----------
    kept
        What this returned before; not to be used afterwards. None: nothing yet.
    rows
        Whole messages.
    names
        Of the fields that are used; None: all, and nothing is cut.
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
    """Return whether an array is of floats and longer than a quaternion, as that of controls."""
    return dtype.base.kind == "f" and dtype.shape[0] > 4


def _grown(kept: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return rows below others: pieces that are joined in the end would take twice the memory."""
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
