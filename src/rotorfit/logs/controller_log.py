"""What an autopilot's rate controller was asked, heard and put out, with its parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.errors import LogError
from rotorfit.logs.formats import load
from rotorfit.logs.read import format_of

TURNED: Final = np.array([1.0, -1.0, -1.0])
"""From FRD to FLU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerLog:
    """The rate controller of one flight, one row a run of it, body axes FLU.

    Attributes
    ----------
    autopilot, firmware
        Whose controller it is, and its version in the log's words.
    parameters
        By their names, as the log left them.
    changed
        Names of those that changed in the log.
    time
        When the controller ran [s].
    set_point, rate
        Rates that it used: asked for, and heard from the gyro behind the filters on board [rad/s].
    output
        Torque that it asked the mixer for, in parts of full output.
    set_point_std
        Deviation of the time at which a set point came [s]; 0 where the log has it.
    slope
        Derivative of the rate as the controller used it [rad/s^2]; None where it makes its own.
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

        Raises
        ------
        LogError
            If the log does not have it.
        """
        if name not in self.parameters:
            raise LogError(
                f"the log has no parameter {name}, which the controller of {self.autopilot} needs: "
                "give a log with its parameters, as it comes from the autopilot"
            )
        return self.parameters[name]


def read_controller_log(path: Path) -> ControllerLog:
    """Read what the rate controller of a log did.

    Raises
    ------
    LogError
        If the file is no log, or rotorfit does not know the controller that flew.
    """
    form = format_of(path)
    if form is None:
        raise LogError(f"{path}: no flight log that rotorfit reads")
    if not form.controller:
        raise LogError(
            f"{path}: {form.title}: the rate controller of this firmware is not in rotorfit; PX4 "
            "(ULog) and ArduCopter (DataFlash) are. " + WHY_NOT.get(form.name, "")
        )
    return load(form.controller)(path)


WHY_NOT: Final = {
    "blackbox": "Its loop is not linear (relaxed I, dynamic D, attenuated by throttle), and the "
    "log lacks a chirp to measure it by: rotorfit identify gives effectiveness and delays",
    "crazyflie": "The log has neither gains nor the controller's outputs: rotorfit identify gives "
    "effectiveness and delays",
}
