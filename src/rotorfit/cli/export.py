"""rotorfit export: a result as a file that another tool reads."""

import datetime
import json
import textwrap
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import typer

from rotorfit.cli.outputs import refuse_output_file, refuse_output_folder
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import show, terminal_width
from rotorfit.errors import OutputError, RotorfitWarning
from rotorfit.export.result_numbers import Number, number_warnings, parse_assumptions
from rotorfit.export.table import (
    columns_of,
    csv_text,
    flight_comparisons,
    parquet_bytes,
    table_files,
)
from rotorfit.export.targets import AnyTargetName, RandomTargetName, TargetName
from rotorfit.export.variants import Variants
from rotorfit.export.write import COUNT, drawn_sentence, export, randomised, variant_files
from rotorfit.logs.files import write_whole
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import load_sound


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest:
    """What the user asked for."""

    result: Path
    target: AnyTargetName
    output: Path
    configuration: str | None
    assume: tuple[str, ...]
    project: bool
    samples: int | None
    seed: int
    force: bool
    as_json: bool


def run(request: ExportRequest) -> None:
    """Read the result, write the file, say what is in it."""
    try:
        assumed = parse_assumptions(request.assume)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--assume") from error
    drawn = request.target in get_args(RandomTargetName)
    if request.project and (drawn or request.samples is not None):
        raise typer.BadParameter(
            "--project is for one vehicle; drawn vehicles are physical already"
        )
    if request.samples is not None and not drawn:
        _write_variants(request, assumed)
        return
    refuse_output_file(request.output, inputs=[request.result], force=request.force)
    result = load_sound(request.result)
    if request.target == "table":
        if assumed or request.project:
            raise typer.BadParameter(
                "table is made of flights, and takes no --assume and no --project"
            )
        _write_tables(request, result)
    elif request.target in get_args(RandomTargetName):
        _write_randomised(request, cast("RandomTargetName", request.target), result, assumed)
    else:
        _write_vehicle(request, cast("TargetName", request.target), result, assumed)


def _write_randomised(
    request: ExportRequest,
    target: RandomTargetName,
    result: IdentificationResult,
    assumed: dict[str, float],
) -> None:
    """Write many vehicles into one file."""
    content, found = randomised(
        result,
        target,
        request.output,
        configuration=request.configuration,
        assumed=assumed,
        count=request.samples or COUNT,
        seed=request.seed,
    )
    write_whole(request.output, content, force=request.force)
    _tell_drawn(request, [request.output], found)


def _write_variants(request: ExportRequest, assumed: dict[str, float]) -> None:
    """Write one file for each of many vehicles into a folder."""
    if request.target == "table":
        raise typer.BadParameter("table is made of flights, and takes no --samples")
    result = load_sound(request.result)
    files, found = variant_files(
        result,
        cast("TargetName", request.target),
        configuration=request.configuration,
        assumed=assumed,
        count=request.samples or COUNT,
        seed=request.seed,
    )
    refuse_output_folder(request.output, files, force=request.force)
    for name, text in files.items():
        write_whole(request.output / name, text, force=request.force)
    _tell_drawn(request, [request.output / name for name in files], found)


def _tell_drawn(request: ExportRequest, files: Sequence[Path], found: Variants) -> None:
    """Say what was written of drawn vehicles, and what share of the draws was rejected."""
    model = found.nominal
    if request.as_json:
        described = {
            "target": request.target,
            "files": [str(file) for file in files],
            "configuration": model.configuration,
            "count": len(found.models),
            "seed": found.samples.seed,
            "rejected": found.samples.rejected,
            "reasons": dict(found.samples.reasons),
            "numbers": [_plain(n) for n in model.numbers],
            "notes": list(model.notes),
        }
        show(json.dumps(described, indent=1, allow_nan=False))
        return
    count = f", {len(files)} files" if len(files) > 1 else ""
    show(f"{request.output}: {request.target}, configuration {model.configuration}{count}")
    for line in (drawn_sentence(found), *number_warnings(model.numbers), *model.notes):
        show(textwrap.fill(line, terminal_width(), initial_indent="  ", subsequent_indent="    "))


def _write_vehicle(
    request: ExportRequest,
    target: TargetName,
    result: IdentificationResult,
    assumed: dict[str, float],
) -> None:
    made = export(
        result,
        target,
        configuration=request.configuration,
        assumed=assumed,
        project=request.project,
    )
    write_whole(request.output, made.text, force=request.force)
    if request.as_json:
        described = {
            "target": target,
            "files": [str(request.output)],
            "configuration": made.model.configuration,
            "numbers": [_plain(n) for n in made.model.numbers],
            "notes": list(made.model.notes),
        }
        show(json.dumps(described, indent=1, allow_nan=False))
        return
    show(f"{request.output}: {target}, configuration {made.model.configuration}")
    for line in (*number_warnings(made.model.numbers), *made.model.notes):
        show(textwrap.fill(line, terminal_width(), initial_indent="  ", subsequent_indent="    "))


def _plain(number: Number) -> dict[str, object]:
    return {
        "name": number.name,
        "value": number.value,
        "unit": number.unit,
        "origin": number.origin,
        "interval": number.interval,
        "remark": number.remark,
    }


def _write_tables(request: ExportRequest, result: IdentificationResult) -> None:
    """Write the wrenches of each flight: one file, or one a flight, all or none."""
    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)  # the result has them already
        tell("reading the flights again")
        comparisons = flight_comparisons(result, request.configuration)
    if not comparisons:
        raise OutputError(f"no flight of configuration {request.configuration!r} in the result")
    files = table_files(request.output, comparisons)
    for file in files:
        refuse_output_file(file, inputs=[request.result], force=request.force)
    contents: list[str | bytes] = []
    for comparison in comparisons:
        columns = columns_of(comparison, result)
        if request.output.suffix.lower() == ".parquet":
            date = datetime.date.today().isoformat()
            head = (
                f"table, written on {date}, of {result.name}, flight {comparison.flight} "
                f"(sha256 {comparison.sha256}), configuration {comparison.configuration}",
            )
            contents.append(parquet_bytes(columns, head))
        else:
            contents.append(csv_text(columns))
    for file, content in zip(files, contents, strict=True):
        write_whole(file, content, force=request.force)
    if request.as_json:
        show(json.dumps({"target": "table", "files": [str(file) for file in files]}, indent=1))
        return
    for file, comparison in zip(files, comparisons, strict=True):
        kind = "of the fit" if comparison.used_in_fit else "kept apart"
        show(f"{file}: wrenches of {comparison.flight} ({kind}), low-pass 3 Hz")
