"""ArduPilot: the parameters of frame and motors for a Copter, and a frame of its simulation.

Sources for the Copter: ArduPilot, libraries/AP_Motors/AP_Motors_Thrust_Linearization.cpp (relative
thrust f u^2 + (1 - f) u of a command u from MOT_SPIN_MIN to MOT_SPIN_MAX, f = MOT_THST_EXPO),
AP_MotorsMulticopter.cpp (MOT_THST_HOVER: hover thrust over full, 0.125 to 0.6875; it does not arm
with MOT_SPIN_ARM over MOT_SPIN_MIN, nor with the latter over 0.3) and AP_MotorsMatrix.cpp (frames).

For the simulation, a JSON frame for  --model FRAME:file.json: libraries/SITL/SIM_Frame.cpp and .h
(load_frame_params: mass, diagonal_size, moment_inertia [Ixx, Iyy, Izz], propExpo = MOT_THST_EXPO,
hoverThrOut, num_motors, motorN_position, motorN_yaw; what is not in the file keeps its default) and
SIM_Motor.cpp (position from the CoM in body FRD; torque about z = 0.05 diagonal_size yaw command
thrust, positive for ccw; the command is (output - spin_min) / (spin_max - spin_min), by default
0.15 and 0.95: spin_min is where the law begins, spin_max where it ends, 1 if it is of the whole
output). Comments begin with # as in Tools/autotest/models; the reader begins at the first brace,
even of a comment: none has one.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import frd, hash_comment, listed, text, with_notes
from rotorfit.export.vehicle import VehicleModel, required_law
from rotorfit.flight.motors.motor_model import ThrustCurve, command_range, thrust_curve
from rotorfit.logs.dataflash.frames import CLASSES, TYPES, Frame, numbered_frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.logs.motor_law import MotorLaw

HOVER_RANGE: Final = (0.125, 0.6875)
LARGEST_SPIN_MIN: Final = 0.3
"""Largest MOT_SPIN_MIN: with more, ArduPilot does not arm."""
SPIN_ARM: Final = 0.1
"""ArduPilot's default of MOT_SPIN_ARM."""
YAW_SCALE: Final = 0.05
SIMULATED: Final = {
    ("QUAD", "X"): "x",
    ("QUAD", "PLUS"): "+",
    ("QUAD", "BF_X"): "bfx",
    ("QUAD", "BF_X_REV"): "bfxrev",
    ("QUAD", "DJI_X"): "djix",
    ("QUAD", "CW_X"): "cwx",
    ("HEXA", "X"): "hexax",
    ("HEXA", "PLUS"): "hexa",
    ("HEXA", "DJI_X"): "hexa-dji",
    ("HEXA", "CW_X"): "hexa-cwx",
    ("OCTA", "PLUS"): "octa",
    ("OCTAQUAD", "X"): "octa-quad",
}
"""Names of frames in SIM_Frame.cpp, by class and type of the firmware."""
FRAME_ANGLE: Final = 20.0
"""Rotors may be so far from where their frame has them [deg]: the file moves them."""


def write_ardupilot(model: VehicleModel, head: Sequence[str]) -> str:
    """Write a parameter file, as ground stations, MAVProxy and the simulator load it."""
    curve = _law_curve(required_law(model, "ardupilot"))
    remarks = [
        "MOT_THST_EXPO is fitted to the law from MOT_SPIN_MIN to MOT_SPIN_MAX, within "
        f"{100 * curve.error:.2g} % of full thrust: they belong together",
        "the law is of the output that the log has: MOT_BAT_VOLT_MAX and MIN, where they are set, "
        "scale it before",
    ]
    lines: dict[str, float] = {}
    for some, remark in (_frame_lines(model), _spin_lines(model), _hover_line(model)):
        lines |= some
        remarks += [remark] if remark else []
    lines["MOT_THST_EXPO"] = curve.factor
    return hash_comment(with_notes(head, *remarks)) + "".join(
        f"{name},{text(value)}\n" for name, value in sorted(lines.items())
    )


Lines = tuple[dict[str, float], str]
"""Values of parameters, and what to say of them."""


def _frame_lines(model: VehicleModel) -> Lines:
    numbers = _frame_numbers(model)
    if numbers is None:
        return {}, (
            "FRAME_CLASS and FRAME_TYPE are left out: no frame of ArduPilot has these rotors in "
            "this order"
        )
    return {"FRAME_CLASS": float(numbers[0]), "FRAME_TYPE": float(numbers[1])}, ""


