"""rotorfit compare: results side by side, with the difference to the first."""

from __future__ import annotations

import dataclasses
import json
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorfit.cli.terminal import AsJson, print_result, terminal_width
from rotorfit.errors import ExperimentError, OutputError

if TYPE_CHECKING:
    from rotorfit.results.compare import ComparedNumber, Comparison, Entry
    from rotorfit.results.result import IdentificationResult

LABEL = 20
"""Longer names of results are cut in front."""
DISJOINT = "*"


def compare(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="Results that identify -o wrote, two or more; or the truth.json of a simulation.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Show results side by side, and how far they differ.

    Prints values and intervals, the difference to the first result in percent, and which intervals
    do not overlap with the first.
    """
    from rotorfit.results.compare import compare_results

    loaded = _load_results(results)
    comparison = compare_results(loaded, _shorten_labels(results))
    if as_json:
        print_result(json.dumps(dataclasses.asdict(comparison), indent=1, allow_nan=False))
    else:
        print_result("\n".join([comparison_text(comparison), *_latency_note(loaded)]))


def _load_results(paths: Sequence[Path]) -> list[IdentificationResult]:
    """Load results and truths; a truth names its delay as the results do."""
    from rotorfit.logs.read import TRUTH_FILE, own_kind
    from rotorfit.results.sound_result import load_sound

    are_truths = [own_kind(path) == TRUTH_FILE for path in paths]
    if all(are_truths):
        raise ExperimentError("truths alone were given: give a result to compare them with")
    results = [
        truth_result(path) if is_truth else load_sound(path)
        for path, is_truth in zip(paths, are_truths, strict=True)
    ]
    if not any(p.name == "command_delay" for result in results for p in result.parameters):
        return results
    return [
        _with_delay_of_commands(result) if is_truth else result
        for result, is_truth in zip(results, are_truths, strict=True)
    ]


def _with_delay_of_commands(truth: IdentificationResult) -> IdentificationResult:
    """Rename the delay of a truth, which is of commands, as results of measured speeds name it."""
    names = {"motor_delay": "command_delay"}
    named = (dataclasses.replace(p, name=names.get(p.name, p.name)) for p in truth.parameters)
    return dataclasses.replace(truth, parameters=tuple(named))


def truth_result(path: Path) -> IdentificationResult:
    """Load the truth.json of a simulated flight as a result: every number given, without width."""
    import numpy as np

    from rotorfit.model.parameters import DERIVED, PARAMETERS, SHARED
    from rotorfit.results.result import Derived, IdentificationResult, Parameter

    parameters: list[Parameter] = []
    derived: list[Derived] = []
    for name, owner, value in _true_numbers(path):
        exact: dict[str, Any] = {
            "name": name,
            # As results have it: a shared number of a truth may stand among a configuration's.
            "configuration": None if name in SHARED else owner,
            "value": value,
            "std": 0.0,
            "interval": (value, value),
        }
        if name in PARAMETERS:
            parameters.append(Parameter(**exact, unit=PARAMETERS[name].unit, verdict="given"))
        elif name in DERIVED:
            derived.append(Derived(**exact, unit=DERIVED[name].unit))
    return IdentificationResult(
        name=path.stem,
        method="truth",
        parameters=tuple(parameters),
        derived=tuple(derived),
        flights=(),
        covariance_names=(),
        covariance=np.zeros((0, 0)),
        settings={},
        versions={},
    )


def _true_numbers(path: Path) -> list[tuple[str, str | None, float]]:
    """Read name, configuration and value of every number of a truth.json."""
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))
        tables = {None: truth["shared"], **truth["configurations"]}
        return [
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


def _latency_note(results: Sequence[IdentificationResult]) -> list[str]:
    """Explain why lags differ, where a camera measured the motion of some results only."""
    sources = {r.settings.get("identification", {}).get("source", "imu") for r in results}
    if sources != {"imu", "mocap"}:
        return []
    note = (
        "Motor lag and delay from motion capture include the camera's latency: what its frames are "
        "late by cannot be separated from motors that respond late."
    )
    return ["", *textwrap.wrap(note, terminal_width())]


def comparison_text(comparison: Comparison) -> str:
    """Format a comparison for a terminal: a line a number, a column a result."""
    from rotorfit.sheet import table_lines

    several = len({n.configuration for n in comparison.numbers} - {None}) > 1
    first, *others = comparison.labels
    rows = [["", first, *(cell for label in others for cell in (label, "differs")), ""]]
    rows += [_format_cells(number, several=several) for number in comparison.numbers]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = table_lines([_pad_cells(row, widths) for row in rows], terminal_width())
    disjoint = [
        _number_name(number, several=several)
        for number in comparison.numbers
        if any(entry.overlap is False for entry in number.entries)
    ]
    if disjoint:
        remark = (
            f"{DISJOINT} the 95 % intervals do not overlap, so that a number is outside its own, "
            f"as 1 in 20 may be by chance: {', '.join(disjoint)}"
        )
        lines += ["", *textwrap.wrap(remark, terminal_width(), subsequent_indent="  ")]
    for label, names in _list_doubtful(comparison, several=several).items():
        remark = f"doubtful in {label}, may be outside their intervals: {', '.join(names)}"
        lines += ["", *textwrap.wrap(remark, terminal_width(), subsequent_indent="  ")]
    remark = (
        f"differs: from the value of {first}, in percent; left empty where its interval "
        "includes zero."
    )
    lines += ["", *textwrap.wrap(remark, terminal_width())]
    return "\n".join(lines)


def _list_doubtful(comparison: Comparison, *, several: bool) -> dict[str, list[str]]:
    """List the numbers that a result calls doubtful, by its label."""
    found: dict[str, list[str]] = {}
    for number in comparison.numbers:
        for label, entry in zip(comparison.labels, number.entries, strict=True):
            if entry.verdict == "doubtful":
                found.setdefault(label, []).append(_number_name(number, several=several))
    return found


def _pad_cells(cells: Sequence[str], widths: Sequence[int]) -> list[str]:
    """Align name and unit to the left of their columns, numbers to the right."""
    name, *numbers, unit = cells
    shown = [f"{cell:>{width}}" for cell, width in zip(numbers, widths[1:-1], strict=True)]
    return [f"{name:<{widths[0]}}", *shown, unit]


def _format_cells(number: ComparedNumber, *, several: bool) -> list[str]:
    """Format name, value, then value and difference of every further result, unit."""
    from rotorfit.digits import with_interval

    first, *others = number.entries
    cells = [_number_name(number, several=several), with_interval(first.value, first.interval)]
    for entry in others:
        cells += [with_interval(entry.value, entry.interval), _format_difference(entry, first)]
    return [*cells, "" if number.unit == "1" else number.unit]


def _format_difference(entry: Entry, first: Entry) -> str:
    """Format the difference in percent, if the first is not zero, and mark disjoint intervals."""
    mark = DISJOINT if entry.overlap is False else " "
    about_zero = first.interval is not None and first.interval[0] <= 0 <= first.interval[1]
    if entry.difference is None or about_zero:
        return mark
    percent = 100.0 * entry.difference
    decimals = 0 if abs(percent) >= 99.5 else 1 if abs(percent) >= 9.95 else 2
    return f"{percent:+.{decimals}f} %{mark}"


def _number_name(number: ComparedNumber, *, several: bool) -> str:
    """Append the configuration to a name where there are several."""
    if number.configuration is None or not several:
        return number.name
    return f"{number.name} {number.configuration}"


def _shorten_labels(paths: Sequence[Path]) -> list[str]:
    """Select the shortest names that distinguish the files, no longer than a column."""
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
    return [name if len(name) <= LABEL else "..." + name[-(LABEL - 3) :] for name in names]
