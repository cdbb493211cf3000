"""A simulated experiment as a folder of files, written whole or not at all."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from rotorfit.errors import OutputError
from rotorfit.logs.files import write_whole
from rotorfit.simulation.experiment_files import EXPERIMENT_FILE, experiment_files, file_names
from rotorfit.simulation.experiments import SECONDS, Quality, ScenarioName, plan_experiment


def simulate(
    folder: Path,
    scenario: ScenarioName,
    variant: Quality = "real",
    *,
    seed: int = 1,
    seconds: float = SECONDS,
    force: bool = False,
) -> Path:
    """Fly an experiment of known truth, and write its logs and its experiment file.

    Parameters
    ----------
    folder
        Made where it is missing.
    scenario
        ``"paper"``: the experiment of Six et al. 2020. ``"single"``: one quad-x. ``"hexa"``: one
        hexa-x. ``"payload-pair"``: the quad-x bare, and with 0.1 kg at both ends of one arm.
    variant
        ``"clean"``: perfect sensors, motors as commanded. ``"lag"``: with the motors' lag.
        ``"noisy"``: and noise and bias of all sensors. ``"real"``: and gusts, drag, rotor inertia,
        unequal rotors, a battery that sags.
    seed
        The same seed gives the same files.
    seconds
        Of each flight between take-off and landing [s].
    force
        Replace files that are there.

    Returns
    -------
    Path
        The experiment file; the truth is beside it, in ``truth.json``.

    Raises
    ------
    ExperimentError
        If the flights would be too short to identify anything.
    OutputError
        If the folder holds some of the files and `force` is false, or cannot be written.
    """
    plan = plan_experiment(scenario, variant, seed=seed, seconds=seconds)
    there = [name for name in file_names(plan) if (folder / name).exists()]
    if there and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(there)}; name another folder, or force"
        )
    files = experiment_files(plan)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
    write_all(folder, files)
    return folder / EXPERIMENT_FILE


def write_all(folder: Path, files: Mapping[str, str]) -> None:
    """Write files beside their places first, then move all of them there.

    Raises
    ------
    OutputError
        If one cannot be written; none is then replaced.
    """
    unfinished = folder / ".unfinished"
    try:
        unfinished.mkdir(exist_ok=True)
        for name, content in files.items():
            write_whole(unfinished / name, content, force=True)
        for name in files:
            (unfinished / name).replace(folder / name)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder}: cannot be written ({reason}); name another") from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
