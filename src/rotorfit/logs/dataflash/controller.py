"""The rate controller of an ArduPilot log: messages RATE and PARM."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.controller_log import TURNED, ControllerLog
from rotorfit.logs.dataflash import parameters
from rotorfit.logs.dataflash.columns import (
    timed,
    vector,
)

if TYPE_CHECKING:
    from pathlib import Path

    from rotorfit.logs.dataflash.messages import Messages

CONTROLLER_NAMES: Final = ("RATE", *parameters.NAMES)
"""Messages that have it."""
ASKED: Final = ("RDes", "PDes", "YDes")
MEASURED: Final = ("R", "P", "Y")
OUTPUT: Final = ("ROut", "POut", "YOut")
FAST: Final = 0.8
"""Share of SCHED_LOOP_RATE at which RATE must come: a run of the controller must not be missing."""


def controller_of(messages: Messages, path: Path) -> ControllerLog:
    """Read the rate controller of an ArduPilot log, whose messages have `CONTROLLER_NAMES`."""
    settings = parameters.read_parameters(messages)
    found = timed(messages, "RATE", (*ASKED, *MEASURED, *OUTPUT))
    if found is None or len(found[0]) < 2:
        raise LogError(
            f"{path}: the log has no RATE messages, in which the rate controllers are: set bit 0 "
            "(fast attitude) of LOG_BITMASK and fly again"
        )
    time, fields = found
    loop = settings.number("SCHED_LOOP_RATE") or 400.0
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < FAST * loop:
        raise LogError(
            f"{path}: RATE comes at {rate:.0f} Hz, the controllers run at {loop:.0f} Hz: set bit 0 "
            "(fast attitude) of LOG_BITMASK and fly again"
        )
    asked, measured = (np.deg2rad(vector(fields, labels)) for labels in (ASKED, MEASURED))
    version = next((t for t in parameters.texts(messages) if t.startswith("Ardu")), "unknown")
    return ControllerLog(
        autopilot="ArduCopter",
        firmware=version,
        parameters=settings.values,
        changed=settings.changed,
        time=time[1:],
        # Controllers run before the loop makes the set point that is logged with them.
        set_point=asked[:-1] * TURNED,
        rate=measured[1:] * TURNED,
        output=vector(fields, OUTPUT)[1:] * TURNED,
    )
