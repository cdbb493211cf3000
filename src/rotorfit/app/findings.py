"""The inspection of a dropped file, and what it fills the form with."""

from __future__ import annotations

import tomllib
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, cast

from rotorfit.app.columns import described_columns, is_unknown_table, known_map, on_page
from rotorfit.app.files import Dropped, json_with_shown_names, with_shown_names
from rotorfit.app.form import files_of, form_of_file
from rotorfit.errors import LogError, RotorfitError
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.files import write_whole
from rotorfit.logs.read import logs_in_file, own_kind
from rotorfit.report.log_page import log_report_html
from rotorfit.report.log_report import plain, sections
from rotorfit.tools.inspection.inspect_log import LogReport, inspect_log
from rotorfit.tools.inspection.seen_airframe import seen_airframe

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

KINDS: Final = {
    "an experiment file": "experiment",
    "an airframe file": "airframe",
    "a result of rotorfit identify": "result",
}
SHOWN: Final = {"roll": "roll inertia", "pitch": "pitch inertia", "yaw": "yaw"}


def inspected(
    one: Dropped,
    *,
    log_number: int | None = None,
    replies: Mapping[str, Any] | None = None,
    form: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Describe a dropped file for the page.

    Of several logs in it one by number, from 1; a table by what the user said of its columns, else
    by what the form on the page has of them.
    """
    kind, remarks = "other", list[str]()
    description: dict[str, Any] = {"logs": [], "findings": None, "form": None, "table": None}
    try:
        known_kind = own_kind(one.path)
        is_log = known_kind is None and one.path.suffix != ".toml"
        kind = "log" if is_log else KINDS.get(known_kind or "", "other")
        if kind == "log":
            columns, options = _describe_columns(one, replies, form or {})
            if columns is None:
                description |= _of_log(one, ReadOptions(log_number=log_number))
            else:
                description |= _of_table(one, columns, options)
        elif kind == "result":
            remarks = ["a result of identify: a form may take the motors' law from it"]
        else:
            description["form"] = form_of_file(one.path)
            names = files_of(description["form"])
            remarks = [f"it names {', '.join(names)}: drop these here too"] if names else []
    except RotorfitError as error:
        kind, remarks = "other", [str(error)]
    size = one.path.stat().st_size
    description |= {"name": one.name, "bytes": size, "kind": kind, "words": remarks}
    return json_with_shown_names(one.path.parent.parent, description)


def _describe_columns(
    one: Dropped, replies: Mapping[str, Any] | None, form: Mapping[str, Any]
) -> tuple[dict[str, Any] | None, ReadOptions | None]:
    """Describe the columns of an unknown table, and how it is read; None for every other log."""
    if replies is None and not is_unknown_table(one.path):
        return None, None
    try:
        columns, options = described_columns(one.path, replies, known_map(form, one.name))
        trouble = LogError(columns["refused"]) if columns["refused"] else None
    except LogError as error:
        columns, options, trouble = None, None, error
    # Rotorfit's own names without those of motors: what is there can be shown all the same.
    if trouble is not None and replies is None and _is_readable(one.path):
        return None, None
    if columns is None:
        raise trouble or LogError(f"{one.path}: no flight table")
    return columns, options


def _is_readable(path: Path) -> bool:
    """Decide whether a table can be read by the names that it has."""
    try:
        return bool(read_log(path).channels)
    except LogError:
        return False


def _of_table(
    one: Dropped, columns: Mapping[str, Any], options: ReadOptions | None
) -> dict[str, Any]:
    """Inspect a table by its columns, where these are clear and can be read."""
    if options is None:
        return {"table": dict(columns)}
    try:
        return {**_of_log(one, options), "table": dict(columns)}
    except LogError as error:
        return {"table": {**columns, "refused": on_page(one.path, error), "map": None}}


def _of_log(one: Dropped, options: ReadOptions) -> dict[str, Any]:
    """List the logs in a file, inspect one of them, and write its page."""
    entries = logs_in_file(one.path)
    logs = [{"number": e.number, "words": e.description} for e in entries if len(entries) > 1]
    if logs and options.log_number is None:
        return {"logs": logs}
    log = read_log(one.path, options=options)
    report = inspect_log(log)
    html = with_shown_names(one.path.parent.parent, log_report_html(report))
    write_whole(one.page, html, force=True)
    seen = asdict(seen_airframe(log, report.prospects and report.prospects.motors))
    found = plain(report) | {
        "sections": [{"title": title, "words": words} for title, words in sections(report)],
        "usable": report.usable,
        "verdict": _summarise_verdict(report),
        "rotors": seen["rotors"],
        "guess": {
            **{key: seen[key] for key in ("speed", "layout", "order", "borne_out")},
            "reversed": seen["turned"],
            **_logged_airframe(log.metadata),
        },
    }
    return {"logs": logs, "findings": found}


def _logged_airframe(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Extract the geometry in a log's metadata, without what is still to be measured."""
    text = metadata.get("airframe", "")
    try:
        tables = tomllib.loads(text)
    except ValueError:
        tables = {}
    found = dict(cast("Mapping[str, Any]", tables.get("airframe", tables)))
    imu = found.pop("imu", None)
    rotors = found.get("rotors", [])
    if any(isinstance(part, str) for rotor in rotors for part in rotor["position"]):
        found.pop("rotors")
    known = {key: value for key, value in found.items() if key != "arm"}
    measured = bool(found.get("rotors"))
    kind = metadata.get("airframe is", "default") if known else None
    return {
        "airframe": known or None,
        "airframe_is": kind if measured or not known else "default",
        "imu": None if imu is None else imu["position"],
    }


def _summarise_verdict(report: LogReport) -> dict[str, str]:
    """Summarise in one sentence what a flight can show, with a level."""
    found = report.prospects
    if not report.usable or found is None:
        # The reader's reason comes first in what is to be known.
        why = next(iter(report.trouble), "no usable flight in it")
        return {"level": "poor", "words": f"Nothing can be identified from this log: {why}"}
    names: dict[str, list[str]] = {"well": [], "roughly": [], "not": []}
    names[found.thrust.prospect].append("thrust")
    for axis in found.excitation:
        names[axis.prospect].append(SHOWN[axis.axis])
    titles = {"well": "shows well:", "roughly": "roughly:", "not": "not at all:"}
    parts = [f"{title} {', '.join(names[key])}" for key, title in titles.items() if names[key]]
    incomplete = names["roughly"] or names["not"]
    level = "good" if not incomplete else "fair" if names["well"] or names["roughly"] else "poor"
    return {"level": level, "words": f"This flight {'; '.join(parts)}"}
