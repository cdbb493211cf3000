"""Whose a DataFlash log is, when it began, and in what air."""

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from rotorfit.logs.dataflash.columns import timed, vector
from rotorfit.logs.dataflash.messages import Messages
from rotorfit.logs.flight_log import Circumstances, in_air

NAMES: Final = ("BARO", "GPS")
KELVIN: Final = 273.15
GPS_EPOCH: Final = 315_964_800.0
"""Of the satellites' weeks, seconds since 1970 (UTC)."""
LEAP_SECONDS: Final = 18.0
"""By which UTC is behind the satellites, since 2017."""
_WEEK: Final = 604_800.0
_BOARD: Final = re.compile(r"\S+ ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})\s*")
"""What the firmware says of its board when it starts: a name, and the number of the processor."""


def circumstances_of(messages: Messages, said: Sequence[str], begin: float) -> Circumstances:
    """Return what the log says of itself.

    Parameters
    ----------
    messages
        Of the log.
    said
        What the firmware said, in order.
    begin
        First sample of the log [s].
    """
    boards = [found[1] for text in said if (found := _BOARD.fullmatch(text))]
    pressure, temperature = _air(messages)
    return Circumstances(
        hardware=boards[0] if boards else "",
        started=_started(messages, begin),
        air_pressure=pressure,
        air_temperature=temperature,
    )


def _air(messages: Messages) -> tuple[float | None, float | None]:
    found = timed(messages, "BARO", ("Press", "Temp"))
    if found is None or len(found[0]) == 0:
        return None, None
    values = vector(found[1], ("Press", "Temp"))
    return in_air(values[:, 0], values[:, 1] + KELVIN)


def _started(messages: Messages, begin: float) -> float | None:
    """Return when the log began, by the clock of the satellites."""
    found = timed(messages, "GPS", ("GMS", "GWk"))
    if found is None:
        return None
    time, fields = found
    values = vector(fields, ("GMS", "GWk"))
    known = (values[:, 1] > 0) & np.isfinite(values).all(axis=1)
    if not known.any():
        return None
    clock = GPS_EPOCH + values[known, 1] * _WEEK + 1e-3 * values[known, 0] - LEAP_SECONDS
    return float(np.median(clock - time[known])) + begin
