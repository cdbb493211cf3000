"""The frames of ArduPilot's multirotors: where each motor sits, which way it turns, how it mixes.

Source: AP_MotorsMatrix.cpp of ArduPilot 4. Angles are clockwise from the front seen from above.
"""

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.logs.dataflash.parameters import Parameters

CLASSES: Final = {
    1: "QUAD",
    2: "HEXA",
    3: "OCTA",
    4: "OCTAQUAD",
    5: "Y6",
    12: "DODECAHEXA",
    14: "DECA",
}
TYPES: Final = {
    0: "PLUS",
    1: "X",
    2: "V",
    3: "H",
    4: "VTAIL",
    5: "ATAIL",
    6: "PLUSREV",
    10: "Y6B",
    11: "Y6F",
    12: "BF_X",
    13: "DJI_X",
    14: "CW_X",
    15: "I",
    18: "BF_X_REV",
}

# Motors in the order of their numbers: angle [deg], or roll and pitch factor, and + for ccw.
ROUND: Final = {
    ("QUAD", "PLUS"): "90+ -90+ 0- 180-",
    ("QUAD", "X"): "45+ -135+ -45- 135-",
    ("QUAD", "H"): "45- -135- -45+ 135+",
    ("QUAD", "PLUSREV"): "90- -90- 0+ 180+",
    ("QUAD", "BF_X"): "135- 45+ -135+ -45-",
    ("QUAD", "BF_X_REV"): "135+ 45- -135- -45+",
    ("QUAD", "DJI_X"): "45+ -45- -135+ 135-",
    ("QUAD", "CW_X"): "45+ 135- -135+ -45-",
    ("HEXA", "PLUS"): "0- 180+ -120- 60+ -60+ 120-",
    ("HEXA", "X"): "90- -90+ -30- 150+ 30+ -150-",
    ("HEXA", "DJI_X"): "30+ -30- -90+ -150- 150+ 90-",
    ("HEXA", "CW_X"): "30+ 90- 150+ -150- -90+ -30-",
    ("OCTA", "PLUS"): "0- 180- 45+ 135+ -45+ -135+ -90- 90-",
    ("OCTA", "X"): "22.5- -157.5- 67.5+ 157.5+ -22.5+ -112.5+ -67.5- 112.5-",
    ("OCTA", "DJI_X"): "22.5+ -22.5- -67.5+ -112.5- -157.5+ 157.5- 112.5+ 67.5-",
    ("OCTA", "CW_X"): "22.5+ 67.5- 112.5+ 157.5- -157.5+ -112.5- -67.5+ -22.5-",
    ("OCTAQUAD", "PLUS"): "0+ -90- 180+ 90- -90+ 0- 90+ 180-",
    ("OCTAQUAD", "X"): "45+ -45- -135+ 135- -45+ 45- 135+ -135-",
    ("OCTAQUAD", "H"): "45- -45+ -135- 135+ -45- 45+ 135- -135+",
    ("OCTAQUAD", "CW_X"): "45+ 45- 135- 135+ -135+ -135- -45- -45+",
    ("OCTAQUAD", "BF_X"): "135- 45+ -135+ -45- 135+ 45- -135- -45+",
    ("OCTAQUAD", "BF_X_REV"): "135+ 45- -135- -45+ 135- 45+ -135+ -45-",
    ("Y6", "Y6B"): "60- 60+ 180- 180+ -60- -60+",
    ("Y6", "Y6F"): "180+ 60+ -60+ 180- 60- -60-",
    ("Y6", ""): "60+ -60- -60+ 180- 60- 180+",
    ("DODECAHEXA", "PLUS"): "0+ 0- 60- 60+ 120+ 120- 180- 180+ -120+ -120- -60- -60+",
    ("DODECAHEXA", "X"): "30+ 30- 90- 90+ 150+ 150- -150- -150+ -90+ -90- -30- -30+",
    ("DECA", "PLUS"): "0+ 36- 72+ 108- 144+ 180- -144+ -108- -72+ -36-",
    ("DECA", "X"): "18+ 54- 90+ 126- 162+ -162- -126+ -90- -54+ -18-",
    ("DECA", "CW_X"): "18+ 54- 90+ 126- 162+ -162- -126+ -90- -54+ -18-",
}
UNEVEN: Final = {
    ("QUAD", "V"): "-.7071,.7071,.7981 .7071,-.7071,1 .7071,.7071,-.7981 -.7071,-.7071,-1",
    ("OCTAQUAD", "V"): (
        "-1,1,.7981 1,1,-.7981 1,-1,1 -1,-1,-1 1,1,.7981 -1,1,-.7981 -1,-1,1 1,-1,-1"
    ),
    ("HEXA", "H"): "-1,0,-1 1,0,1 1,1,-1 -1,-1,1 -1,1,1 1,-1,-1",
    ("OCTA", "H"): ("-1,1,-1 1,-1,-1 -1,.333,1 -1,-1,1 1,1,1 1,-.333,1 1,.333,-1 -1,-.333,-1"),
    ("OCTA", "I"): (".333,-1,-1 -.333,1,-1 1,-1,1 .333,1,1 -.333,-1,1 -1,1,1 -1,-1,-1 1,1,-1"),
}
_LAYOUTS: Final = {
    ("QUAD", "X"): "quad-x",
    ("QUAD", "PLUS"): "quad-plus",
    ("HEXA", "X"): "hexa-x",
    ("HEXA", "PLUS"): "hexa-plus",
    ("OCTA", "X"): "octo-x",
    ("OCTA", "PLUS"): "octo-plus",
    ("OCTAQUAD", "X"): "octo-coax-x",
}
"""Frames that `[airframe]` has a name for."""
_OLD_CLASSES: Final = {"OCTA_QUAD": "OCTAQUAD", "OCTA QUAD": "OCTAQUAD"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A frame whose mixer is known.

    `factors` are of roll, pitch and yaw in each motor's thrust, as the firmware scales them (at
    most 0.5); `angles_deg` are None where the motors are not on a circle.
    """

    kind: str
    type: str
    factors: Float[np.ndarray, "N 3"]
    angles_deg: tuple[float, ...] | None

    @property
    def spins(self) -> tuple[str, ...]:
        """Of the motors, seen from above; a positive yaw factor is counter-clockwise."""
        return tuple("ccw" if yaw > 0 else "cw" for yaw in self.factors[:, 2].tolist())

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.kind} {self.type}".strip()


def frame_of(parameters: Parameters, texts: list[str]) -> Frame | None:
    """Return the frame that a log's parameters and texts tell; None where it is not known.

    Before version 3.5 the parameter FRAME was the type, and the class was compiled in: a text
    ``Frame: QUAD`` tells it.
    """
    kind = CLASSES.get(parameters.integer("FRAME_CLASS") or 0) or _class_of_texts(texts)
    number = parameters.integer("FRAME_TYPE")
    if number is None:
        number = parameters.integer("FRAME")
    if kind is None or number is None:
        return None
    return _frame(kind, TYPES.get(number, ""))


def numbered_frame(kind: int, number: int) -> Frame | None:
    """Return the frame of FRAME_CLASS and FRAME_TYPE; None where its mixer is not known."""
    return _frame(CLASSES[kind], TYPES.get(number, ""))


def frame_words(parameters: Parameters, texts: list[str]) -> str:
    """Quote what a log says of a frame that is not known."""
    names = ("FRAME_CLASS", "FRAME_TYPE", "Q_FRAME_CLASS", "Q_FRAME_TYPE", "FRAME")
    found = [f"{n} = {parameters.values[n]:g}" for n in names if n in parameters.values]
    found += [text for text in texts if text.startswith("Frame: ")][:1]
    return ", ".join(found) or "neither FRAME_CLASS nor FRAME_TYPE"


def _class_of_texts(texts: list[str]) -> str | None:
    for text in texts:
        match = re.match(r"Frame: ([A-Z0-9_ ]+)", text)
        if match:
            name = _OLD_CLASSES.get(match[1].strip(), match[1].strip())
            return name if name in CLASSES.values() else None
    return None


def _frame(kind: str, type_name: str) -> Frame | None:
    key = (kind, type_name)
    if kind == "Y6" and key not in ROUND:  # every other type is the first Y6
        key = ("Y6", "")
    if key in ROUND:
        seats = [(float(seat[:-1]), seat[-1] == "+") for seat in ROUND[key].split()]
        turn = np.radians([angle for angle, _ in seats])
        yaw = [1.0 if is_ccw else -1.0 for _, is_ccw in seats]
        factors = np.column_stack([-np.sin(turn), np.cos(turn), yaw])
        return _scaled(key, factors, tuple(angle for angle, _ in seats))
    if key in UNEVEN:
        rows = [[float(x) for x in seat.split(",")] for seat in UNEVEN[key].split()]
        return _scaled(key, np.array(rows), None)
    return None


def _scaled(
    key: tuple[str, str], factors: Float[np.ndarray, "N 3"], angles: tuple[float, ...] | None
) -> Frame:
    """Scale each column of the factors of a frame to 0.5, as the firmware does."""
    scaled: Float[np.ndarray, "N 3"] = 0.5 * factors / np.abs(factors).max(axis=0)
    return Frame(kind=key[0], type=key[1], factors=scaled.round(9), angles_deg=angles)


def airframe_text(frame: Frame, imu_position: tuple[float, float, float] | None) -> str:
    """Write the ``[airframe]`` table of a frame, for people to complete and paste.

    What must be measured is a text in it, where a number has to be: an experiment that was not
    completed is refused.
    """
    lines = ["[airframe]"]
    layout = _LAYOUTS.get((frame.kind, frame.type))
    if layout:
        lines += [f'layout = "{layout}"', 'order = "ardupilot"', 'arm = "measure it [m]"']
    else:
        lines += ["rotors = [", *_rotor_lines(frame), "]"]
    if imu_position:
        lines.append(f"imu = {{ position = {list(imu_position)} }}  # INS_POS, turned to FLU")
    return "\n".join(lines)


def _rotor_lines(frame: Frame) -> list[str]:
    """Return a line for each rotor, with its position as multiples of the arm where it is known."""
    lines: list[str] = []
    for number, spin in enumerate(frame.spins):
        place = '"x [m]", "y [m]"'
        if frame.angles_deg is not None:
            turn = np.radians(frame.angles_deg[number])
            place = f'"{np.cos(turn):.6g} * arm", "{-np.sin(turn):.6g} * arm"'
        lines.append(f'  {{ position = [{place}, 0.0], spin = "{spin}" }},  # motor {number + 1}')
    return lines
