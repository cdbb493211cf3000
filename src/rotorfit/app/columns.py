"""The columns of a table on the page: proposed, checked by their values, changed by the user."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

from rotorfit.app.form import rows, table
from rotorfit.errors import LogError
from rotorfit.fit.experiment.declared_vehicle import table_options_of
from rotorfit.fit.experiment.experiment import TableEntry
from rotorfit.fit.experiment.toml_files import table_of_options
from rotorfit.logs import ReadOptions
from rotorfit.logs.columns import NAMES, TIME, unit_of
from rotorfit.logs.proposal import Proposal, explains_itself, propose_columns, units_to_state
from rotorfit.logs.read import format_of
from rotorfit.logs.table import open_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

FEWEST: Final = 10
"""Columns of a flight: a clock, gyro, accelerometer, and three motors."""
NEEDED: Final = (
    *("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"),
    *("rotor_1", "rotor_2", "rotor_3", "rotor_4"),
)
OPTIONAL: Final = ("battery", "reference", "position", "velocity", "quaternion", "angle")
"""Channels that a flight may lack."""
WORDS: Final = {
    "time": "clock",
    "gyro": "turn rate",
    "accel": "accelerometer",
    "rotor": "rotor speed",
    "command": "motor command",
    "battery": "battery",
    "reference": "turn rate asked for",
    "position": "position",
    "velocity": "velocity, body axes",
    "quaternion": "attitude",
    "angle": "attitude",
}
CHANNELS: Final = {name: kind for kind, names in NAMES.items() for name in names}


def is_unknown_table(path: Path) -> bool:
    """Decide whether a file is a table whose columns do not carry rotorfit's own names."""
    form = format_of(path)
    return form is not None and form.name == "table" and not explains_itself(path)


