"""Results side by side, parameter by parameter: IMU against motion capture (Six et al. 2020, IV-C).

Differences are relative to the first result's value, as in Table II.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from rotorfit.digits import with_interval
from rotorfit.errors import ExperimentError
from rotorfit.results.result import Derived, IdentificationResult, Parameter, verdict_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A number as one result has it.

    - `value`, `interval`: SI; None where the result has none. The interval is 95 %.
    - `verdict`: None for derived numbers that have none, and for what is not in the result.
    - `difference`: from the first result, as a fraction of its value; None for the first, where
      either has no value, and where the first is zero.
    - `overlap`: whether the interval meets that of the first; None where either has none.
    """

    value: float | None
    interval: tuple[float, float] | None
    verdict: str | None
    difference: float | None
    overlap: bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedNumber:
    """One number in every result, in their order."""

    name: str
    configuration: str | None
    unit: str
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Results side by side; as text a table, an asterisk where intervals do not overlap.

    Attributes
    ----------
    labels
        Of the results, in order; the first is compared with.
    numbers
        Parameters, then derived numbers, that at least one result gives.
    """

    labels: tuple[str, ...]
    numbers: tuple[ComparedNumber, ...]

    def __str__(self) -> str:
        several = len({n.configuration for n in self.numbers} - {None}) > 1
        names = [
            f"{n.name} {n.configuration}" if several and n.configuration else n.name
            for n in self.numbers
        ]
        rows = [["", *self.labels, ""]]
        for name, number in zip(names, self.numbers, strict=True):
            values = [_value_text(entry, number.entries[0]) for entry in number.entries]
            rows.append([name, *values, "" if number.unit == "1" else number.unit])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)) for row in rows)
        return "\n".join(line.rstrip() for line in lines)


def _value_text(entry: Entry, first: Entry) -> str:
    """Write a value with its interval, and its difference from a first that is not zero."""
    shown = with_interval(entry.value, entry.interval)
    low, high = first.interval or (first.value, first.value)
    if entry.difference is None or low is None or high is None or low <= 0.0 <= high:
        return shown
    mark = "*" if entry.overlap is False else ""
    return f"{shown} ({100.0 * entry.difference:+.1f} %{mark})"


def compare_results(results: Sequence[IdentificationResult], labels: Sequence[str]) -> Comparison:
    """Compare results side by side.

    Configurations are matched by name; where each result has a single one, whatever its name.

    Parameters
    ----------
    results
        Two at least; the first is compared with.
    labels
        What to call each of them.

    Raises
    ------
    ExperimentError
        If there are fewer than two, or their units differ.
    """
    if len(results) < 2:
        raise ExperimentError("one result cannot be compared; give two or more result files")
    tables = [_numbers(result) for result in results]
    if all(len(_configurations(result)) == 1 for result in results):
        first = _configurations(results[0])[0]
        tables = [_renamed(table, first) for table in tables]
    keys = list(dict.fromkeys(key for table in tables for key in table))
    keys.sort(key=lambda key: key[0] == "derived")
    return Comparison(
        labels=tuple(labels),
        numbers=tuple(
            _compared(key, [table.get(key) for table in tables], labels)
            for key in keys
            if any(key in table and table[key][0].value is not None for table in tables)
        ),
    )


_Key = tuple[str, str, str | None]
_Judged = tuple[Parameter | Derived, str | None]
"""A number with its verdict."""
_Table = dict[_Key, _Judged]


def _numbers(result: IdentificationResult) -> _Table:
    """Return every number of a result by kind, name and configuration."""
    table: _Table = {
        ("parameter", p.name, p.configuration): (p, p.verdict) for p in result.parameters
    }
    return table | {
        ("derived", d.name, d.configuration): (d, verdict_of(result, d) or None)
        for d in result.derived
    }


def _configurations(result: IdentificationResult) -> list[str]:
    names = [p.configuration for p in result.parameters if p.configuration is not None]
    return list(dict.fromkeys(names))


def _renamed(table: _Table, configuration: str) -> _Table:
    """Return a table of one configuration under another name for it."""
    return {
        (kind, name, None if owner is None else configuration): number
        for (kind, name, owner), number in table.items()
    }


def _compared(key: _Key, judged: Sequence[_Judged | None], labels: Sequence[str]) -> ComparedNumber:
    """Collect one number of all results."""
    numbers = [None if one is None else one[0] for one in judged]
    verdicts = [None if one is None else one[1] for one in judged]
    units = {n.unit: label for n, label in zip(numbers, labels, strict=True) if n is not None}
    if len(units) > 1:
        (one, here), (other, there), *_ = units.items()
        raise ExperimentError(
            f"{key[1]} is in {one} in {here} but in {other} in {there}: results per kilogram "
            "(mass unknown) compare only with each other; identify again with the mass"
        )
    reference = numbers[0]
    return ComparedNumber(
        name=key[1],
        configuration=key[2],
        unit=next(iter(units)),
        entries=tuple(
            _entry(n, verdict, None if n is reference else reference)
            for n, verdict in zip(numbers, verdicts, strict=True)
        ),
    )


def _entry(
    number: Parameter | Derived | None,
    verdict: str | None,
    reference: Parameter | Derived | None,
) -> Entry:
    """Compare a result's number with the reference's number."""
    if number is None:
        return Entry(value=None, interval=None, verdict=None, difference=None, overlap=None)
    difference = overlap = None
    if reference is not None and number.value is not None and reference.value:
        difference = (number.value - reference.value) / abs(reference.value)
    if reference is not None and number.interval is not None and reference.interval is not None:
        low = max(number.interval[0], reference.interval[0])
        overlap = low <= min(number.interval[1], reference.interval[1])
    return Entry(
        value=number.value,
        interval=number.interval,
        verdict=verdict,
        difference=difference,
        overlap=overlap,
    )
