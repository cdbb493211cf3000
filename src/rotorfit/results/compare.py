"""Results side by side, parameter by parameter: IMU against motion capture (Six et al. 2020, IV-C).

Differences are relative to the first result's value, as in Table II.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rotorfit.digits import with_interval
from rotorfit.errors import ExperimentError
from rotorfit.estimation.measured import Measured
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import EFFECTIVE_UNITS
from rotorfit.model.terms.rotors import MOST_ROTORS
from rotorfit.results.command_law import AT_COMMAND, USUAL_EXPONENT
from rotorfit.results.result import Derived, IdentificationResult, Parameter, verdict_of

if TYPE_CHECKING:
    from collections.abc import Sequence

VOLTAGE_POWERS: Final = {
    "max_speed": 1.0,
    **dict.fromkeys(("max_thrust", "thrust_to_weight"), 2.0),
    **dict.fromkeys(("max_thrust_loaded", "thrust_to_weight_loaded"), 2.0),
    "hover_throttle": -1.0,
}
"""Power of the full rotor speed with which a number changes as the battery's charge does."""
PER_COMMAND: Final = {
    **dict.fromkeys(("kt", "kd", *(f"kt_{i}" for i in range(1, MOST_ROTORS + 1))), 2.0),
    "Jr": 1.0,
    "hover_speed": -1.0,
}
"""The same of numbers in the unit of commands."""


@frozen_dataclass
class Entry:
    """A number as one result has it.

    - `value`, `interval`: SI; None if the result has none. The interval is 95 %.
    - `verdict`: None for derived numbers that have none, and for what is not in the result.
    - `difference`: from the first result, as a fraction of its value; None for the first, where
      either has no value, and where the first is zero.
    - `overlap`: whether the interval meets that of the first, at the same battery voltage; None
      where either has none.
    """

    value: float | None
    interval: tuple[float, float] | None
    verdict: str | None
    difference: float | None
    overlap: bool | None


@frozen_dataclass
class ComparedNumber:
    """One number in every result, in their order."""

    name: str
    configuration: str | None
    unit: str
    entries: tuple[Entry, ...]


@frozen_dataclass
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
    tables = [_table_of_numbers(result) for result in results]
    if all(len(_list_configurations(result)) == 1 for result in results):
        first = _list_configurations(results[0])[0]
        tables = [_rename_configuration(table, first) for table in tables]
    keys = list(dict.fromkeys(key for table in tables for key in table))
    keys.sort(key=lambda key: key[0] == "derived")
    return Comparison(
        labels=tuple(labels),
        numbers=tuple(
            _compare_number(key, [table.get(key) for table in tables], labels, results)
            for key in keys
            if any(key in table and table[key][0].value is not None for table in tables)
        ),
    )


_Key = tuple[str, str, str | None]
_Judged = tuple[Parameter | Derived, str | None]
"""A number with its verdict."""
_Table = dict[_Key, _Judged]


def _table_of_numbers(result: IdentificationResult) -> _Table:
    """Return every number of a result by kind, name and configuration."""
    table: _Table = {
        ("parameter", p.name, p.configuration): (p, p.verdict) for p in result.parameters
    }
    return table | {
        ("derived", d.name, d.configuration): (d, verdict_of(result, d) or None)
        for d in result.derived
    }


def _list_configurations(result: IdentificationResult) -> list[str]:
    names = [p.configuration for p in result.parameters if p.configuration is not None]
    return list(dict.fromkeys(names))


def _rename_configuration(table: _Table, configuration: str) -> _Table:
    """Return a table of one configuration under another name for it."""
    return {
        (kind, name, None if owner is None else configuration): number
        for (kind, name, owner), number in table.items()
    }


def _charge_factor(
    name: str, reference: IdentificationResult, other: IdentificationResult
) -> Measured:
    """Return the factor from a number at one battery voltage to the same at the reference's.

    1 where it does not depend on the battery, or where the results do not say at which it holds.
    """
    here, there = (r.diagnostics.get(AT_COMMAND) for r in (reference, other))
    power = VOLTAGE_POWERS.get(name, 0.0)
    named = [n for n in (*other.parameters, *other.derived) if n.name == name]
    if any(EFFECTIVE_UNITS.get(name) == n.unit for n in named):
        power = PER_COMMAND.get(name, power)
    if here is None or there is None or not power:
        return Measured(value=1.0, std=0.0)
    log_ratio = power * math.log(here / there)
    factor = math.exp(USUAL_EXPONENT.value * log_ratio)
    return Measured(value=factor, std=factor * USUAL_EXPONENT.std * abs(log_ratio))


def _compare_number(
    key: _Key,
    judged: Sequence[_Judged | None],
    labels: Sequence[str],
    results: Sequence[IdentificationResult],
) -> ComparedNumber:
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
    charges = [_charge_factor(key[1], results[0], other) for other in results]
    return ComparedNumber(
        name=key[1],
        configuration=key[2],
        unit=next(iter(units)),
        entries=tuple(
            _compare_entry(n, verdict, None if n is reference else reference, charge)
            for n, verdict, charge in zip(numbers, verdicts, charges, strict=True)
        ),
    )


def _compare_entry(
    number: Parameter | Derived | None,
    verdict: str | None,
    reference: Parameter | Derived | None,
    charge: Measured,
) -> Entry:
    """Compare a result's number with the reference's number, at its battery's `charge`."""
    if number is None:
        return Entry(value=None, interval=None, verdict=None, difference=None, overlap=None)
    difference = overlap = None
    if reference is not None and number.value is not None and reference.value:
        difference = (number.value - reference.value) / abs(reference.value)
    if reference is not None and number.interval is not None and reference.interval is not None:
        wider = 1.96 * charge.std * abs(number.value or 0.0)
        low, high = (charge.value * end for end in number.interval)
        overlap = max(low - wider, reference.interval[0]) <= min(
            high + wider, reference.interval[1]
        )
    return Entry(
        value=number.value,
        interval=number.interval,
        verdict=verdict,
        difference=difference,
        overlap=overlap,
    )
