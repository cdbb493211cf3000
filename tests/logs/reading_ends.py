"""How reading a file of any bytes must end: in a sound log, or in one line that names the file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.flight_log import CHANNELS, Channel, FlightLog
from rotorfit.logs.read import read_log


def ended(path: Path, read: Callable[[Path], FlightLog] = read_log) -> FlightLog | str:
    """Return the log, or the message of the refusal; whatever else is raised fails."""
    try:
        return read(path)
    except LogError as error:
        return str(error)


def faults(path: Path, end: FlightLog | str, *, ordered: bool = True) -> list[str]:
    """List what is wrong with an end: a message, or the unsound channels of a log.

    `ordered`: the reader puts times in order, which preparation does in any case.
    """
    if isinstance(end, str):
        return [] if str(path) in end and "\n" not in end else [end]
    return [name for name, channel in end.channels.items() if not sound(name, channel, ordered)]


def sound(name: str, channel: Channel, ordered: bool) -> bool:
    """Return whether times and values are such as a log may hold."""
    time, values = channel.time, channel.values
    return bool(
        values.dtype == np.float64
        and values.shape == (len(time), CHANNELS[name][0] or values.shape[1])
        and np.isfinite(time).all()
        and (not ordered or (np.diff(time) >= 0).all())
        and not np.isinf(values).any()
    )
