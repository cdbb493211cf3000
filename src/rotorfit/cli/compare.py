"""rotorfit compare: results side by side, with the difference to the first."""

import dataclasses
import json
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotorfit.cli.terminal import show, terminal_width
from rotorfit.errors import ExperimentError, OutputError
from rotorfit.formatting.digits import with_interval
from rotorfit.logs.read import TRUTH_FILE, own_kind
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.results.compare import ComparedNumber, Comparison, Entry, compare_results
from rotorfit.results.result import Derived, IdentificationResult, Parameter
from rotorfit.results.sound_result import load_sound

LABEL = 20
"""Longer names of results are cut in front."""
APART = "*"


def run(paths: Sequence[Path], *, as_json: bool) -> None:
    """Load, compare, print."""
    truths = [own_kind(path) == TRUTH_FILE for path in paths]
    if all(truths):
        raise ExperimentError("truths alone were given: give a result to compare them with")
    results = [
        truth_result(path) if is_truth else load_sound(path)
        for path, is_truth in zip(paths, truths, strict=True)
    ]
    if any(p.name == "command_delay" for result in results for p in result.parameters):
        results = [
            _with_delay_of_commands(result) if is_truth else result
            for result, is_truth in zip(results, truths, strict=True)
        ]
    comparison = compare_results(results, _labels(paths))
    if as_json:
        show(json.dumps(dataclasses.asdict(comparison), indent=1, allow_nan=False))
    else:
        show("\n".join([comparison_text(comparison), *_latency(results)]))


def _with_delay_of_commands(truth: IdentificationResult) -> IdentificationResult:
    """Return a truth, whose delay is that of commands, as results of measured speeds name it."""
    names = {"motor_delay": "command_delay"}
    named = (dataclasses.replace(p, name=names.get(p.name, p.name)) for p in truth.parameters)
    return dataclasses.replace(truth, parameters=tuple(named))


def truth_result(path: Path) -> IdentificationResult:
    """Return the truth of a simulated flight as a result: every number given, without width.

    Raises
    ------
    OutputError
        If the file is not what `rotorfit simulate` and `rotorfit demo` leave as truth.json.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        tables = {None: told["shared"], **told["configurations"]}
        numbers = [
            (str(name), None if owner is None else str(owner), float(value))
            for owner, table in tables.items()
            for name, value in table.items()
            if isinstance(value, int | float)
        ]
    except (AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        raise OutputError(
            f"{path} is not the truth of a simulated flight ({error}); give the truth.json that "
            "rotorfit simulate or rotorfit demo -o wrote"
        ) from error
    return IdentificationResult(
        name=path.stem,
        method="truth",
        parameters=tuple(
            Parameter(
                name=name,
                configuration=owner,
                value=value,
                std=0.0,
                interval=(value, value),
                unit=PARAMETERS[name].unit,
                verdict="given",
            )
            for name, owner, value in numbers
            if name in PARAMETERS
        ),
        derived=tuple(
            Derived(
                name=name,
                configuration=owner,
                value=value,
                std=0.0,
                interval=(value, value),
                unit=DERIVED[name].unit,
            )
            for name, owner, value in numbers
            if name in DERIVED
        ),
        flights=(),
        covariance_names=(),
        covariance=np.zeros((0, 0)),
        settings={},
        versions={},
    )


def _latency(results: Sequence[IdentificationResult]) -> list[str]:
    """Return why lags differ, where a camera measured the motion of some results only."""
    sources = {r.settings.get("identification", {}).get("source", "imu") for r in results}
    if sources != {"imu", "mocap"}:
        return []
    words = (
        "Motor lag and delay from motion capture include the camera's latency: what its frames are "
        "late by cannot be separated from motors that respond late."
    )
    return ["", *textwrap.wrap(words, terminal_width())]


def comparison_text(comparison: Comparison) -> str:
    """Return a comparison as text for a terminal: a line a number, a column a result."""
    several = len({n.configuration for n in comparison.numbers} - {None}) > 1
    first, *others = comparison.labels
    rows = [["", first, *(cell for label in others for cell in (label, "differs")), ""]]
    rows += [_cells(number, several=several) for number in comparison.numbers]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [_line(row, widths) for row in rows]
    apart = [
        _name(number, several=several)
        for number in comparison.numbers
        if any(entry.overlap is False for entry in number.entries)
    ]
    if apart:
        words = (
            f"{APART} the 95 % intervals do not overlap, so that at least one result is wrong: "
            f"{', '.join(apart)}"
        )
        lines += ["", *textwrap.wrap(words, terminal_width(), subsequent_indent="  ")]
    words = (
        f"differs: from the value of {first}, in percent; left empty where its interval "
        "includes zero."
    )
    lines += ["", *textwrap.wrap(words, terminal_width())]
    return "\n".join(lines)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    """Return name and unit to the left of their columns, numbers to the right."""
    name, *numbers, unit = cells
    shown = [f"{cell:>{width}}" for cell, width in zip(numbers, widths[1:-1], strict=True)]
    return " ".join([f"{name:<{widths[0]}}", *shown, unit]).rstrip()


def _cells(number: ComparedNumber, *, several: bool) -> list[str]:
    """Return name, value, then value and difference of every other result, unit."""
    first, *others = number.entries
    cells = [_name(number, several=several), with_interval(first.value, first.interval)]
    for entry in others:
        cells += [with_interval(entry.value, entry.interval), _difference(entry, first)]
    return [*cells, "" if number.unit == "1" else number.unit]


def _difference(entry: Entry, first: Entry) -> str:
    """Return the difference in percent, and whether the intervals are apart.

    No percentage of what may as well be zero.
    """
    apart = APART if entry.overlap is False else " "
    about_zero = first.interval is not None and first.interval[0] <= 0 <= first.interval[1]
    if entry.difference is None or about_zero:
        return apart
    percent = 100.0 * entry.difference
    decimals = 0 if abs(percent) >= 99.5 else 1 if abs(percent) >= 9.95 else 2
    return f"{percent:+.{decimals}f} %{apart}"


def _name(number: ComparedNumber, *, several: bool) -> str:
    """Return the name, with its configuration where there is more than one."""
    if number.configuration is None or not several:
        return number.name
    return f"{number.name} {number.configuration}"


def _labels(paths: Sequence[Path]) -> list[str]:
    """Return the shortest names that tell the files apart, no longer than a column."""
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
    return [name if len(name) <= LABEL else "..." + name[-(LABEL - 3) :] for name in names]
