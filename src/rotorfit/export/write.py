"""A result as a file of another tool, written."""

from collections.abc import Mapping
from pathlib import Path

from rotorfit.errors import OutputError
from rotorfit.export.target_names import TargetName
from rotorfit.export.targets import export
from rotorfit.identification.result import IdentificationResult
from rotorfit.logs.files import write_whole


def refuse_special_file(path: Path) -> None:
    """Raise if a path is a device, a pipe or a socket, which writing would put a file in place of.

    Raises
    ------
    OutputError
        With what is there.
    """
    try:
        special = path.exists() and not (path.is_file() or path.is_dir())
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); name another") from error
    if special:
        raise OutputError(f"{path} is a device or a pipe, and no file; name a file")


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
        Whose file: ``"gazebo"``, ``"gazebo-motors"``, ``"px4"``, ``"px4-sih"``, ``"mujoco"``,
        ``"urdf"``, ``"rotorpy"``, ``"ardupilot-sitl"``, ``"crazyflow"`` or ``"casadi"``.
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
    refuse_special_file(path)
    made = export(result, target, configuration=configuration, assumed=assumed, project=project)
    write_whole(path, made.text, force=force)
    return made.text
