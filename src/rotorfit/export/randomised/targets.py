"""The targets of drawn vehicles by name, and the way from a result to their files."""

import datetime
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from rotorfit.export.header import header_lines
from rotorfit.export.randomised import crazyflow_worlds, isaac_lab, pegasus, samples_file
from rotorfit.export.randomised.variants import Variants, variants
from rotorfit.export.target_names import SUFFIXES, RandomTargetName, TargetName
from rotorfit.export.targets import TARGETS, export
from rotorfit.export.vehicle_model import vehicle_model
from rotorfit.results.result import IdentificationResult

NEEDS: Final[Mapping[RandomTargetName, tuple[str, ...]]] = {
    "samples": samples_file.NEEDS,
    "isaac-lab": isaac_lab.NEEDS,
    "pegasus": pegasus.NEEDS,
    "crazyflow-worlds": crazyflow_worlds.NEEDS,
}
COUNT: Final = 100
"""Vehicles, where nobody says how many."""


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
    """Return drawn vehicles as the content of a file, and the vehicles.

    Parameters
    ----------
    result
        What `identify` returned, or `IdentificationResult.load`.
    target
        Whose file.
    path
        Of the file; its suffix says the form of ``samples``.
    configuration, assumed, date
        As for `rotorfit.export.targets.export`.
    count, seed
        Of the draws.

    Raises
    ------
    OutputError, EstimationError
        If something that the file needs is not known, or hardly a draw can exist.
    """
    suffix = path.suffix.lower()
    if target == "samples":
        samples_file.refuse_suffix(suffix)
    nominal = vehicle_model(
        result, configuration=configuration, needs=NEEDS[target], assumed=assumed
    )
    found = variants(result, nominal, count=count, seed=seed)
    if target == "samples":
        return samples_file.samples_bytes(found, result, suffix=suffix), found
    when = date or datetime.date.today()
    head = [*header_lines(nominal, result, target=target, date=when), *drawn_words(found)]
    match target:
        case "isaac-lab":
            return isaac_lab.isaac_lab_ranges(found, head), found
        case "pegasus":
            return pegasus.pegasus_vehicles(found, head), found
        case _:
            return crazyflow_worlds.crazyflow_worlds(found, head), found


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
    """Return one file of a tool for each drawn vehicle, by name, and the vehicles.

    The arguments are those of `randomised`.
    """
    when = date or datetime.date.today()
    whole = export(result, target, configuration=configuration, assumed=assumed, date=when)
    found = variants(result, whole.model, count=count, seed=seed)
    digits = len(str(count))
    files: dict[str, str] = {}
    for i, model in enumerate(found.models, 1):
        note = f"vehicle {i} of {count} drawn from the joint posterior, seed {seed}"
        drawn = replace(model, notes=(*model.notes, note))
        head = header_lines(drawn, result, target=target, date=when)
        text = TARGETS[target].write(drawn, head)
        files[f"{target}-{i:0{digits}}{SUFFIXES[target]}"] = text
    return files, found


def drawn_words(found: Variants) -> list[str]:
    """Return how the vehicles were drawn, in words."""
    why = "".join(f" ({words}: {100 * s:.2g} %)" for words, s in found.samples.reasons.items())
    return [
        f"{len(found.models)} vehicles drawn from the joint posterior, seed {found.samples.seed}; "
        f"{100 * found.samples.rejected:.2g} % of the draws rejected{why}"
    ]
