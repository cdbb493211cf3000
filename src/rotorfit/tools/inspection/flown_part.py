"""Prepare the flight of a log whose airframe nobody has described."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from rotorfit.errors import FlightError, LogError
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.flight.motors.motor_model import MotorModel, MotorResponse
from rotorfit.flight.prepare import PreparedFlight, prepare
from rotorfit.logs.formats import BY_NAME
from rotorfit.model.vehicle import LAYOUTS
from rotorfit.tools.inspection.motor_lateness import LATEST, SEARCHED

if TYPE_CHECKING:
    from rotorfit.logs.flight_log import FlightLog

NAMED_LAYOUT: Final = re.compile(
    r'layout = "(?P<layout>[^"]+)", order = "(?P<order>[^"]+)"(?P<turned> with every spin rev)?'
)
"""How `prospects` names the motors that a flight confirms."""
SPINS_UNSURE: Final = "spins unsure: yaw hardly moves"
"""How `prospects` says that the flight does not show the spins."""
GUESSED_ARM: Final = 0.15
"""Only a scale to separate flight from ground, where no airframe is given [m]."""
NEEDED: Final = ("gyro", "accel")


def is_posed(log: FlightLog) -> bool:
    """Test whether a log without a whole IMU has motors and poses to take the motion from."""
    present = log.channels.keys()
    posed = {"position", "attitude"} <= present and bool({"rotor_speed", "command"} & present)
    return posed and not all(name in present for name in NEEDED)


def prepare_if_usable(log: FlightLog) -> tuple[PreparedFlight | None, str | None]:
    """Prepare the flight of a log with motors and IMU, or say why that fails."""
    motors = {"rotor_speed", "command"} & log.channels.keys()
    if not motors or not all(name in log.channels for name in NEEDED):
        return None, None
    try:
        return _prepare_log(log), None
    except (LogError, FlightError) as error:
        return None, str(error)


def _prepare_log(log: FlightLog) -> PreparedFlight:
    """Prepare a log with whatever motors it has; commands by the law that the log states."""
    measured = "rotor_speed" in log.channels
    motors = log.channels["rotor_speed" if measured else "command"]
    if measured:
        model = MotorModel(speed="measured")
    elif log.motors is None:
        model = MotorModel(speed="commanded")
    else:
        lag_on = log.motors.lag_on or "speed"
        model = MotorModel(speed="commanded", law=log.motors.law, lag_on=lag_on)
    return prepare(log, rotor_count=motors.values.shape[1], arm=GUESSED_ARM, motors=model)


def expected_response(log: FlightLog, late: float | None) -> MotorResponse | None:
    """Return the motors' timing of the forecast: commands are followed with a lag."""
    if late is None:
        return None
    if "rotor_speed" in log.channels:
        return MotorResponse(delay=late)
    if -SEARCHED <= late <= 0.0:
        return None  # no motor responds before its command: an autopilot does, nobody steers
    # No motor is so slow: the clocks are apart, and that is not to be taken for a lag.
    lag = min(max(late, 0.0), LAG_PRIOR[0] if late > LATEST else LATEST)
    return MotorResponse(lag=lag, delay=late - lag)


def tried_response(motors: MotorResponse | None, *, commanded: bool) -> MotorResponse | None:
    """Return the timing at which a flight is looked at first; commands need a lag."""
    return MotorResponse(lag=LAG_PRIOR[0]) if motors is None and commanded else motors


def name_in_usual_order(log: FlightLog, motors: str) -> str:
    """Name a motor order by the log's autopilot, where the two are the same."""
    form, found = BY_NAME.get(log.format), NAMED_LAYOUT.search(motors)
    usual = form.motor_order if form is not None else None
    if found is None or usual is None:
        return motors
    layout, order = found["layout"], found["order"]
    if LAYOUTS.get((layout, usual)) != LAYOUTS[layout, order]:
        return motors
    return motors.replace(f'order = "{order}"', f'order = "{usual}"')
