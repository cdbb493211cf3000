"""What the doctor says of a dropped file, and what it fills the form with."""

import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final, cast

from rotorfit.app.files import Dropped, in_its_name, in_their_names
from rotorfit.app.form import files_of, form_of_file
from rotorfit.errors import RotorfitError
from rotorfit.inspection.inspect_log import LogReport, inspect_log
from rotorfit.inspection.prospects import Prospects
from rotorfit.inspection.seen_airframe import seen_airframe
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.files import write_whole
from rotorfit.logs.read import logs_in_file, own_kind
from rotorfit.report.log_page import log_report_html
from rotorfit.report.log_report import plain, sections

KINDS: Final = {
    "an experiment file": "experiment",
    "an airframe file": "airframe",
    "a result of rotorfit identify": "result",
}
SHOWN: Final = {"roll": "roll inertia", "pitch": "pitch inertia", "yaw": "yaw"}


def looked_at(one: Dropped, *, log_number: int | None = None) -> dict[str, Any]:
    """Return what the page is told of a dropped file; never a refusal, but for a log's number.

    Parameters
    ----------
    one
        The file, its bytes at its path.
    log_number
        Which of several logs in it, from 1.
    """
    kind, words = "other", list[str]()
    folder = one.path.parent.parent
    told: dict[str, Any] = {"logs": [], "findings": None, "form": None}
    try:
        own = own_kind(one.path)
        kind = (
            "log" if own is None and one.path.suffix != ".toml" else KINDS.get(own or "", "other")
        )
        if kind == "log":
            told |= _of_log(one, log_number)
        elif kind == "result":
            words = ["a result of identify: a form may take the motors' law from it"]
        else:
            told["form"] = form_of_file(one.path)
            names = files_of(told["form"])
            words = [f"it names {', '.join(names)}: drop these here too"] if names else []
    except RotorfitError as error:
        kind, words = "other", [str(error)]
    size = one.path.stat().st_size
    told |= {"name": one.name, "bytes": size, "kind": kind, "words": words}
    return in_their_names(folder, told)


def _of_log(one: Dropped, number: int | None) -> dict[str, Any]:
    """Return which logs are in a file and what one of them shows; its page is written beside it."""
    entries = logs_in_file(one.path)
    logs = [{"number": e.number, "words": e.description} for e in entries if len(entries) > 1]
    if logs and number is None:
        return {"logs": logs}
    log = read_log(one.path, options=ReadOptions(log_number=number))
    report = inspect_log(log)
    html = in_its_name(one.path.parent.parent, log_report_html(report))
    write_whole(one.page, html, force=True)
    seen = asdict(seen_airframe(log, report))
    found = plain(report) | {
        "sections": [{"title": title, "words": words} for title, words in sections(report)],
        "usable": report.usable,
        "verdict": _verdict(report),
        "rotors": seen["rotors"],
        "guess": {
            **{key: seen[key] for key in ("speed", "layout", "order", "borne_out")},
            "reversed": seen["turned"],
            **_logged_airframe(log.metadata),
        },
    }
    return {"logs": logs, "findings": found}


def _logged_airframe(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return the geometry that a log tells, without what is still to be measured."""
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


def _verdict(report: LogReport) -> dict[str, str]:
    """Return in one sentence what a flight can show, and whether that is much."""
    found = report.prospects
    if not report.usable or found is None:
        # The reader's reason comes first in what is to be known.
        why = next(iter(report.trouble), "no usable flight in it")
        return {"level": "poor", "words": f"Nothing can be identified from this log: {why}"}
    by_prospect = _named(found)
    well, roughly, nothing = (by_prospect[key] for key in ("well", "roughly", "not"))
    words = [
        f"{text} {', '.join(names)}"
        for text, names in (
            ("shows well:", well),
            ("roughly:", roughly),
            ("not at all:", nothing),
        )
        if names
    ]
    level = "good" if not roughly and not nothing else "fair" if well or roughly else "poor"
    return {"level": level, "words": f"This flight {'; '.join(words)}"}


def _named(found: Prospects) -> dict[str, list[str]]:
    """Return what a flight shows well, roughly and not at all."""
    named: dict[str, list[str]] = {"well": [], "roughly": [], "not": []}
    named[found.thrust.prospect].append("thrust")
    for axis in found.excitation:
        named[axis.prospect].append(SHOWN[axis.axis])
    return named
