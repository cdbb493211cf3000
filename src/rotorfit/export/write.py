"""A result as a file of another tool, written."""

from collections.abc import Mapping
from pathlib import Path

from rotorfit.export.target_names import TargetName
from rotorfit.export.targets import export
from rotorfit.logs.files import write_whole
from rotorfit.results.result import IdentificationResult


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
