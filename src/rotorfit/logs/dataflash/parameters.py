"""Read the vehicle of a DataFlash log: parameters, firmware, arming, when and in what air."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash.columns import columns, timed, vector
from rotorfit.logs.flight_log import Circumstances, in_air

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.logs.dataflash.messages import Messages

ARMED_EVENT, DISARMED_EVENT = 10, 11
"""Events of message EV."""
NAMES = ("PARM", "MSG", "ARM", "EV")


@frozen_dataclass
class Parameters:
    """The parameters of a log: the last values, and the names of those that changed."""

    values: Mapping[str, float]
    changed: tuple[str, ...]

    def number(self, name: str) -> float | None:
        """Read a parameter; those of motors and frame also as a quadplane names them (Q_)."""
        value = self.values.get(name)
        if value is None and name.startswith("MOT_"):
            value = self.values.get("Q_M_" + name.removeprefix("MOT_"))
        if value is None and name.startswith("FRAME_"):
            value = self.values.get("Q_" + name)
        return value if value is not None and np.isfinite(value) else None

    def integer(self, name: str) -> int | None:
        """Read a parameter that counts or chooses."""
        value = self.number(name)
        return None if value is None or abs(value) > 2**31 else round(value)


def read_parameters(messages: Messages) -> Parameters:
    """Read the parameters that the messages PARM hold."""
    found = columns(messages, "PARM", ("Name", "Value"))
    values: dict[str, float] = {}
    changed: dict[str, None] = {}
    if not found or found["Name"].dtype.kind != "S" or found["Value"].dtype.kind not in "fiu":
        return Parameters(values=values, changed=())
    for raw, value in zip(found["Name"].tolist(), found["Value"].tolist(), strict=True):
        name = raw.decode("latin-1")
        if name in values and values[name] != value:
            changed[name] = None
        values[name] = float(value)
    return Parameters(values=values, changed=tuple(changed))


def texts(messages: Messages) -> list[str]:
    """Read the firmware's text messages (MSG) in order."""
    found = columns(messages, "MSG", ("Message",))
    if not found or found["Message"].dtype.kind != "S":
        return []
    return [raw.split(b"\0", 1)[0].decode("latin-1") for raw in found["Message"].tolist()]


def arming(messages: Messages) -> tuple[Float[np.ndarray, " n"], list[bool]] | None:
    """Return when the vehicle was armed (true) or disarmed; None if the log does not say."""
    states = timed(messages, "ARM", ("ArmState",))
    if states is not None and len(states[0]):
        return states[0], [bool(state) for state in states[1]["ArmState"].tolist()]
    events = timed(messages, "EV", ("Id",))
    time, ids = (None, columns(messages, "EV", ("Id",)).get("Id"))
    if events is not None:
        time, ids = events[0], events[1]["Id"]
    if ids is None or ids.dtype.kind not in "iu":
        return None
    chosen = np.isin(ids, (ARMED_EVENT, DISARMED_EVENT))
    if not chosen.any():
        return None
    # Old firmware writes events without a time.
    at = np.full(len(ids), np.nan) if time is None else time
    return at[chosen], [number == ARMED_EVENT for number in ids[chosen].tolist()]


CIRCUMSTANCES: Final = ("BARO", "GPS")
KELVIN: Final = 273.15
GPS_EPOCH: Final = 315_964_800.0
"""Epoch of the satellites' weeks, seconds since 1970 (UTC)."""
LEAP_SECONDS: Final = 18.0
"""Seconds by which UTC is behind the satellites, since 2017."""
_WEEK: Final = 604_800.0
_BOARD: Final = re.compile(r"\S+ ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})\s*")
"""What the firmware says of its board when it starts: a name, and the number of the processor."""


def circumstances_of(
    messages: Messages, texts_of_firmware: Sequence[str], begin: float
) -> Circumstances:
    """Read the circumstances of a flight from its log."""
    boards = [found[1] for text in texts_of_firmware if (found := _BOARD.fullmatch(text))]
    pressure, temperature = _read_air(messages)
    return Circumstances(
        hardware=boards[0] if boards else "",
        started=_start_time(messages, begin),
        air_pressure=pressure,
        air_temperature=temperature,
    )


def _read_air(messages: Messages) -> tuple[float | None, float | None]:
    found = timed(messages, "BARO", ("Press", "Temp"))
    if found is None or len(found[0]) == 0:
        return None, None
    values = vector(found[1], ("Press", "Temp"))
    return in_air(values[:, 0], values[:, 1] + KELVIN)


def _start_time(messages: Messages, begin: float) -> float | None:
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