def _spin_lines(model: VehicleModel) -> Lines:
    start, end = command_range(required_law(model, "ardupilot"))
    if start > LARGEST_SPIN_MIN:
        return {}, (
            f"MOT_SPIN_MIN would be {start:.3g}, with which ArduPilot does not arm (at most "
            f"{LARGEST_SPIN_MIN:g}): left out with MOT_SPIN_MAX and MOT_SPIN_ARM"
        )
    found = {"MOT_SPIN_ARM": min(start, SPIN_ARM), "MOT_SPIN_MIN": start, "MOT_SPIN_MAX": end}
    return found, (
        "MOT_SPIN_ARM is at most MOT_SPIN_MIN: ArduPilot does not arm with more; before a real "
        "flight, see without propellers that the motors turn at MOT_SPIN_MIN"
    )


def _hover_line(model: VehicleModel) -> Lines:
    if HOVER_RANGE[0] <= model.hover_thrust <= HOVER_RANGE[1]:
        return {"MOT_THST_HOVER": model.hover_thrust}, ""
    return {}, (
        f"MOT_THST_HOVER would be {model.hover_thrust:.3g}, which ArduPilot does not take "
        f"({HOVER_RANGE[0]:g} to {HOVER_RANGE[1]:g}): left out"
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
    fields |= _thrust_fields(model, diagonal)
    body = ",\n".join(f"    {json.dumps(name)}: {value}" for name, value in fields.items())
    comment = hash_comment(with_notes(head, *_model_remarks(model, frame)))
    comment = comment.translate(str.maketrans("{}", "()"))
    return comment + f"\n{{\n{body}\n}}\n"


def _frame_numbers(model: VehicleModel) -> tuple[int, int] | None:
    """Find class and type of the firmware's frame whose motors stand and turn as these."""
    for kind in CLASSES:
        for number in TYPES:
            frame = numbered_frame(kind, number)
            if model.vertical and frame is not None and _fits_frame(model, frame):
                return kind, number
    return None


def _frame_of(model: VehicleModel) -> str:
    """Select the frame of ArduPilot's simulator with these motors; OutputError without one."""
    numbers = _frame_numbers(model)
    found = None if numbers is None else (CLASSES[numbers[0]], TYPES[numbers[1]])
    if found in SIMULATED:
        return SIMULATED[found]
    known = ", ".join(f"{kind} {way}" for kind, way in SIMULATED)
    raise OutputError(
        "ArduPilot's simulator has no frame with these rotors in this order; it has "
        f"{known}, upright, by FRAME_CLASS and FRAME_TYPE; export to gazebo instead"
    )


def _fits_frame(model: VehicleModel, frame: Frame) -> bool:
    if frame.angles_deg is None or len(frame.spins) != len(model.rotors):
        return False
    for arm, rotor, angle_deg, spin in zip(
        model.arms_from_middle, model.rotors, frame.angles_deg, frame.spins, strict=True
    ):
        turn = np.radians(angle_deg)
        along = float(arm[:2] @ [np.cos(turn), -np.sin(turn)]) / float(np.linalg.norm(arm[:2]))
        if along < np.cos(np.radians(FRAME_ANGLE)) or (spin == "ccw") != (rotor.spin > 0):
            return False
    return True


def _thrust_fields(model: VehicleModel, diagonal: float) -> dict[str, str]:
    """Write the thrust curve, hover throttle and yaw torque, where the law is known."""
    if model.law is None:
        return {}
    start, end = command_range(model.law)
    curve = _law_curve(model.law)
    hover = model.hover_thrust
    scale = YAW_SCALE * diagonal * curve.command(hover)
    yaw = {
        f"motor{i}_yaw": text(rotor.spin * model.kd / rotor.kt / scale)
        for i, rotor in enumerate(model.rotors, start=1)
    }
    spin = {"spin_min": text(start), "spin_max": text(end)}
    return {"propExpo": text(curve.factor), "hoverThrOut": text(hover), **spin, **yaw}


def _law_curve(law: MotorLaw) -> ThrustCurve:
    start, end = command_range(law)
    return thrust_curve(law, start=start, end=end)


def _model_remarks(model: VehicleModel, frame: str) -> list[str]:
    remarks = [
        f"start with  --model {frame}:THIS_FILE.json ; motors in the order of that frame; the "
        "firmware needs the parameters of  rotorfit export --to ardupilot",
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
        f"propExpo is fitted to the law, within {100 * _law_curve(model.law).error:.2g} % of full "
        "thrust; spin_min to spin_max is the law's range of the output (PWM 1000 to 2000)",
        "yaw torque, in proportion to command times thrust there, is right in hover",
    ]
