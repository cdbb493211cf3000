"""rotorfit compare: results side by side, with the difference to the first."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

from rotorfit.cli.terminal import show
from rotorfit.identification.compare import ComparedNumber, Comparison, Entry, compare_results
from rotorfit.identification.result import IdentificationResult
from rotorfit.report.text import with_interval

COLUMN = 26


def run(paths: Sequence[Path], *, as_json: bool) -> None:
    """Load, compare, print."""
    results = [IdentificationResult.load(path) for path in paths]
    comparison = compare_results(results, _labels(paths))
    if as_json:
        show(json.dumps(dataclasses.asdict(comparison), indent=1, allow_nan=False))
    else:
        show(comparison_text(comparison))


def comparison_text(comparison: Comparison) -> str:
    """Return a comparison as text for a terminal: a line a number, a column a result."""
    head = f"{'':<20}{comparison.labels[0]:>{COLUMN}}" + "".join(
        f"  {label:>{COLUMN}} {'difference':>18}" for label in comparison.labels[1:]
    )
    lines = [head, *(_line(number) for number in comparison.numbers)]
    apart = [
        _name(number)
        for number in comparison.numbers
        if any(entry.overlap is False for entry in number.entries)
    ]
    if apart:
        lines += ["", f"Intervals apart: {', '.join(apart)}"]
    return "\n".join(line.rstrip() for line in lines)


def _line(number: ComparedNumber) -> str:
    first, *others = number.entries
    cells = [f"{_name(number):<20}{with_interval(first.value, first.interval):>{COLUMN}}"]
    for entry in others:
        shown = with_interval(entry.value, entry.interval)
        cells.append(f"{shown:>{COLUMN}} {_difference(entry, first):>18}")
    unit = "" if number.unit == "1" else number.unit
    return "  ".join([*cells, unit])


def _difference(entry: Entry, first: Entry) -> str:
    """Return the difference in percent, and whether the intervals are apart.

    No percentage of what may as well be zero.
    """
    apart = " apart" if entry.overlap is False else ""
    about_zero = first.interval is not None and first.interval[0] <= 0 <= first.interval[1]
    if entry.difference is None or about_zero:
        return apart.strip()
    return f"{100.0 * entry.difference:+.2f} %{apart}"


def _name(number: ComparedNumber) -> str:
    return number.name if number.configuration is None else f"{number.name} {number.configuration}"


def _labels(paths: Sequence[Path]) -> list[str]:
    """Return the shortest names that tell the files apart, no longer than a column."""
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
    return [name if len(name) <= COLUMN else "..." + name[-(COLUMN - 3) :] for name in names]
