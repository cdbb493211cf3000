"""ArduPilot's own copter simulation: a JSON frame for  --model FRAME:file.json.

Source: ArduPilot, libraries/SITL/SIM_Frame.cpp and .h (load_frame_params: mass, diagonal_size,
moment_inertia [Ixx, Iyy, Izz], propExpo = MOT_THST_EXPO, hoverThrOut, num_motors, motorN_position,
motorN_yaw; what is not in the file keeps its default) and SIM_Motor.cpp (position from the CoM in
body FRD; torque about z = 0.05 diagonal_size yaw command thrust, positive for ccw; the command is
(output - spin_min) / (spin_max - spin_min), by default 0.15 and 0.95: spin_min is where the law
begins, spin_max where it ends, 1 if it is of the whole output). Comments begin with # as in
Tools/autotest/models; the reader begins at the first brace, even of a comment: none has one.
"""

import json
from collections.abc import Sequence

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.header import hash_comment, noted
from rotorfit.export.px4 import hover_thrust
from rotorfit.export.units import frd, listed, text
from rotorfit.export.vehicle import BODY, ROTORS, VehicleModel
from rotorfit.logs.speed_law import SpeedLaw
from rotorfit.model.layouts import layout_rotors
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve, command_range, thrust_curve

NEEDS = (*BODY, *ROTORS)
YAW_SCALE = 0.05
FRAMES = (
    ("x", "quad-x", "ardupilot"),
    ("+", "quad-plus", "ardupilot"),
    ("bfx", "quad-x", "betaflight"),
    ("hexax", "hexa-x", "ardupilot"),
    ("hexa", "hexa-plus", "ardupilot"),
)
"""Names of frames in SIM_Frame.cpp whose motors are in an order that rotorfit has, too."""
FRAME_ANGLE = 20.0
"""Rotors may be so far from where their frame has them [deg]: the file moves them."""


def write_ardupilot_sitl(model: VehicleModel, head: Sequence[str]) -> str:
    """Return the frame as JSON with comments."""
    frame = frame_of(model)
    radius = np.hypot(model.arms[:, 0], model.arms[:, 1])
    fields: dict[str, str] = {
        "mass": text(model.mass),
        "diagonal_size": text(2.0 * float(radius.mean())),
        "moment_inertia": listed(np.diag(model.inertia_com).tolist()),
        "num_motors": str(len(model.rotors)),
    }
    for i, arm in enumerate(model.arms, start=1):
        fields[f"motor{i}_position"] = listed(frd(arm).tolist())
    fields |= _thrust(model, 2.0 * float(radius.mean()))
    body = ",\n".join(f"    {json.dumps(name)}: {value}" for name, value in fields.items())
    comment = hash_comment(noted(head, *_remarks(model, frame)))
    comment = comment.translate(str.maketrans("{}", "()"))
    return comment + f"\n{{\n{body}\n}}\n"


def frame_of(model: VehicleModel) -> str:
    """Return the name of ArduPilot's frame whose motors stand and turn as these.

    Raises
    ------
    OutputError
        If it has none.
    """
    if model.vertical:
        for name, layout, order in FRAMES:
            if _fits(model, layout, order):
                return name
    known = ", ".join(f"{layout} ({order} order)" for _, layout, order in FRAMES)
    raise OutputError(
        "ArduPilot's simulator has no frame with these rotors in this order; it has "
        f"{known}, upright; export to gazebo instead"
    )


def _fits(model: VehicleModel, layout: str, order: str) -> bool:
    seats = layout_rotors(layout, arm=1.0, order=order)
    if len(seats) != len(model.rotors):
        return False
    arms = np.array([rotor.position for rotor in model.rotors])
    arms = arms - arms.mean(axis=0)
    for arm, rotor, seat in zip(arms, model.rotors, seats, strict=True):
        along = float(arm[:2] @ np.array(seat.position[:2])) / float(np.linalg.norm(arm[:2]))
        if along < np.cos(np.radians(FRAME_ANGLE)) or (seat.spin == "ccw") != (rotor.spin > 0):
            return False
    return True


def _thrust(model: VehicleModel, diagonal: float) -> dict[str, str]:
    """Return the thrust curve, hover throttle and yaw torque, where the law is known."""
    if model.law is None:
        return {}
    start, end = command_range(model.law)
    curve = _curve(model.law)
    hover = hover_thrust(model)
    scale = YAW_SCALE * diagonal * curve.command(hover)
    yaw = {
        f"motor{i}_yaw": text(rotor.spin * model.kd / rotor.kt / scale)
        for i, rotor in enumerate(model.rotors, start=1)
    }
    spin = {"spin_min": text(start), "spin_max": text(end)}
    return {"propExpo": text(curve.factor), "hoverThrOut": text(hover), **spin, **yaw}


def _curve(law: SpeedLaw) -> ThrustCurve:
    start, end = command_range(law)
    return thrust_curve(law, start=start, end=end)


def _remarks(model: VehicleModel, frame: str) -> list[str]:
    remarks = [
        f"start with  --model {frame}:THIS_FILE.json ; motors in the order of that frame",
        "positions from the CoM in body FRD [m]; moment_inertia about the CoM, its products have "
        "no place in ArduPilot's frame; what is not here keeps ArduPilot's default",
    ]
    if model.law is None:
        return [
            *remarks,
            "propExpo, hoverThrOut and yaw torque are left out: no law from command to rotor speed "
            "is known (law under [motors] of the experiment)",
        ]
    return [
        *remarks,
        f"propExpo is fitted to the law, within {100 * _curve(model.law).error:.2g} % of full "
        "thrust; spin_min to spin_max is the law's range of the output (PWM 1000 to 2000)",
        "yaw torque, in proportion to command times thrust there, is right in hover",
    ]
