"""Wrenches and residuals of every flight of a result, as columns over time, for PlotJuggler.

The flights are read again. The first line of the CSV names the columns, as PlotJuggler wants it,
and so there is no head of comments; Parquet carries it as metadata. Names have the unit, and a
slash for PlotJuggler's tree.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.experiment.experiment import experiment_of_settings
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.validate import fitted_comparisons, validation_comparisons
from rotorfit.validation.wrench_comparison import COMPONENTS, WrenchComparison

Columns = Mapping[str, Float[np.ndarray, " n"]]


def flight_comparisons(
    result: IdentificationResult, configuration: str | None
) -> list[WrenchComparison]:
    """Return the wrenches on the flights of the fit, and on those kept apart, read again."""
    found = fitted_comparisons(result)
    found += validation_comparisons(result, experiment_of_settings(result.settings))
    return [c for c in found if configuration in (None, c.configuration)]


def columns_of(comparison: WrenchComparison, result: IdentificationResult) -> Columns:
    """Tabulate body wrench, rotor wrench and their difference, of the components that are known.

    Per kilogram, and named so, where the mass is unknown.
    """
    mass = result.parameter("mass", comparison.configuration).value
    per_mass = " per kg" if mass is None else ""
    out: dict[str, Float[np.ndarray, " n"]] = {"time": comparison.time}
    for i, component in enumerate(COMPONENTS):
        unit = ("N" if component.startswith("F") else "N m") + per_mass
        if component not in comparison.relative_error:
            continue
        body, rotors = comparison.body_wrench[:, i], comparison.rotor_wrench[:, i]
        out[f"body/{component} [{unit}]"] = body
        out[f"rotors/{component} [{unit}]"] = rotors
        out[f"residual/{component} [{unit}]"] = body - rotors
    return out


def table_files(path: Path, comparisons: Sequence[WrenchComparison]) -> list[Path]:
    """Return the file of each flight: the one named, or one for each with its name behind."""
    if len(comparisons) == 1:
        return [path]
    names = [f"{path.stem}_{Path(c.flight).stem}" for c in comparisons]
    doubled = {name for name in names if names.count(name) > 1}
    return [
        path.with_name(f"{name}_{i}{path.suffix}" if name in doubled else f"{name}{path.suffix}")
        for i, name in enumerate(names, start=1)
    ]


def csv_text(columns: Columns) -> str:
    """Write columns as CSV."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def parquet_bytes(columns: Columns, head: Sequence[str]) -> bytes:
    """Write columns as Parquet, the head of the file as metadata ``rotorfit``.

    Raises
    ------
    OutputError
        If pyarrow is not installed.
    """
    try:
        arrow: Any = import_module("pyarrow")
        parquet: Any = import_module("pyarrow.parquet")
    except ImportError as error:
        raise OutputError(
            'writing Parquet needs pyarrow: pip install "rotorfit[parquet]", or name a .csv file'
        ) from error
    table = arrow.table(dict(columns)).replace_schema_metadata({"rotorfit": "\n".join(head)})
    sink = arrow.BufferOutputStream()
    parquet.write_table(table, sink)
    return sink.getvalue().to_pybytes()
