"""rotorfit export: a result as a file that another tool reads."""

from __future__ import annotations

import datetime
import json
import textwrap
import warnings
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, cast, get_args

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Assume,
    Force,
    OutputFile,
    ResultFile,
    print_result,
    refuse_output_file,
    refuse_output_folder,
    steps,
    terminal_width,
)
from rotorfit.errors import OutputError, RotorfitWarning
from rotorfit.export.targets import AnyTargetName, RandomTargetName, TargetName
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from rotorfit.export.into import Patched
    from rotorfit.export.result_numbers import Number
    from rotorfit.export.variants import Variants
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.validation.wrench_comparison import WrenchComparison

TARGETS: Final = get_args(AnyTargetName)
OTHER_NAMES: Final[dict[str, AnyTargetName]] = {
    "sdf": "gazebo", "mjcf": "mujoco", "xml": "mujoco", "csv": "table",
    "pybullet": "gym-pybullet-drones",
    "sih": "px4-sih", "sitl": "ardupilot-sitl", "isaac": "isaac-lab", "isaacsim": "isaac-lab",
}  # fmt: skip
"""Targets by the names of their files and programs, to whose letters another one is nearer."""


def target_named(name: str) -> str:
    """Return the name of a target; refuse an unknown one with the nearest."""
    if name in TARGETS:
        return name
    meant = OTHER_NAMES.get(name.lower())
    near = [meant] if meant else get_close_matches(name, TARGETS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    raise typer.BadParameter(f"no target {name!r}; {hint}targets: {', '.join(TARGETS)}")


Target = Annotated[
    AnyTargetName,
    typer.Option(
        "--to",
        metavar="TARGET",
        parser=target_named,
        autocompletion=lambda: list(TARGETS),
        help=f"Which tool's file: {', '.join(TARGETS)} (wrenches of the flights over time).",
    ),
]
Configuration = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Which to export; not needed if the result has only one."),
]
Project = Annotated[
    bool,
    typer.Option("--project", help="Replace an impossible inertia by the nearest possible one."),
]
Samples = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Number of vehicles to draw from the uncertainty of the result. If a file of the "
        "target holds one vehicle, -o names a folder (targets that hold many: default 100).",
    ),
]
Into = Annotated[
    Path | None,
    typer.Option(
        "--into",
        metavar="FILE",
        help="Your own file of parameters (px4, px4-gazebo, px4-sih, ardupilot, betaflight, "
        "indiflight) or SDF model (gazebo): -o gets it with what the export changes, which is "
        "shown. -o may name the same file, with --force.",
    ),
]
DrawSeed = Annotated[
    int, typer.Option(min=0, metavar="N", help="With --samples: another seed gives other vehicles.")
]


@frozen_dataclass
class _Written:
    """Where a target is written, and how that is reported."""

    target: str
    output: Path
    force: bool
    as_json: bool
    into: Path | None = None