def known_map(form: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """Find the columns map that a form has for a file of the page, with the motors' poles."""
    entries = [
        table(flight)
        for entry in rows(form.get("configuration"))
        for kind in ("flights", "validation")
        for flight in rows(table(entry).get(kind))
    ]
    own = next((e for e in entries if e.get("file") == name and e.get("columns")), None)
    found = own or table(form.get("table"))
    if not found.get("columns"):
        return None
    poles = table(form.get("motors")).get("poles")
    return {"axes": found.get("axes", "FLU"), "columns": found["columns"], "poles": poles}


def described_columns(
    path: Path, replies: Mapping[str, Any] | None, known: Mapping[str, Any] | None
) -> tuple[dict[str, Any], ReadOptions | None]:
    """Describe the columns of a table for the page, and how it is read where that is clear.

    `replies`: what the user said: ``named``, ``units``, ``axes``, ``poles``; None before. `known`:
    a map from `known_map`; it counts until the user says something.
    """
    names = list(open_table(path).names)
    if replies is None and known is not None:
        options = _options_of(known)
        if {spec.name for spec in (options.columns or {}).values()} <= set(names):
            return _by_map(path, names, options)
    given = dict(replies or {})
    try:
        proposal = propose_columns(
            path,
            named=table(given.get("named")),
            units=table(given.get("units")),
            axes=given.get("axes"),
        )
    except LogError as error:
        if len(names) < FEWEST:
            raise
        return _describe_table(
            names, given, rows=_unknown_rows(given), refused=on_page(path, error)
        ), None
    poles = given.get("poles")
    asks_poles = any(spec.unit == "erpm" for spec in proposal.columns.values())
    open_question = proposal.questions or (asks_poles and not isinstance(poles, int))
    options = ReadOptions(columns=proposal.columns, axes=proposal.axes, motor_poles=poles)
    shown = _describe_table(
        names,
        given,
        rows=_column_rows(options, proposal.preview),
        proposal=proposal,
        asks_poles=asks_poles,
        map=None if open_question else table_of_options(options),
    )
    return shown, None if open_question else options


def on_page(path: Path, error: LogError) -> str:
    """Explain a fault of a table to somebody who names columns below, not by options."""
    words = str(error).removeprefix(f"{path}: ")
    return re.sub(r",? (with|as) --column( \w+=NAME)?", " below", words)


def _options_of(known: Mapping[str, Any]) -> ReadOptions:
    entry = TableEntry.model_validate({k: known[k] for k in ("axes", "columns")})
    return table_options_of(entry, known.get("poles"))


def _by_map(
    path: Path, names: list[str], options: ReadOptions
) -> tuple[dict[str, Any], ReadOptions]:
    """Describe the columns that a file of the user names, checked by a proposal's eyes."""
    specs = options.columns or {}
    named = {name: spec.name for name, spec in specs.items()}
    known = units_to_state()
    units = {
        channel_of(name): unit_of(name, spec)
        for name, spec in specs.items()
        if channel_of(name) in known
    }
    given = {"named": named, "units": units, "axes": options.axes, "poles": options.motor_poles}
    doubts: tuple[str, ...]
    preview: Mapping[str, Sequence[float]] = {}
    try:
        seen = propose_columns(path, named=named, units=units, axes=options.axes)
        doubts, preview = seen.doubts, seen.preview
    except LogError as error:
        doubts = (on_page(path, error),)
    shown = _describe_table(
        names,
        given,
        rows=_column_rows(options, preview),
        asks_poles=any(spec.unit == "erpm" for spec in specs.values()),
        map=table_of_options(options),
    )
    return {**shown, "reasons": ["as the experiment file names them"], "doubts": [*doubts]}, options


def _describe_table(
    names: Sequence[str],
    given: Mapping[str, Any],
    *,
    rows: list[dict[str, Any]],
    proposal: Proposal | None = None,
    refused: str | None = None,
    asks_poles: bool = False,
    map: dict[str, Any] | None = None,
) -> dict[str, Any]:
    found = proposal
    return {
        "names": list(dict.fromkeys(names)),
        "rows": rows,
        "axes": found.axes if found else given.get("axes"),
        "poles": given.get("poles"),
        "asks_poles": asks_poles,
        "reasons": list(found.reasons) if found else [],
        "doubts": list(found.doubts) if found else [],
        "questions": [asdict(question) for question in found.questions] if found else [],
        "unused": list(found.unused) if found else [],
        "refused": refused,
        "replies": {
            "named": dict(table(given.get("named"))),
            "units": dict(table(given.get("units"))),
            "axes": given.get("axes"),
            "poles": given.get("poles"),
        },
        "map": map,
    }


def channel_of(canonical: str) -> str:
    """Find the channel of a canonical name, as units are stated by it."""
    return CHANNELS.get(canonical) or canonical.partition("_")[0]


def _column_rows(
    options: ReadOptions, preview: Mapping[str, Sequence[float]]
) -> list[dict[str, Any]]:
    return [
        _column_row(
            name,
            spec.name,
            unit_of(name, spec),
            scale=spec.scale,
            range=None if spec.range is None else list(spec.range),
            preview=[
                _shown_value(value, 12 if name == TIME else 4) for value in preview.get(name, ())
            ],
        )
        for name, spec in (options.columns or {}).items()
    ]


def _unknown_rows(given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Lay out what must be named where nothing can be proposed."""
    named = table(given.get("named"))
    wanted = [*NEEDED, *(name for name in named if name not in NEEDED and named[name])]
    units = table(given.get("units"))
    return [_column_row(name, named.get(name), units.get(channel_of(name))) for name in wanted]


def _column_row(name: str, column: str | None, unit: str | None, **more: Any) -> dict[str, Any]:
    channel = channel_of(name)
    component = name.rpartition("_")[2] if "_" in name else ""
    component = name if channel == "angle" else component
    choices = units_to_state().get(channel, ())
    return {
        "is": name,
        "title": " ".join(part for part in (WORDS[channel], component) if part),
        "channel": channel,
        "column": column or None,
        "unit": unit,
        "units": list(choices),
        "optional": channel in OPTIONAL,
        "scale": more.get("scale", 1.0),
        "range": more.get("range"),
        "preview": more.get("preview", []),
    }


def _shown_value(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "none"
