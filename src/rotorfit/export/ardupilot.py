"""ArduPilot: the parameters of the motors' law for a real Copter, and a frame of its simulation.

Sources for the Copter: ArduPilot, libraries/AP_Motors/AP_Motors_Thrust_Linearization.cpp (relative
thrust f u^2 + (1 - f) u of a command u from MOT_SPIN_MIN to MOT_SPIN_MAX, f = MOT_THST_EXPO) and
AP_MotorsMulticopter.cpp (MOT_THST_HOVER: hover thrust over full, 0.125 to 0.6875).

For the simulation, a JSON frame for  --model FRAME:file.json: libraries/SITL/SIM_Frame.cpp and .h
(load_frame_params: mass, diagonal_size, moment_inertia [Ixx, Iyy, Izz], propExpo = MOT_THST_EXPO,
hoverThrOut, num_motors, motorN_position, motorN_yaw; what is not in the file keeps its default) and
SIM_Motor.cpp (position from the CoM in body FRD; torque about z = 0.05 diagonal_size yaw command
thrust, positive for ccw; the command is (output - spin_min) / (spin_max - spin_min), by default
0.15 and 0.95: spin_min is where the law begins, spin_max where it ends, 1 if it is of the whole
output). Comments begin with # as in Tools/autotest/models; the reader begins at the first brace,
even of a comment: none has one.
"""

import json
from collections.abc import Sequence
from typing import Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import frd, hash_comment, listed, text, with_notes
from rotorfit.export.vehicle import VehicleModel, required_law
from rotorfit.logs.speed_law import SpeedLaw
from rotorfit.model.layouts import layout_rotors
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve, command_range, thrust_curve

HOVER_RANGE: Final = (0.125, 0.6875)
YAW_SCALE: Final = 0.05
FRAMES: Final = (
    ("x", "quad-x", "ardupilot"),
    ("+", "quad-plus", "ardupilot"),
    ("bfx", "quad-x", "betaflight"),
    ("hexax", "hexa-x", "ardupilot"),
    ("hexa", "hexa-plus", "ardupilot"),
)
"""Names of frames in SIM_Frame.cpp whose motors are in an order that rotorfit has, too."""
FRAME_ANGLE: Final = 20.0
"""Rotors may be so far from where their frame has them [deg]: the file moves them."""


def write_ardupilot(model: VehicleModel, head: Sequence[str]) -> str:
    """Write a parameter file, as ground stations and MAVProxy load it."""
    law = required_law(model, "ardupilot")
    start, end = command_range(law)
    curve = _curve(law)
    hover = model.hover_thrust
    lines = [("MOT_THST_EXPO", curve.factor)]
    remarks = [
        f"MOT_THST_EXPO is fitted to the law from {start:.3g} to {end:.3g} of the motor output, "
        f"within {100 * curve.error:.2g} % of full thrust; it goes with MOT_SPIN_MIN near "
        f"{start:.3g} and MOT_SPIN_MAX near {end:.3g}",
        "the law is of the output that the log has: MOT_BAT_VOLT_MAX and MIN, where they are set, "
        "scale it before",
    ]
    if HOVER_RANGE[0] <= hover <= HOVER_RANGE[1]:
        lines.append(("MOT_THST_HOVER", hover))
    else:
        remarks.append(
            f"MOT_THST_HOVER would be {hover:.3g}, which ArduPilot does not take "
            f"({HOVER_RANGE[0]:g} to {HOVER_RANGE[1]:g}): left out"
        )
    return hash_comment(with_notes(head, *remarks)) + "".join(
        f"{name},{text(value)}\n" for name, value in lines
    )


def write_ardupilot_sitl(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the frame as JSON with comments."""
    frame = _frame_of(model)
    diagonal = 2.0 * model.mean_arm
    fields: dict[str, str] = {
        "mass": text(model.mass),
        "diagonal_size": text(diagonal),
        "moment_inertia": listed(np.diag(model.inertia_com).tolist()),
        "num_motors": str(len(model.rotors)),
    }
    for i, arm in enumerate(model.arms, start=1):
        fields[f"motor{i}_position"] = listed(frd(arm).tolist())
    fields |= _thrust(model, diagonal)
    body = ",\n".join(f"    {json.dumps(name)}: {value}" for name, value in fields.items())
    comment = hash_comment(with_notes(head, *_remarks(model, frame)))
    comment = comment.translate(str.maketrans("{}", "()"))
    return comment + f"\n{{\n{body}\n}}\n"


def _frame_of(model: VehicleModel) -> str:
    """Select ArduPilot's frame whose motors stand and turn as these; OutputError without one."""
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
    for arm, rotor, seat in zip(model.arms_from_middle, model.rotors, seats, strict=True):
        along = float(arm[:2] @ np.array(seat.position[:2])) / float(np.linalg.norm(arm[:2]))
        if along < np.cos(np.radians(FRAME_ANGLE)) or (seat.spin == "ccw") != (rotor.spin > 0):
            return False
    return True


def _thrust(model: VehicleModel, diagonal: float) -> dict[str, str]:
    """Write the thrust curve, hover throttle and yaw torque, where the law is known."""
    if model.law is None:
        return {}
    start, end = command_range(model.law)
    curve = _curve(model.law)
    hover = model.hover_thrust
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
