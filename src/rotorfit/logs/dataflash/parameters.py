"""What a DataFlash log says of the vehicle: parameters, messages of the firmware, arming."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rotorfit.logs.dataflash.columns import columns, timed
from rotorfit.logs.dataflash.messages import Messages

ARMED_EVENT, DISARMED_EVENT = 10, 11
"""Of message EV."""
NAMES = ("PARM", "MSG", "ARM", "EV")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """The parameters of a log.

    Attributes
    ----------
    values
        By name; the last value where one was changed.
    changed
        Names of those that have more than one value in the log.
    """

    values: Mapping[str, float]
    changed: tuple[str, ...]

    def number(self, name: str) -> float | None:
        """Return a parameter; those of motors and frame also as a quadplane names them (Q_)."""
        value = self.values.get(name)
        if value is None and name.startswith("MOT_"):
            value = self.values.get("Q_M_" + name.removeprefix("MOT_"))
        if value is None and name.startswith("FRAME_"):
            value = self.values.get("Q_" + name)
        return value if value is not None and np.isfinite(value) else None

    def integer(self, name: str) -> int | None:
        """Return a parameter that counts or chooses."""
        value = self.number(name)
        return None if value is None or abs(value) > 2**31 else round(value)


def read_parameters(messages: Messages) -> Parameters:
    """Return the parameters that the messages PARM hold."""
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
    """Return what the firmware said (messages MSG), in order."""
    found = columns(messages, "MSG", ("Message",))
    if not found or found["Message"].dtype.kind != "S":
        return []
    return [raw.split(b"\0", 1)[0].decode("latin-1") for raw in found["Message"].tolist()]


def arming(messages: Messages) -> tuple[Float[np.ndarray, " n"], list[bool]] | None:
    """Return when the vehicle was armed (true) or disarmed; None where the log does not say.

    Old firmware writes events without a time: those are NaN.
    """
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
    at = np.full(len(ids), np.nan) if time is None else time
    return at[chosen], [number == ARMED_EVENT for number in ids[chosen].tolist()]
