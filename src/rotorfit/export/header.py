"""The head of every file: where its numbers are from, how well they are known, in which units."""

import datetime
from collections.abc import Sequence

from rotorfit import version
from rotorfit.export.result_numbers import Number
from rotorfit.export.vehicle import VehicleModel
from rotorfit.logs.files import file_name
from rotorfit.results.result import FlightRecord, IdentificationResult

ORIGINS = {
    "identified": "identified",
    "weak": "WEAK",
    "given": "given",
    "removed": "REMOVED",
    "assumed": "ASSUMED",
    "from-ratio": "FROM A RATIO",
    "law": "from the law",
}
SHA = 12
"""Digits of a log's fingerprint that are shown."""


def header_lines(
    model: VehicleModel,
    result: IdentificationResult,
    *,
    target: str,
    date: datetime.date,
) -> list[str]:
    """Return the head of a file, line by line, without the signs of a comment.

    Parameters
    ----------
    model
        What the file holds.
    result
        From which it was made.
    target
        Name of the target.
    date
        Of the export.
    """
    lines = [
        f"{target}, written by rotorfit {version.__version__} on {date.isoformat()}",
        f"{result.name}, configuration {model.configuration}; identified by "
        f"{result.versions.get('rotorfit', 'an unknown version')}, method {result.method}, from",
        *(_flight(record) for record in result.flights),
        "Numbers (95 % interval) in SI units, body axes FLU (x forward, y left, z up):",
        *(_number(number) for number in model.numbers),
        *(f"Doubt: {doubt}" for doubt in result.warnings),
        *(f"Note: {note}" for note in model.notes),
    ]
    return [_one_line(line) for line in lines]


def _one_line(line: str) -> str:
    """Return a line that is one in every format: no breaks, nothing that cannot be printed."""
    indent = "  " if line.startswith("  ") else ""
    words = " ".join(line.split())
    return indent + "".join(letter if letter.isprintable() else "?" for letter in words)


def _flight(record: FlightRecord) -> str:
    """Return a flight without its folders, which are nobody else's business."""
    name = file_name(record.file)
    return (
        f"  {name} (sha256 {record.sha256[:SHA]}), configuration {record.configuration}, "
        f"{record.seconds_used:.1f} s used"
    )


def _number(number: Number) -> str:
    interval = ""
    if number.interval is not None:
        interval = f" ({number.interval[0]:.6g} to {number.interval[1]:.6g})"
    remark = "" if number.remark is None else f": {number.remark}"
    return (
        f"  {number.name} = {number.value:.6g}{interval} {number.unit} "
        f"[{ORIGINS[number.origin]}{remark}]"
    )


def noted(head: Sequence[str], *remarks: str) -> list[str]:
    """Return the head of a file with what is to be said of its target."""
    return [*head, *(f"Note: {remark}" for remark in remarks)]


def identifier(name: str) -> str:
    """Return a name that every target takes for a model: letters, digits and underscores."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_")
    return plain if plain and not plain[0].isdigit() else f"vehicle_{plain}".rstrip("_")


def hash_comment(lines: Sequence[str]) -> str:
    """Return lines as comments that begin with ``#``."""
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def xml_comment(lines: Sequence[str]) -> str:
    """Return lines as one XML comment, in which there may be no two hyphens in a row."""
    safe = [line.replace("--", "- -").replace("--", "- -") for line in lines]
    safe = [f"{line} " if line.endswith("-") else line for line in safe]
    return "<!--\n" + "".join(f"  {line}\n" for line in safe) + "-->\n"
