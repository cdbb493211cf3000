"""From a result to the files of other tools: vehicles, and wrenches over time for PlotJuggler.

The first line of a CSV names the columns, as PlotJuggler wants it, and so there is no head of
comments; Parquet carries it as metadata. Names have the unit, and a slash for PlotJuggler's tree.
"""

from __future__ import annotations

import datetime
import math
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit import version
from rotorfit.errors import EstimationError, OutputError
from rotorfit.export.result_numbers import DOUBTFUL, Number
from rotorfit.export.targets import RANDOM_TARGETS, TARGETS, RandomTargetName, TargetName, writer_of
from rotorfit.export.variants import Variants, refuse_suffix, variants, write_samples
from rotorfit.export.vehicle_model import terms_left_out, vehicle_model
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name, write_whole
from rotorfit.results.validation.wrench_comparison import COMPONENTS, WrenchComparison

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.export.vehicle import VehicleModel
    from rotorfit.results.result import IdentificationResult

    Columns = Mapping[str, Float[np.ndarray, " n"]]


def flight_comparisons(
    result: IdentificationResult, configuration: str | None
) -> list[WrenchComparison]:
    """Return the wrenches on the flights of the fit, and on those kept apart, read again."""
    # They read and prepare flights: slow to import.
    from rotorfit.results.validation.validate import fitted_comparisons, validation_comparisons

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

    Raises `OutputError` if pyarrow is not installed.
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


ORIGINS: Final = {
    "identified": "identified",
    "weak": "WEAK",
    "doubtful": "DOUBTFUL",
    "given": "given",
    "removed": "REMOVED",
    "assumed": "ASSUMED",
    "from-ratio": "FROM A RATIO",
    "law": "from the law",
}
SHA: Final = 12
"""Digits of a log's fingerprint that are shown."""
DIGITS: Final = (
    "Below, numbers have 12 digits so that rounding changes nothing; the intervals above say how "
    "many of these are known."
)
MOST_DIGITS: Final = 6
"""Digits of a number in the head of a file, at most."""
DRAWN: Final = 1000
"""Vehicles drawn for the intervals of what is written: their ends are within 2 % of a width."""
COUNT: Final = 100
"""Vehicles of a randomised target, where nobody says how many."""


@frozen_dataclass
class Export:
    """The text of a file, and the vehicle it describes.

    `unsure`: numbers that the file holds and that are not simply identified.
    """

    text: str
    model: VehicleModel
    unsure: tuple[Number, ...] = ()


def write_export(
    path: Path,
    result: IdentificationResult,
    target: TargetName,
    *,
    configuration: str | None = None,
    assumed: Mapping[str, float] | None = None,
    project: bool = False,
    force: bool = False,
) -> str:
    """Write a result as a file that another tool reads, whole or not at all.

    Parameters
    ----------
    path
        The file.
    result
        What `identify` returned, or `IdentificationResult.load`.
    target
        Whose file, as ``rotorfit export --to``: ``"gazebo"``, ``"px4"``, ``"mujoco"`` ...
    configuration
        Which of the result's configurations; may be left out where there is one.
    assumed
        Values that you stand for where the flights do not give them, by name, SI units.
    project
        Replace inertia that no body has by the nearest that one can have.
    force
        Replace a file that is there.

    Returns
    -------
    str
        What was written.

    Raises
    ------
    OutputError
        If something that the file needs is not known, the target cannot hold the vehicle, the file
        exists and `force` is false, or it cannot be written.
    """
    made = export(result, target, configuration=configuration, assumed=assumed, project=project)
    write_whole(path, made.text, force=force)
    return made.text


def export(
    result: IdentificationResult,
    target: TargetName,
    *,
    configuration: str | None = None,
    assumed: Mapping[str, float] | None = None,
    project: bool = False,
    date: datetime.date | None = None,
    draws: int = DRAWN,
) -> Export:
    """Make the file of a target (see `write_export`), its intervals from drawn vehicles."""
    chosen = TARGETS[target]
    model = vehicle_model(
        result,
        configuration=configuration,
        needs=chosen.needs,
        assumed=assumed,
        speed=chosen.speed,
        tilted_needs=chosen.tilted_needs,
        project=project,
    )
    terms = terms_left_out(result, model.configuration, written=chosen.terms)
    if terms:
        model = with_note(model, f"this kind of file has no place for: {', '.join(terms)}")
    drawn: Sequence[VehicleModel] = ()
    if chosen.intervals:
        try:
            drawn = variants(result, model, count=draws, seed=0).models
        except (EstimationError, OutputError) as error:
            model = with_note(model, f"without intervals: {error}")
    head = header_lines(model, result, target=target, date=date)
    arguments = (model, head, drawn) if chosen.intervals else (model, head)
    given = dict(assumed or {})
    return Export(
        text=writer_of(target)(*arguments),
        model=model,
        unsure=_unsure_numbers(result, model, target, assumed=given, project=project),
    )


MOVED: Final = 0.05
"""Share of itself by which a number is moved to see whether a file holds it."""


def _unsure_numbers(
    result: IdentificationResult,
    model: VehicleModel,
    target: TargetName,
    *,
    assumed: Mapping[str, float],
    project: bool,
) -> tuple[Number, ...]:
    """Select the numbers that are not simply identified, and of which the file's text depends."""
    chosen = TARGETS[target]

    def written(given: Mapping[str, float]) -> str:
        other = vehicle_model(
            result,
            configuration=model.configuration,
            needs=chosen.needs,
            assumed={**assumed, **given},
            speed=chosen.speed,
            tilted_needs=chosen.tilted_needs,
            project=project,
        )
        write, head = writer_of(target), list[str]()
        return str(write(other, head, ()) if chosen.intervals else write(other, head))

    plain = written({})
    return tuple(n for n in model.numbers if n.origin in DOUBTFUL and _is_held(n, written, plain))


