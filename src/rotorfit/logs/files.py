"""Whole files: their bytes and their fingerprint, with errors that a person can act on."""

import hashlib
from pathlib import Path

from rotorfit.errors import LogError


def read_bytes(path: Path) -> bytes:
    """Return everything in a file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bytes
        At least one byte.

    Raises
    ------
    LogError
        If there is no such file, it is a directory, it is empty, or it may not be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file: check the path") from error
    except IsADirectoryError as error:
        raise LogError(
            f"{path}: is a directory, expected a log file: name the file in it"
        ) from error
    except PermissionError as error:
        raise LogError(f"{path}: permission denied: make the file readable") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise LogError(f"{path}: cannot be read ({error}): check the path and the disk") from error
    if not data:
        raise LogError(f"{path}: is empty (0 bytes), expected a flight log: copy it again")
    return data


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    LogError
        As `read_bytes`.
    """
    return hashlib.sha256(read_bytes(path)).hexdigest()
