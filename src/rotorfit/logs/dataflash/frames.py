"""The frames of ArduPilot's multirotors: where each motor sits, which way it turns, how it mixes.

Source: AP_MotorsMatrix.cpp of ArduPilot 4. Angles are clockwise from the front seen from above.

Motor commands are mixed again here where RCOU is logged too slowly. The rate controllers' outputs
(message RATE) come at the loop rate when "fast attitude" is logged, the motors' PWM (RCOU) at 10 Hz
only. AP_MotorsMatrix mixes thrust_i = throttle + roll r_i + pitch p_i + yaw y_i, and
AP_Motors_Thrust_Linearization turns a thrust t into the output
spin_min + (spin_max - spin_min) u with (1 - e) u + e u^2 = t. What the battery and the air add to
that changes slowly: the slow outputs show it. They also show whether the mix is right.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash.columns import rate_of, timed, vector
from rotorfit.logs.flight_log import SITL, Channel, LoggedMotors
from rotorfit.logs.motor_law import MotorLaw, SquareRootCurve, VoltageFactor

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from rotorfit.logs.dataflash.messages import Messages
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


@frozen_dataclass
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
    """Return the frame by a log's parameters and texts; None if it is not known."""
    kind = CLASSES.get(parameters.integer("FRAME_CLASS") or 0) or _class_of_texts(texts)
    number = parameters.integer("FRAME_TYPE")
    # Before version 3.5 the parameter FRAME was the type, and the class was compiled in: a text
    # ``Frame: QUAD`` has it.
    if number is None:
        number = parameters.integer("FRAME")
    if kind is None or number is None:
        return None
    return _frame_of_kind(kind, TYPES.get(number, ""))


def numbered_frame(kind: int, number: int) -> Frame | None:
    """Return the frame of FRAME_CLASS and FRAME_TYPE; None if its mixer is not known."""
    return _frame_of_kind(CLASSES[kind], TYPES.get(number, ""))


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


def _frame_of_kind(kind: str, type_name: str) -> Frame | None:
    key = (kind, type_name)
    if kind == "Y6" and key not in ROUND:  # every other type is the first Y6
        key = ("Y6", "")
    if key in ROUND:
        seats = [(float(seat[:-1]), seat[-1] == "+") for seat in ROUND[key].split()]
        turn = np.radians([angle for angle, _ in seats])
        yaw = [1.0 if is_ccw else -1.0 for _, is_ccw in seats]
        factors = np.column_stack([-np.sin(turn), np.cos(turn), yaw])
        return _scale_frame(key, factors, tuple(angle for angle, _ in seats))
    if key in UNEVEN:
        rows = [[float(x) for x in seat.split(",")] for seat in UNEVEN[key].split()]
        return _scale_frame(key, np.array(rows), None)
    return None


def _scale_frame(
    key: tuple[str, str], factors: Float[np.ndarray, "N 3"], angles: tuple[float, ...] | None
) -> Frame:
    """Scale each column of the factors of a frame to 0.5, as the firmware does."""
    scaled: Float[np.ndarray, "N 3"] = 0.5 * factors / np.abs(factors).max(axis=0)
    return Frame(kind=key[0], type=key[1], factors=scaled.round(9), angles_deg=angles)


def airframe_text(frame: Frame, imu_position: tuple[float, float, float] | None) -> str:
    """Write the ``[airframe]`` table of a frame, for people to complete and paste."""
    lines = ["[airframe]"]
    layout = _LAYOUTS.get((frame.kind, frame.type))
    if layout:
        # What must be measured is a text where a number has to be: an experiment that was not
        # completed is refused.
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


NAMES: Final = ("RATE",)
MIXER_INPUTS: Final = ("ROut", "POut", "YOut", "AOut")
SLOWER: Final = 2.0
"""The outputs are mixed again where RATE comes so many times as often as RCOU."""
AGREEMENT: Final = 0.02
"""Largest median difference from the outputs that were logged, of the full range."""
FEWEST_CHECKS: Final = 20
SMOOTHED: Final = 21
"""Outputs over which the battery's and the air's share is taken to be constant."""
ROUNDED: Final = 5e-4
"""Share of the range by which outputs in whole microseconds are off."""
CLEARLY: Final = 0.7
"""Difference of another curve over that of the parameters, from which it is the one flown."""
IDLE: Final = 0.01
"""Above MOT_SPIN_MIN by less than this, motors idle and are not mixed."""


