"""Fields of the messages of a DataFlash log as columns, scaled as their letters say."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8

from rotorfit.logs.dataflash.formats import TIMES, Field, MessageFormat
from rotorfit.logs.dataflash.messages import Messages

LATEST_TIME = 1e7
"""No autopilot is on for so long [s]: a later time is damage."""


def field_values(rows: UInt8[np.ndarray, "n length"], field: Field) -> np.ndarray:
    """Return one field of messages: numbers scaled, texts as bytes, arrays with 32 columns."""
    width = field.dtype.itemsize
    raw = np.ascontiguousarray(rows[:, field.offset : field.offset + width])
    values = raw.view(field.dtype.base).reshape(len(rows), *field.dtype.shape)
    # Divided, not multiplied by 0.01: that gives the number nearest to the decimal one.
    return values if field.divisor is None else values / field.divisor


def columns(messages: Messages, name: str, labels: Sequence[str]) -> dict[str, np.ndarray]:
    """Return fields of all messages of a name, in the order of the file; empty if there are none.

    Where a log defines the name more than once, the definitions that have all the labels are
    taken one after the other.
    """
    usable = [
        i
        for i in messages.named(name)
        if i in messages.rows and all(label in messages.formats[i].fields for label in labels)
    ]
    if not usable:
        return {}
    found: dict[str, np.ndarray] = {}
    for label in labels:
        parts = [field_values(messages.rows[i], messages.formats[i].fields[label]) for i in usable]
        found[label] = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return found


def has_fields(messages: Messages, name: str, labels: Sequence[str]) -> bool:
    """Return whether there are messages of a name that have all the labels."""
    return any(
        all(label in messages.formats[i].fields for label in labels) for i in messages.named(name)
    )


def first_label(messages: Messages, name: str, labels: Sequence[str]) -> str | None:
    """Return the first of some labels that the messages of a name have."""
    return next((label for label in labels if has_fields(messages, name, (label,))), None)


def format_named(messages: Messages, name: str) -> MessageFormat | None:
    """Return the first format of a name that has messages."""
    return next((messages.formats[i] for i in messages.named(name)), None)


def timed(
    messages: Messages, name: str, labels: Sequence[str]
) -> tuple[Float[np.ndarray, " n"], dict[str, np.ndarray]] | None:
    """Return times [s] and numeric fields of all messages of a name, in the order of time.

    Messages whose time cannot be are left out. None: no message, or none with time and labels.
    """
    label = first_label(messages, name, tuple(TIMES))
    if label is None:
        return None
    found = columns(messages, name, (label, *labels))
    if not found or any(values.dtype.kind == "S" for values in found.values()):
        return None
    time = vector(found, (label,), factor=TIMES[label])[:, 0]
    del found[label]
    kept = in_order(time)
    if kept.all():
        return time, found
    return time[kept], {name: values[kept] for name, values in found.items()}


def vector(
    found: Mapping[str, np.ndarray], labels: Sequence[str], *, factor: float = 1.0
) -> Float[np.ndarray, "n k"]:
    """Return fields side by side, times a factor; what is not finite as NaN."""
    with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers: signalling NaNs, 1e300
        values = np.empty((len(found[labels[0]]), len(labels)))
        for column, label in enumerate(labels):
            values[:, column] = found[label]
        if factor != 1.0:
            values *= factor
    values[~np.isfinite(values)] = np.nan
    return values


def time_of(messages: Messages, name: str) -> Float[np.ndarray, " n"]:
    """Return the times of all messages of a name in the order of the file [s]; none without."""
    label = first_label(messages, name, tuple(TIMES))
    found = {} if label is None else columns(messages, name, (label,))
    if label is None or not found or found[label].dtype.kind == "S":
        return np.zeros(0)
    return vector(found, (label,), factor=TIMES[label])[:, 0]


def in_order(time: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return which messages to keep, so that time never goes back, below 0 or beyond `LATEST_TIME`.

    A wrong time is either too early or too late: left out are those earlier than one before, or
    those later than one after, whichever are fewer.
    """
    possible = (time >= 0.0) & (time < LATEST_TIME)
    if not possible.all():
        kept = np.zeros(len(time), dtype=bool)
        kept[possible] = in_order(time[possible])
        return kept
    if len(time) == 0:
        return possible
    early = time < np.maximum.accumulate(time)
    late = time > np.minimum.accumulate(time[::-1])[::-1]
    return ~early if np.count_nonzero(early) <= np.count_nonzero(late) else ~late
