"""rotorfit simulate: fly a scenario of known truth, and leave the files of an experiment."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rotorfit.cli.outputs import refuse_output_folder
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import say, show
from rotorfit.simulation.experiment_files import (
    EXPERIMENT_FILE,
    experiment_files,
    file_names,
    write_all,
)
from rotorfit.simulation.experiments import (
    SECONDS,
    ExperimentPlan,
    Quality,
    ScenarioName,
    plan_experiment,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateRequest:
    """What the user asked for, as the command line gave it."""

    scenario: ScenarioName
    output: Path
    variant: Quality = "real"
    seed: int = 1
    seconds: float = SECONDS
    force: bool = False
    as_json: bool = False


def run(request: SimulateRequest) -> None:
    """Fly, write the files, and say which."""
    plan = plan_experiment(
        request.scenario, request.variant, seed=request.seed, seconds=request.seconds
    )
    with steps() as tell:
        names = simulate_into(request.output, plan, force=request.force, progress=tell)
    if request.as_json:
        show(json.dumps({"folder": str(request.output), "files": names}, indent=1))
        return
    show(f"wrote {', '.join(names)} to {request.output}")
    say(f"next: rotorfit identify {request.output / EXPERIMENT_FILE}")


def simulate_into(
    folder: Path, plan: ExperimentPlan, *, force: bool, progress: Callable[[str], None]
) -> list[str]:
    """Fly an experiment and write its files into a folder, all or none; return their names.

    Raises
    ------
    OutputError
        If the folder holds some of the files and may not lose them, or cannot be written.
    """
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