@frozen_dataclass
class ThrustCurve:
    """From relative thrust to a motor's output: MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX."""

    expo: float
    spin_min: float
    spin_max: float

    def share(self, thrust: Float[np.ndarray, "n N"]) -> Float[np.ndarray, "n N"]:
        """Return u, the share of the range of outputs, for relative thrusts 0 to 1."""
        e = self.expo
        if abs(e) < 1e-6:
            return thrust
        return (e - 1.0 + np.sqrt((1.0 - e) ** 2 + 4.0 * e * thrust)) / (2.0 * e)


def thrust_curve(parameters: Parameters) -> ThrustCurve | None:
    """Return the curve that the parameters set; None if a log has them not (before 3.5)."""
    names = ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")
    expo, low, high = (parameters.number(name) for name in names)
    if expo is None or low is None or high is None:
        return None
    if not (-1.0 < expo <= 1.0 and 0.0 <= low < high <= 1.0):
        return None
    return ThrustCurve(expo=expo, spin_min=low, spin_max=high)


def remixed(
    messages: Messages,
    parameters: Parameters,
    outputs: Channel,
    *,
    frame: Frame | None,
) -> tuple[Channel, list[str]]:
    """Return the commands at the rate of RATE, or the outputs as they are, and why."""
    found = timed(messages, "RATE", MIXER_INPUTS)
    if found is None or len(found[0]) < 2 or len(outputs.time) < 2:
        return outputs, []
    time, fields = found
    slow, fast = rate_of(outputs.time), rate_of(time)
    if fast < SLOWER * slow:
        return outputs, []
    rates = f"RCOU comes at {slow:.0f} Hz, RATE at {fast:.0f} Hz"
    inputs = vector(fields, MIXER_INPUTS)
    curve = thrust_curve(parameters)
    why = _why_not(inputs, curve, frame, outputs.values.shape[1])
    if why or curve is None or frame is None:
        return outputs, [f"{rates}, but the outputs cannot be mixed again from it: {why}"]
    inside = (time >= outputs.time[0]) & (time <= outputs.time[-1])
    thrust, saturated = _relative_thrust(inputs[inside], frame)
    mixed = _by_best_curve(time[inside], thrust, outputs, curve)
    if mixed is None:
        return outputs, [f"{rates}; no flight was found in RCOU by which a mix could be checked"]
    values, difference = mixed
    if difference > AGREEMENT:
        return outputs, [
            f"{rates}, but RATE mixed for the frame {frame.title} differs from RCOU by "
            f"{100 * difference:.1f} % (median): RCOU is used; check FRAME_CLASS and FRAME_TYPE"
        ]
    words = f"RATE.{','.join(MIXER_INPUTS)} mixed again for the frame {frame.title}, as 0..1"
    notes = [
        f"{rates}: commands are mixed again from RATE for the frame {frame.title}; they differ "
        f"from RCOU by {100 * difference:.2f} % (median), {100 * saturated:.1f} % are limited"
    ]
    return Channel(time=time[inside], values=values, source=words), notes


def _why_not(
    inputs: Float[np.ndarray, "n 4"], curve: ThrustCurve | None, frame: Frame | None, motors: int
) -> str:
    if frame is None:
        return "the frame's mixer is not known"
    if len(frame.factors) != motors:
        return f"{motors} motors, but the frame {frame.title} has {len(frame.factors)}"
    if curve is None:
        return "the log has no MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX"
    if not np.isfinite(inputs).all() or float(np.abs(inputs).max()) > 2.0:
        return "its outputs are not in -1 to 1, as before version 3.4"
    return ""


def _relative_thrust(
    inputs: Float[np.ndarray, "n 4"], frame: Frame
) -> tuple[Float[np.ndarray, "n N"], float]:
    """Return the relative thrust of each motor, and the share of samples that was limited."""
    thrust = inputs[:, :3] @ frame.factors.T + inputs[:, 3:]
    limited: Bool[np.ndarray, " n"] = ((thrust < 0.0) | (thrust > 1.0)).max(axis=1)
    return np.clip(thrust, 0.0, 1.0), float(limited.mean()) if len(thrust) else 0.0


