"""Any log to a FlightLog: the format is recognised by the content, not by the name."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.files import Progress, read_for, read_head
from rotorfit.logs.foreign import FOREIGN
from rotorfit.logs.formats import (
    BY_NAME,
    FORMATS,
    Format,
    LogEntry,
    ReadOptions,
    load,
    recognise,
)

if TYPE_CHECKING:
    from pathlib import Path

    from rotorfit.logs.flight_log import FlightLog

_HEAD: Final = 65536
_LARGEST_TEXT: Final = 4_000_000
"""Bytes of a file that is looked into whole."""
TRUTH_FILE: Final = "the truth of a simulated flight"
AIRFRAME_FILE: Final = "an airframe file"
_TABLES: Final = (
    ("configuration", "an experiment file"),
    ("airframe", AIRFRAME_FILE),
    ("motors", AIRFRAME_FILE),
)
"""Keys of rotorfit's own TOML files, and what these are."""
HIGHEST_VOLTS: Final = 100.0
"""Voltage that the battery of no multirotor has [V]: 14 cells have 60."""
LEAST_MILLIVOLTS: Final = 2500.0
"""Reading from which it is in mV: of one cell at least, as hundredths of a V of 25 V at most."""
_FIELDS: Final = (
    ({"parameters", "covariance"}, "a result of rotorfit identify"),
    ({"shared", "configurations"}, TRUTH_FILE),
    ({"candidates"}, "a plan of rotorfit plan"),
    ({"rate_errors"}, "what rotorfit fly found"),
    ({"schema", "values", "units"}, "a file of drawn vehicles (rotorfit export)"),
)
"""Keys of rotorfit's own JSON files, and what these are."""


def read_log(
    path: Path, *, options: ReadOptions | None = None, progress: Progress | None = None
) -> FlightLog:
    """Return the flight in a file of any format that rotorfit reads.

    Parameters
    ----------
    path
        The log.
    options
        What to take from it and how; None: `ReadOptions` as it stands.
    progress
        Told how much of a long log was gone through, from 0 to 1.

    Raises
    ------
    LogError
        If the format is not read by rotorfit, or the file is damaged.
    """
    with read_for(path, progress):
        return _read_by_format(path, options or ReadOptions())


def _read_by_format(path: Path, chosen: ReadOptions) -> FlightLog:
    """Read a file by the row of its format, refusing options that the format does not take."""
    form = _format_named(chosen.format) if chosen.format is not None else _recognised_format(path)
    if form.map_format and chosen.columns:
        form = BY_NAME[form.map_format]
    if form.map_refusal and (chosen.columns or chosen.axes != "FLU"):
        what = "a columns map" if chosen.columns else "axes"
        raise LogError(f"{path}: {form.map_refusal}: leave out {what}")
    if form.single and chosen.log_number not in (None, 1):
        raise LogError(f"{path}: {form.single} is one log, there is no log {chosen.log_number}")
    log = load(form.read)(path, **{name: getattr(chosen, name) for name in form.takes})
    return _in_volts(_without_zero_volts(log))


def _without_zero_volts(log: FlightLog) -> FlightLog:
    """Mark samples of the voltage that were not measured; drop a channel of such alone."""
    battery = log.channels.get("battery")
    if battery is None or not (battery.values <= 0.0).any():
        return log
    channels = dict(log.channels)
    # Before the first measurement, and where none is connected, autopilots log 0 V.
    volts = np.where(battery.values > 0.0, battery.values, np.nan)
    if np.isfinite(volts).any():
        channels["battery"] = replace(battery, values=volts)
        return replace(log, channels=channels)
    del channels["battery"]
    note = f"{battery.source} is never above 0 V: no battery was measured"
    return replace(log, channels=channels, notes=(*log.notes, note))


def _in_volts(log: FlightLog) -> FlightLog:
    """Scale a battery's voltage that no vehicle has: recorders write hundredths or thousandths."""
    battery = log.channels.get("battery")
    if battery is None:
        return log
    usual = float(np.nanmedian(battery.values))
    if not HIGHEST_VOLTS <= usual < 1000.0 * HIGHEST_VOLTS:
        return log
    scale, unit = (1e-3, "mV") if usual >= LEAST_MILLIVOLTS else (1e-2, "hundredths of a V")
    resolution = None if battery.resolution is None else scale * battery.resolution
    scaled = replace(battery, values=scale * battery.values, resolution=resolution)
    note = f"{battery.source} reads {usual:.4g}: it is taken as {unit}, {scale * usual:.3g} V"
    return replace(log, channels={**log.channels, "battery": scaled}, notes=(*log.notes, note))


def _format_named(name: str) -> Format:
    if name not in BY_NAME:
        raise LogError(f"unknown format {name!r}: one of {', '.join(BY_NAME)}")
    return BY_NAME[name]


def _recognised_format(path: Path) -> Format:
    """Find the format of a file or folder, or raise with what it is instead."""
    found = _format_of_folder(path) if path.is_dir() else None
    if found is not None:
        return found
    head = read_head(path, _HEAD)
    found = recognise(head)
    if found is not None:
        return found
    own = own_kind(path)
    if own is not None:
        raise LogError(f"{path}: this is {own}; give a flight log in its place")
    raise LogError(f"{path}: {_what_it_is(head)}")


def _format_of_folder(path: Path) -> Format | None:
    folders = (form for form in FORMATS if form.recognises_folder)
    return next((form for form in folders if load(form.recognises_folder)(path)), None)


def _what_it_is(head: bytes) -> str:
    for name, recognises in FOREIGN:
        if recognises(head):
            what, _, remedy = name.partition(": ")
            return (
                f"looks like {what}, which rotorfit does not read: {remedy or 'give a flight log'}"
            )
    titles = ", ".join(form.title for form in FORMATS)
    return f"unknown format (begins with {head[:8].hex(' ')}); rotorfit reads {titles}"


def format_of(path: Path) -> Format | None:
    """Find a log's format by its first bytes; None if it is not one. Never raises.

    Nearly any text may be a table: see `Format.certain`.
    """
    try:
        return _format_of_folder(path) if path.is_dir() else recognise(read_head(path, _HEAD))
    except (LogError, OSError):
        return None


def logs_in_file(path: Path) -> tuple[LogEntry, ...]:
    """List the logs of a file whose format may hold several; empty for others."""
    form = format_of(path) if path.is_file() else None
    return load(form.list_logs)(path) if form is not None and form.list_logs else ()


def kind_of(path: Path) -> str | None:
    """Name the kind of a file: a flight log, or one of rotorfit's own; None if neither.

    Never raises: it is asked when something else is wrong already.
    """
    own = own_kind(path)
    if own is not None:
        return own
    try:
        head = read_head(path, _HEAD)
    except LogError:
        return None
    form = recognise(head)
    known = form is not None and (form.certain or head.isascii())
    return "a flight log" if known else None


def own_kind(path: Path) -> str | None:
    """Name which of rotorfit's own files a file is; None if it is not one. Never raises."""
    try:
        if path.stat().st_size > _LARGEST_TEXT:
            return None
        text = path.read_text(encoding="utf-8-sig")
        is_json = text.lstrip()[:1] == "{"
        data = json.loads(text) if is_json else tomllib.loads(text)
    except (OSError, ValueError, RecursionError):
        return None
    keys = set(cast("dict[str, Any]", data)) if isinstance(data, dict) else set[str]()
    if is_json:
        return next((words for fields, words in _FIELDS if fields <= keys), None)
    return next((words for key, words in _TABLES if key in keys), None)
