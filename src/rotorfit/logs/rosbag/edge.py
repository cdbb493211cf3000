"""The one place where rosbags ends: whatever it raises is a LogError from here on.

On damaged files rosbags raises its own errors and, as they come, those of Python, NumPy, SQLite,
lz4 and zstd.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Final, ParamSpec, TypeVar

from rotorfit.errors import LogError

P = ParamSpec("P")
R = TypeVar("R")

_LONGEST: Final = 160


class DamageError(LogError):
    """What rosbags was given cannot be decoded; the cause says why."""


def require_rosbags() -> None:
    """Raise LogError where rosbags is not installed."""
    try:
        import_module("rosbags.interfaces")
    except ImportError as error:
        raise LogError("reading ROS bags needs rosbags: pip install 'rotorfit[ros]'") from error


def decoded(call: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Return what a function of rosbags, or of what it is built on, returns.

    Raises
    ------
    DamageError
        In place of whatever else is raised; memory and disk have answers of their own.
    """
    try:
        return call(*args, **kwargs)
    except (LogError, MemoryError):
        raise
    except Exception as error:
        # Of the disk's errors: bz2 has one of the same class, without a number.
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise DamageError(in_words(error)) from error


def in_words(error: BaseException) -> str:
    """Return one short line for an error; its text may quote what is no text."""
    try:
        text = " ".join(str(error).split())
    except UnicodeDecodeError:
        text = ""
    shown = "".join(letter if letter.isprintable() else "\ufffd" for letter in text[:_LONGEST])
    return f"{type(error).__name__}: {shown}" if shown else type(error).__name__
