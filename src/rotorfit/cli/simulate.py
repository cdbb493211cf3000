"""rotorfit simulate: fly a scenario of known truth, and leave the files of an experiment."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Force,
    Seed,
    print_result,
    print_status,
    refuse_output_folder,
    steps,
)

if TYPE_CHECKING:
    from rotorfit.simulation.experiments import ExperimentPlan


def simulate(
    scenario: Annotated[
        Literal["paper", "single", "hexa", "payload-pair"],
        typer.Argument(
            metavar="SCENARIO",
            help="paper: vehicles A and B of Six et al. 2020; single: a quadrotor; hexa: six "
            "rotors; payload-pair: bare and with a known payload.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for flights, experiment and truth."
        ),
    ],
    variant: Annotated[
        Literal["clean", "lag", "noisy", "real"],
        typer.Option(
            help="clean: perfect; lag: motors with a known lag; noisy: and sensor noise and bias; "
            "real: and gusts, drag, rotor inertia, unequal rotors, measured rotor speed."
        ),
    ] = "real",
    seed: Seed = 1,
    seconds: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Of each flight, between take-off and landing [s]."),
    ] = 75.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate flights with known truth, to try things on.

    Writes flight logs, an experiment file ready for identify, and the truth.
    """
    from rotorfit.simulation.experiment_files import EXPERIMENT_FILE
    from rotorfit.simulation.experiments import plan_experiment

    plan = plan_experiment(scenario, variant, seed=seed, seconds=seconds)
    with steps() as report_progress:
        names = simulate_into(output, plan, force=force, progress=report_progress)
    if as_json:
        print_result(json.dumps({"folder": str(output), "files": names}, indent=1))
        return
    print_result(f"wrote {', '.join(names)} to {output}")
    print_status(f"next: rotorfit identify {output / EXPERIMENT_FILE}")


def simulate_into(
    folder: Path, plan: ExperimentPlan, *, force: bool, progress: Callable[[str], None]
) -> list[str]:
    """Fly an experiment and write its files into a folder, all or none; return their names."""
    from rotorfit.simulation.experiment_files import experiment_files, file_names, write_all

    is_new = not folder.exists()
    refuse_output_folder(folder, file_names(plan), force=force)
    try:
        files = experiment_files(plan, progress=progress)
        write_all(folder, files)
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise
    return list(files)
