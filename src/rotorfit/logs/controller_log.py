"""Reference, measured rates and outputs of an autopilot's rate controller, with its parameters."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import read_head
from rotorfit.logs.formats import Format, load
from rotorfit.logs.read import format_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.logs.flight_log import FlightLog

TURNED: Final = np.array([1.0, -1.0, -1.0])
"""Signs from FRD to FLU."""


@frozen_dataclass
class ControllerLog:
    """Signals of the rate controller in one flight, a row per run, body axes FLU.

    - `autopilot`, `firmware`: whose controller it is, and its version in the log's words.
    - `parameters`: by their names, as the log left them.
    - `changed`: names of those that changed in the log.
    - `time`: when the controller ran [s].
    - `set_point`, `rate`: rates that it used: the reference, and of the gyro behind the filters on
      board [rad/s].
    - `output`: torque that it asked the mixer for, in parts of full output.
    - `set_point_std`: deviation of the time at which a set point came [s]; 0 where the log has it.
    - `slope`: derivative of the rate as the controller used it [rad/s^2]; None where it makes its
      own.
    """

    autopilot: Literal["PX4", "ArduCopter"]
    firmware: str
    parameters: Mapping[str, float]
    changed: tuple[str, ...]
    time: Float[np.ndarray, " n"]
    set_point: Float[np.ndarray, "n 3"]
    rate: Float[np.ndarray, "n 3"]
    output: Float[np.ndarray, "n 3"]
    set_point_std: float = 0.0
    slope: Float[np.ndarray, "n 3"] | None = None

    @property
    def period(self) -> float:
        """Between two runs of the controller, median [s]."""
        return float(np.median(np.diff(self.time)))

    def number(self, name: str) -> float:
        """Read a parameter.

        Raises `LogError` if the log does not have it.
        """
        if name not in self.parameters:
            raise LogError(
                f"the log has no parameter {name}, which the controller of {self.autopilot} needs: "
                "give a log with its parameters, as it comes from the autopilot"
            )
        return self.parameters[name]


def read_with_controller(path: Path) -> tuple[FlightLog, ControllerLog]:
    """Read the flight in a log and what its rate controller did, in one pass.

    Raises `LogError` if the file is no log, or rotorfit does not know the controller that flew.
    """
    form = format_of(path)
    if form is None:
        raise LogError(f"{path}: no flight log that rotorfit reads")
    if not form.with_controller:
        raise LogError(f"{path}: {why_unknown(path, form)}")
    return load(form.with_controller)(path)


def knows_controller(path: Path) -> bool:
    """Return whether rotorfit knows rate controllers of a log's format."""
    form = format_of(path)
    return form is None or bool(form.with_controller)


def why_unknown(path: Path, form: Format) -> str:
    """State what is missing to judge the loop of a log whose controller rotorfit does not know."""
    if form.name == "crazyflie":
        return MISSING["crazyflie"]
    found = FIRMWARE.search(read_head(path, HEADER)) if form.name == "blackbox" else None
    name = found[1].decode("ascii", "replace").lower() if found else ""
    return MISSING.get(
        name,
        f"{form.title}: the rate controller is not in the log; rotorfit knows those of PX4 (ULog) "
        "and ArduCopter (DataFlash)",
    )


HEADER: Final = 65536
"""Bytes in which a Blackbox names its firmware."""
FIRMWARE: Final = re.compile(rb"H Firmware revision:(\w+)")
MISSING: Final = {
    "betaflight": "the rate loop of Betaflight is not linear (I is relaxed in turns, D falls to "
    "its minimum in calm flight, TPA takes gains back with the throttle); it takes a chirp in "
    "flight to measure it, which rotorfit does not read, so it gives no margins",
    "inav": "the rate loop of INAV is not linear (I is relaxed in turns, D is boosted, TPA takes "
    "gains back with the throttle); it takes a chirp in flight to measure it, which rotorfit does "
    "not read, so it gives no margins",
    "indiflight": "INDIflight has no PID but inverts the vehicle by measured angular "
    "accelerations; it takes a chirp in flight to measure that loop, which rotorfit does not read, "
    "so it gives no margins",
    "crazyflie": "a Crazyflie's log has neither gains nor filters nor the outputs of the rate "
    "controllers, so rotorfit gives no margins",
}
"""The knowledge that is missing to judge a rate loop, by firmware."""