def _by_best_curve(
    time: Float[np.ndarray, " m"],
    thrust: Float[np.ndarray, "m N"],
    outputs: Channel,
    curve: ThrustCurve,
) -> tuple[Float[np.ndarray, "m N"], float] | None:
    """Compute outputs for relative thrusts, and how far they are from those logged."""
    stated = _to_outputs(time, curve.share(thrust), outputs, curve)
    if stated is None or stated[1] <= ROUNDED:
        return stated
    from scipy.optimize import minimize_scalar

    def with_expo(expo: float) -> tuple[Float[np.ndarray, "m N"], float]:
        other = replace(curve, expo=expo)
        return _to_outputs(time, other.share(thrust), outputs, other) or stated

    best = minimize_scalar(
        lambda expo: with_expo(float(expo))[1],
        bounds=(-0.5, 1.0),
        method="bounded",
        options={"xatol": 0.005},
    )
    other = with_expo(float(best.x))
    # Outputs that show another MOT_THST_EXPO: the parameter was changed after the flight.
    return other if other[1] < CLEARLY * stated[1] else stated


def _to_outputs(
    time: Float[np.ndarray, " m"],
    share: Float[np.ndarray, "m N"],
    outputs: Channel,
    curve: ThrustCurve,
) -> tuple[Float[np.ndarray, "m N"], float] | None:
    """Compute outputs for the shares, and how far they are from those logged."""
    width = curve.spin_max - curve.spin_min
    flying = outputs.values.mean(axis=1) > curve.spin_min + IDLE
    # Too few to check by.
    if int(flying.sum()) < FEWEST_CHECKS or len(time) < 2:
        return None
    at = outputs.time[flying]
    logged = (outputs.values[flying] - curve.spin_min) / width
    mixed = np.column_stack([np.interp(at, time, share[:, k]) for k in range(share.shape[1])])
    ratio = logged.mean(axis=1) / np.maximum(mixed.mean(axis=1), 1e-3)
    # The slow factor between them (battery voltage, density of the air) is a running median.
    around = sliding_window_view(np.pad(ratio, SMOOTHED // 2, mode="edge"), SMOOTHED)
    factor: Float[np.ndarray, " f"] = np.median(around, axis=1)
    difference = float(np.median(np.abs(mixed * factor[:, None] - logged))) * width
    values = np.clip(
        curve.spin_min + width * share * np.interp(time, at, factor)[:, None], 0.0, 1.0
    )
    last = np.clip(np.searchsorted(outputs.time, time, side="right") - 1, 0, None)
    # While the motors idle, the outputs that were logged are held.
    idle = ~flying[last]
    values[idle] = outputs.values[last[idle]]
    return values, difference


def simulator_of(parameters: Parameters) -> str:
    """Return ArduPilot's simulator where its own parameters are in the log; empty elsewhere."""
    return SITL if "SIM_RATE_HZ" in parameters.values or "SIM_SPEEDUP" in parameters.values else ""


def logged_motors(parameters: Parameters, *, battery: bool) -> LoggedMotors | None:
    """Make the law by which the firmware linearises thrust; speed in parts of the full one."""
    curve = thrust_curve(parameters)
    # The log has no MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX (before 3.5).
    if curve is None or curve.expo < 0.0:
        return None
    law = MotorLaw(
        curve=SquareRootCurve(
            1.0, *map(_shorten_value, (curve.expo, curve.spin_min, curve.spin_max))
        ),
        voltage=_voltage_factor(parameters) if battery else None,
        stated=True,
    )
    names = ["MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX"]
    names += [] if law.voltage is None else ["MOT_BAT_VOLT_MAX"]
    return LoggedMotors(law=law, words=", ".join(names))


def _shorten_value(value: float) -> float:
    """Return a parameter as it was typed: logs hold them in single precision."""
    return float(f"{value:.6g}")


def _voltage_factor(parameters: Parameters) -> VoltageFactor | None:
    """Return the battery's factor where the firmware makes up for it: both limits are set."""
    low, high = (parameters.number(f"MOT_BAT_VOLT_{end}") or 0.0 for end in ("MIN", "MAX"))
    return VoltageFactor(_shorten_value(high), 1.0) if 0.0 < low < high else None