def export(
    result: ResultFile,
    target: Target,
    output: OutputFile,
    configuration: Configuration = None,
    assume: Assume = None,
    project: Project = False,
    samples: Samples = None,
    seed: DrawSeed = 0,
    into: Into = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a result as a file of a simulator or autopilot.

    Refuses a target that needs numbers the flights do not determine, unless you supply them with
    --assume; marks weak numbers in the file.
    """
    from rotorfit.export.result_numbers import parse_assumptions
    from rotorfit.export.write import COUNT
    from rotorfit.results.sound_result import load_sound

    try:
        assumed = parse_assumptions(assume or [])
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--assume") from error
    is_random = target in get_args(RandomTargetName)
    if project and (is_random or samples is not None):
        raise typer.BadParameter(
            "--project is for one vehicle; drawn vehicles are physical already"
        )
    if into is not None and (is_random or samples is not None or target == "table"):
        raise typer.BadParameter("--into is for one vehicle's parameters")
    written = _Written(target=target, output=output, force=force, as_json=as_json, into=into)
    vehicle = {"configuration": configuration, "assumed": assumed}
    drawn = {**vehicle, "count": samples or COUNT, "seed": seed}
    if samples is not None and not is_random:
        if target == "table":
            raise typer.BadParameter("table is made of flights, and takes no --samples")
        _write_variants(load_sound(result), drawn, written)
        return
    refuse_output_file(output, inputs=[result], force=force)
    loaded = load_sound(result)
    if is_random:
        _write_randomised(loaded, drawn, written)
    elif target != "table":
        _write_vehicle(loaded, {**vehicle, "project": project}, written)
    elif assumed or project:
        raise typer.BadParameter("table is made of flights, and takes no --assume and no --project")
    else:
        _write_tables(loaded, configuration, result, written)


def _write_randomised(
    result: IdentificationResult, drawn: Mapping[str, Any], written: _Written
) -> None:
    """Write many vehicles into one file."""
    from rotorfit.export.write import randomised
    from rotorfit.logs.files import write_whole

    target = cast("RandomTargetName", written.target)
    content, variants = randomised(result, target, written.output, **drawn)
    write_whole(written.output, content, force=written.force)
    _report_drawn([written.output], variants, written)


def _write_variants(
    result: IdentificationResult, drawn: Mapping[str, Any], written: _Written
) -> None:
    """Write one file for each of many vehicles into a folder."""
    from rotorfit.export.write import variant_files
    from rotorfit.logs.files import write_whole

    files, variants = variant_files(result, cast("TargetName", written.target), **drawn)
    refuse_output_folder(written.output, files, force=written.force)
    for name, text in files.items():
        write_whole(written.output / name, text, force=written.force)
    _report_drawn([written.output / name for name in files], variants, written)


def _report_drawn(files: list[Path], variants: Variants, written: _Written) -> None:
    """Print which drawn vehicles were written, and the share of rejected draws."""
    from rotorfit.export.result_numbers import number_warnings
    from rotorfit.export.write import drawn_sentence

    model = variants.nominal
    if written.as_json:
        samples = variants.samples
        _print_json(
            target=written.target,
            files=[str(file) for file in files],
            configuration=model.configuration,
            count=len(variants.models),
            seed=samples.seed,
            rejected=samples.rejected,
            reasons=dict(samples.reasons),
            numbers=[_plain_number(n) for n in model.numbers],
            notes=list(model.notes),
        )
        return
    count = f", {len(files)} files" if len(files) > 1 else ""
    print_result(f"{written.output}: {written.target}, configuration {model.configuration}{count}")
    _print_remarks((drawn_sentence(variants), *number_warnings(model.numbers), *model.notes))


def _write_vehicle(
    result: IdentificationResult, vehicle: Mapping[str, Any], written: _Written
) -> None:
    from rotorfit.export.result_numbers import number_warnings
    from rotorfit.export.write import export
    from rotorfit.logs.files import write_whole

    exported = export(result, cast("TargetName", written.target), **vehicle)
    model = exported.model
    found = _put_into(exported.text, written)
    text = exported.text if found is None else found.text
    write_whole(written.output, text, force=written.force)
    changed = () if found is None else found.changed
    if written.as_json:
        _print_json(
            target=written.target,
            files=[str(written.output)],
            configuration=model.configuration,
            numbers=[_plain_number(n) for n in model.numbers],
            notes=list(model.notes),
            **({} if found is None else {"changed": [list(pair) for pair in changed]}),
        )
        return
    print_result(f"{written.output}: {written.target}, configuration {model.configuration}")
    if found is not None:
        print_result(_changes_text(found))
    _print_remarks((*number_warnings(exported.unsure), *model.notes))


def _put_into(text: str, written: _Written) -> Patched | None:
    """Put an exported file into the user's own; None if there is none."""
    from rotorfit.export.into import patched
    from rotorfit.logs.files import read_bytes

    if written.into is None:
        return None
    try:
        own = read_bytes(written.into).decode("utf-8")
        return patched(own, text, written.target)
    except UnicodeDecodeError as error:
        raise OutputError(f"{written.into}: no text, expected a file of parameters") from error
    except OutputError as error:
        raise OutputError(f"{written.into}: {error}") from error


def _changes_text(found: Patched) -> str:
    lines = [
        f"  {sign}{line}"
        for old, new in found.changed
        for sign, line in (("-", old), ("+", new))
        if line
    ]
    left = f"{found.same} as they were" if found.same else "all else as it was"
    return "\n".join([f"  {len(found.changed)} changed or added, {left}", *lines])


def _print_json(**described: Any) -> None:
    print_result(json.dumps(described, indent=1, allow_nan=False))


def _print_remarks(remarks: Iterable[str]) -> None:
    width = terminal_width()
    for line in remarks:
        print_result(textwrap.fill(line, width, initial_indent="  ", subsequent_indent="    "))


def _plain_number(number: Number) -> dict[str, Any]:
    keys = ("name", "value", "unit", "origin", "interval", "remark")
    return {key: getattr(number, key) for key in keys}


def _write_tables(
    result: IdentificationResult, configuration: str | None, source: Path, written: _Written
) -> None:
    """Write the wrenches of all flights to one file or to one file per flight; all or nothing."""
    from rotorfit.export.write import flight_comparisons, table_files
    from rotorfit.logs.files import write_whole

    with warnings.catch_warnings(), steps() as report_progress:
        warnings.simplefilter("ignore", RotorfitWarning)  # the result has them already
        report_progress("reading the flights again")
        comparisons = flight_comparisons(result, configuration)
    if not comparisons:
        raise OutputError(f"no flight of configuration {configuration!r} in the result")
    files = table_files(written.output, comparisons)
    for file in files:
        refuse_output_file(file, inputs=[source], force=written.force)
    contents = [_table_content(comparison, result, written.output) for comparison in comparisons]
    for file, content in zip(files, contents, strict=True):
        write_whole(file, content, force=written.force)
    if written.as_json:
        _print_json(target="table", files=[str(file) for file in files])
        return
    for file, comparison in zip(files, comparisons, strict=True):
        kind = "of the fit" if comparison.used_in_fit else "kept for validation"
        print_result(f"{file}: wrenches of {comparison.flight} ({kind}), low-pass 3 Hz")


def _table_content(
    comparison: WrenchComparison, result: IdentificationResult, output: Path
) -> str | bytes:
    """Format the wrenches of a flight as Parquet or CSV, by the suffix of the output."""
    from rotorfit.export.write import columns_of, csv_text, parquet_bytes

    columns = columns_of(comparison, result)
    if output.suffix.lower() != ".parquet":
        return csv_text(columns)
    date = datetime.date.today().isoformat()
    head = (
        f"table, written on {date}, of {result.name}, flight {comparison.flight} "
        f"(sha256 {comparison.sha256}), configuration {comparison.configuration}",
    )
    return parquet_bytes(columns, head)