def _is_held(number: Number, written: Callable[[Mapping[str, float]], str], plain: str) -> bool:
    """Test whether a file is another one with another value of a number."""
    low, high = number.interval or (number.value, number.value)
    step = max(0.5 * (high - low), MOVED * abs(number.value), np.finfo(float).tiny)
    try:
        return written({number.name: number.value + step}) != plain
    except OutputError:
        return True  # as the vehicle cannot be written so, the number counts


def randomised(
    result: IdentificationResult,
    target: RandomTargetName,
    path: Path,
    *,
    configuration: str | None = None,
    assumed: Mapping[str, float] | None = None,
    count: int = COUNT,
    seed: int = 0,
    date: datetime.date | None = None,
) -> tuple[bytes, Variants]:
    """Draw vehicles and make the file of a target; the suffix says the form of ``samples``."""
    suffix = path.suffix.lower()
    if target == "samples":
        refuse_suffix(suffix)
    nominal = vehicle_model(
        result, configuration=configuration, needs=RANDOM_TARGETS[target].needs, assumed=assumed
    )
    found = variants(result, nominal, count=count, seed=seed)
    if target == "samples":
        return write_samples(found, result, suffix=suffix), found
    head = header_lines(nominal, result, target=target, date=date)
    return writer_of(target)(found, [*head, drawn_sentence(found)]), found


def variant_files(
    result: IdentificationResult,
    target: TargetName,
    *,
    configuration: str | None = None,
    assumed: Mapping[str, float] | None = None,
    count: int = COUNT,
    seed: int = 0,
    date: datetime.date | None = None,
) -> tuple[dict[str, str], Variants]:
    """Draw vehicles and make one file for each, by name; arguments of `randomised`."""
    whole = export(result, target, configuration=configuration, assumed=assumed, date=date)
    found = variants(result, whole.model, count=count, seed=seed)
    write, digits = writer_of(target), len(str(count))
    files: dict[str, str] = {}
    for i, model in enumerate(found.models, 1):
        drawn = with_note(
            model, f"vehicle {i} of {count} drawn from the joint posterior, seed {seed}"
        )
        head = header_lines(drawn, result, target=target, date=date)
        files[f"{target}-{i:0{digits}}{TARGETS[target].suffix}"] = write(drawn, head)
    return files, found


def with_note(model: VehicleModel, note: str) -> VehicleModel:
    """Add a note to those of a vehicle."""
    return replace(model, notes=(*model.notes, note))


def drawn_sentence(found: Variants) -> str:
    """Describe how vehicles were drawn."""
    why = "".join(f" ({name}: {100 * s:.2g} %)" for name, s in found.samples.reasons.items())
    return (
        f"{len(found.models)} vehicles drawn from the joint posterior, seed {found.samples.seed}; "
        f"{100 * found.samples.rejected:.2g} % of the draws rejected{why}"
    )


def header_lines(
    model: VehicleModel,
    result: IdentificationResult,
    *,
    target: str,
    date: datetime.date | None,
) -> list[str]:
    """Write the head of a file, without comment signs: origin, numbers, units, warnings."""
    lines = [
        f"{target}, written by rotorfit {version.__version__} on "
        f"{(date or datetime.date.today()).isoformat()}",
        f"{result.name}, configuration {model.configuration}; identified by "
        f"{result.versions.get('rotorfit', 'an unknown version')}, method {result.method}, from",
        *(
            f"  {file_name(record.file)} (sha256 {record.sha256[:SHA]}), configuration "
            f"{record.configuration}, {record.seconds_used:.1f} s used"
            for record in result.flights
        ),
        "Numbers (95 % interval) in SI units, body axes FLU (x forward, y left, z up):",
        *(_number_line(number) for number in model.numbers),
        DIGITS,
        *(f"To know: {warning}" for warning in result.warnings),
        *(f"Note: {note}" for note in model.notes),
    ]
    return [_one_line(line) for line in lines]


def _one_line(line: str) -> str:
    """Make a line that is one in every format: no breaks, nothing that cannot be printed."""
    indent = "  " if line.startswith("  ") else ""
    plain = " ".join(line.split())
    return indent + "".join(letter if letter.isprintable() else "?" for letter in plain)


def _worthwhile_digits(low: float, high: float) -> int:
    """Return how many digits of an interval's ends give its half-width three digits."""
    half, largest = 0.5 * (high - low), max(abs(low), abs(high))
    if not half > 0.0:
        return MOST_DIGITS
    above = math.floor(math.log10(largest)) - math.floor(math.log10(half))
    return min(max(above + 3, 1), MOST_DIGITS)


def _number_line(number: Number) -> str:
    interval, digits = "", MOST_DIGITS
    if number.interval is not None:
        low, high = number.interval
        digits = _worthwhile_digits(low, high)
        interval = f" ({low:.{digits}g} to {high:.{digits}g})"
    remark = "" if number.remark is None else f": {number.remark}"
    return (
        f"  {number.name} = {number.value:.{digits}g}{interval} {number.unit} "
        f"[{ORIGINS[number.origin]}{remark}]"
    )
