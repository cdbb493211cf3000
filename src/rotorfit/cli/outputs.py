"""Refuse what cannot be written before the work begins, not after it."""

from collections.abc import Iterable
from pathlib import Path

from rotorfit.errors import OutputError
from rotorfit.logs.files import refuse_special_file


def refuse_output_file(path: Path, *, inputs: Iterable[Path], force: bool) -> None:
    """Raise if a file exists, is one of the inputs, or has no folder to be in."""
    try:
        if path.is_dir():
            raise OutputError(f"{path} is a folder; name a file in it")
        refuse_special_file(path)
        if not path.parent.is_dir():
            raise OutputError(f"{path}: there is no folder {path.parent}; make it first")
        if any(path.exists() and source.exists() and path.samefile(source) for source in inputs):
            raise OutputError(f"{path} is an input of this command; name another file")
        exists = path.exists()
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); name another") from error
    if exists and not force:
        raise OutputError(f"{path} exists; choose another name, or pass --force to overwrite it")


def refuse_output_folder(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Make a folder where it is missing; raise if it cannot be, or holds files of these names."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = [name for name in names if (folder / name).exists()]
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
    if there and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(there)}; name another folder, or pass --force"
        )
