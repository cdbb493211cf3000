"""Battery, pose, velocity and rates asked for of a DataFlash log, turned from NED and FRD."""

from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.logs.axes import (
    attitude_from_euler,
    attitude_to_flu,
    vectors_to_flu,
    world_to_body,
)
from rotorfit.logs.dataflash.columns import first_label, format_named, has_fields, timed, vector
from rotorfit.logs.dataflash.messages import Messages
from rotorfit.logs.flight_log import Channel

NAMES: Final = ("BAT", "CURR", "VISP", "ATT", "XKF1", "NKF1", "EKF1", "RATE")
_ESTIMATES: Final = ("XKF1", "NKF1", "EKF1")
_VISION_ANGLES: Final = (("Roll", "Pitch", "Yaw"), ("R", "P", "Y"))
_ANGLES: Final = ("Roll", "Pitch", "Yaw")
_VELOCITY: Final = ("VN", "VE", "VD")
_RATES: Final = ("RDes", "PDes", "YDes")
_DEGREE: Final = np.pi / 180.0


def read_battery(messages: Messages) -> Channel | None:
    """Read the voltage of the first battery [V]."""
    for name in ("BAT", "CURR"):
        form = format_named(messages, name)
        if form is None or "Volt" not in form.fields:
            continue
        number = first_label(messages, name, ("Instance", "Inst", "I"))
        found = timed(messages, name, ("Volt", number) if number else ("Volt",))
        if found is None or len(found[0]) == 0:
            continue
        time, fields = found
        first = np.ones(len(time), dtype=bool) if number is None else fields[number] == 0
        # Before version 3.4 a plain integer of centivolts.
        factor = 0.01 if form.fields["Volt"].letter in "hH" else 1.0
        values = vector(fields, ("Volt",), factor=factor)
        if first.any():
            words = f"{name}.Volt [{'0.01 V' if factor != 1.0 else 'V'}]"
            return Channel(time=time[first], values=values[first], source=words)
    return None


def read_pose(messages: Messages) -> dict[str, Channel]:
    """Read position and attitude from a camera system (VISP), else the attitude on board."""
    for angles in _VISION_ANGLES:
        found = timed(messages, "VISP", ("PX", "PY", "PZ", *angles))
        if found is not None and len(found[0]):
            time, fields = found
            place = vectors_to_flu(vector(fields, ("PX", "PY", "PZ")), "FRD")
            source = "VISP.PX,PY,PZ [m], north-east-down turned to north-west-up"
            attitude = _attitude(fields, angles)
            words = f"VISP.{','.join(angles)} [deg], FRD turned to FLU"
            return {
                "position": Channel(time=time, values=place, source=source),
                "attitude": Channel(time=time, values=attitude, source=words),
            }
    found = timed(messages, "ATT", _ANGLES)
    if found is None or len(found[0]) == 0:
        return {}
    words = "ATT.Roll,Pitch,Yaw [deg], FRD turned to FLU, estimate on board"
    return {"attitude": Channel(time=found[0], values=_attitude(found[1], _ANGLES), source=words)}


def _attitude(fields: dict[str, np.ndarray], angles: tuple[str, ...]) -> Float[np.ndarray, "n 4"]:
    return attitude_to_flu(attitude_from_euler(vector(fields, angles, factor=_DEGREE)), "FRD")


def read_velocity(messages: Messages) -> Channel | None:
    """Read the velocity of the estimator's first core, body axes [m/s]."""
    for name in _ESTIMATES:
        labels = (*_VELOCITY, *_ANGLES)
        core = ("C",) if has_fields(messages, name, ("C",)) else ()
        found = timed(messages, name, (*labels, *core))
        if found is None or len(found[0]) == 0:
            continue
        time, fields = found
        first = fields["C"] == 0 if core else np.ones(len(time), dtype=bool)
        world = vectors_to_flu(vector(fields, _VELOCITY), "FRD")
        body = world_to_body(world, _attitude(fields, _ANGLES))
        source = f"{name}.VN,VE,VD [m/s], turned into the body by its angles"
        return Channel(time=time[first], values=body[first], source=source)
    return None


def read_reference(messages: Messages) -> Channel | None:
    """Read the rates that the rate controllers were asked for, body axes [rad/s]."""
    found = timed(messages, "RATE", _RATES)
    if found is None or len(found[0]) == 0:
        return None
    time, fields = found
    # Logs with a clock in milliseconds are of the time of centidegrees.
    per_degree = 100.0 if has_fields(messages, "RATE", ("TimeMS",)) else 1.0
    values = vectors_to_flu(vector(fields, _RATES, factor=_DEGREE / per_degree), "FRD")
    words = f"RATE.RDes,PDes,YDes [{'0.01 ' if per_degree > 1.0 else ''}deg/s], FRD turned to FLU"
    return Channel(time=time, values=values, source=words)
