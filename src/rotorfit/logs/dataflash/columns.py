"""Fields of the messages of a DataFlash log as columns, scaled as their letters say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.dataflash.messages import TIMES, Field, MessageFormat, Messages
from rotorfit.logs.flight_log import in_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int, UInt8

LATEST_TIME = 1e7
"""No autopilot is on for so long [s]: a later time is damage."""


def field_values(rows: UInt8[np.ndarray, "n length"], field: Field) -> np.ndarray:
    """Read one field of messages: numbers scaled, texts as bytes, arrays with 32 columns."""
    width = field.dtype.itemsize
    raw = np.ascontiguousarray(rows[:, field.offset : field.offset + width])
    values = raw.view(field.dtype.base).reshape(len(rows), *field.dtype.shape)
    # Divided, not multiplied by 0.01: that gives the number nearest to the decimal one.
    return values if field.divisor is None else values / field.divisor


def columns(messages: Messages, name: str, labels: Sequence[str]) -> dict[str, np.ndarray]:
    """Read fields of all messages of a name, in the order of the file; empty if there are none.

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
    """Find the first of some labels that the messages of a name have."""
    return next((label for label in labels if has_fields(messages, name, (label,))), None)


def format_named(messages: Messages, name: str) -> MessageFormat | None:
    """Find the first format of a name that has messages."""
    return next((messages.formats[i] for i in messages.named(name)), None)


def timed(
    messages: Messages, name: str, labels: Sequence[str]
) -> tuple[Float[np.ndarray, " n"], dict[str, np.ndarray]] | None:
    """Return times [s] and numeric fields of all messages of a name, in the order of time."""
    label = first_label(messages, name, tuple(TIMES))
    if label is None:
        return None
    found = columns(messages, name, (label, *labels))
    if not found or any(values.dtype.kind == "S" for values in found.values()):
        return None
    time = vector(found, (label,), factor=TIMES[label])[:, 0]
    del found[label]
    kept = possible_in_order(time)
    if kept.all():
        return time, found
    # Messages that were written in another order are sorted; those whose time cannot be are left
    # out.
    if is_shuffled(time):
        kept = by_time(time)
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


def possible_in_order(time: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Select the messages to keep, so that time never goes back, below 0 or past `LATEST_TIME`."""
    possible = (time >= 0.0) & (time < LATEST_TIME)
    if possible.all():
        return in_order(time)
    kept = np.zeros(len(time), dtype=bool)
    kept[possible] = in_order(time[possible])
    return kept


LEAST_RESTART: Final = 1.0
"""Least time by which the clock goes back where a log begins anew [s]."""
LEAST_LEFT: Final = 0.01
"""Share of messages out of order, up to which they are taken for damaged ones."""


def is_shuffled(time: Float[np.ndarray, " n"]) -> bool:
    """Return whether messages were written out of order, by less than a new log goes back."""
    good = time[(time >= 0.0) & (time < LATEST_TIME)]
    late = np.maximum.accumulate(good) - good
    count = np.count_nonzero(late > 0.0)
    # A damaged time is rare, and a log appended behind another goes back by all its length.
    return bool(count > LEAST_LEFT * len(good) and late.max() < LEAST_RESTART)


def by_time(time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Return the places of the messages with a possible time, sorted by it."""
    possible = np.flatnonzero((time >= 0.0) & (time < LATEST_TIME))
    return possible[np.argsort(time[possible], kind="stable")]


def rate_of(time: Float[np.ndarray, " n"]) -> float:
    """Return samples per second by the median step [Hz]; 0 for fewer than two, or without steps."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    return 1.0 / step if step > 0 else 0.0


EXPECTED: Final = {
    "GyrX": "rad/s",
    "AccX": "m/s/s",
    "RPM": "rpm",
    "Volt": "V",
    "VN": "m/s",
    "PX": "m",
}
"""Unit of one field of each kind, as the firmware writes it."""
CHECKED: Final = ("IMU", "GYR", "ACC", "ESC", "BAT", "XKF1", "VISP")


def declared_units(messages: Messages) -> dict[tuple[str, str], str]:
    """Read the unit of each field, by message and label, where the log declares them."""
    letters = columns(messages, "UNIT", ("Id", "Label"))
    uses = columns(messages, "FMTU", ("FmtType", "UnitIds"))
    if not letters or not uses:
        return {}
    if letters["Label"].dtype.kind != "S" or uses["UnitIds"].dtype.kind != "S":
        return {}
    if letters["Id"].dtype.kind not in "iu" or uses["FmtType"].dtype.kind not in "iu":
        return {}
    names = {
        chr(int(i) & 0xFF): label.decode("latin-1")
        for i, label in zip(letters["Id"].tolist(), letters["Label"].tolist(), strict=True)
    }
    by_type = {f.type: f for f in messages.formats}
    found: dict[tuple[str, str], str] = {}
    for number, ids in zip(uses["FmtType"].tolist(), uses["UnitIds"].tolist(), strict=True):
        form = by_type.get(number)
        if form is None:
            continue
        for label, letter in zip(form.labels, ids.decode("latin-1"), strict=False):
            found[form.name, label] = names.get(letter, "")
    return found


def unit_sentences(messages: Messages) -> list[str]:
    """Warn for each field whose declared unit is not the one that it is read in."""
    units = declared_units(messages)
    return [
        f"{name}.{label} is declared in {units[name, label]!a}, and read as {unit}: check the scale"
        for name in CHECKED
        for label, unit in EXPECTED.items()
        if units.get((name, label), unit) not in (unit, "")
    ]
