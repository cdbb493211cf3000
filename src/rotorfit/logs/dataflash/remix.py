"""Motor commands mixed again from the rate controllers' outputs, where RCOU is logged too slowly.

The rate controllers' outputs (message RATE) come at the loop rate when "fast attitude" is logged,
the motors' PWM (RCOU) at 10 Hz only. AP_MotorsMatrix mixes thrust_i = throttle + roll r_i + pitch
p_i + yaw y_i, and AP_Motors_Thrust_Linearization turns a thrust t into the output
spin_min + (spin_max - spin_min) u with (1 - e) u + e u^2 = t. What the battery and the air add to
that changes slowly: the slow outputs tell it. They also tell whether the mix is right.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.logs.dataflash.columns import rate_of, timed, vector
from rotorfit.logs.dataflash.frames import Frame
from rotorfit.logs.dataflash.messages import Messages
from rotorfit.logs.dataflash.parameters import Parameters
from rotorfit.logs.flight_log import SITL, Channel, LoggedMotors
from rotorfit.logs.speed_law import SpeedLaw, SquareRootLaw, VoltageFactor

NAMES: Final = ("RATE",)
MIXER_INPUTS: Final = ("ROut", "POut", "YOut", "AOut")
SLOWER: Final = 2.0
"""The outputs are mixed again where RATE comes so many times as often as RCOU."""
AGREEMENT: Final = 0.02
"""Largest median difference from the outputs that were logged, of the full range."""
FEWEST_CHECKS: Final = 20
SMOOTHED: Final = 21
"""Outputs over which the battery's and the air's share is taken to be constant."""
IDLE: Final = 0.01
"""Above MOT_SPIN_MIN by less than this, motors idle and are not mixed."""


@dataclass(frozen=True, slots=True, kw_only=True)
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
    """Return the curve that the parameters set; None where a log has them not (before 3.5)."""
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
    thrust, saturated = _thrust(inputs[inside], frame)
    mixed = _to_outputs(time[inside], curve.share(thrust), outputs, curve)
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


def _thrust(
    inputs: Float[np.ndarray, "n 4"], frame: Frame
) -> tuple[Float[np.ndarray, "n N"], float]:
    """Return the relative thrust of each motor, and the share of samples that was limited."""
    thrust = inputs[:, :3] @ frame.factors.T + inputs[:, 3:]
    limited: Bool[np.ndarray, " n"] = ((thrust < 0.0) | (thrust > 1.0)).max(axis=1)
    return np.clip(thrust, 0.0, 1.0), float(limited.mean()) if len(thrust) else 0.0


def _to_outputs(
    time: Float[np.ndarray, " m"],
    share: Float[np.ndarray, "m N"],
    outputs: Channel,
    curve: ThrustCurve,
) -> tuple[Float[np.ndarray, "m N"], float] | None:
    """Compute outputs for the shares, and how far they are from those logged.

    The slow factor between them (battery voltage, density of the air) is a running median. While
    the motors idle, the outputs that were logged are held. None: too few to check by.
    """
    from scipy import ndimage

    width = curve.spin_max - curve.spin_min
    flying = outputs.values.mean(axis=1) > curve.spin_min + IDLE
    if int(flying.sum()) < FEWEST_CHECKS or len(time) < 2:
        return None
    at = outputs.time[flying]
    logged = (outputs.values[flying] - curve.spin_min) / width
    mixed = np.column_stack([np.interp(at, time, share[:, k]) for k in range(share.shape[1])])
    ratio = logged.mean(axis=1) / np.maximum(mixed.mean(axis=1), 1e-3)
    factor = ndimage.median_filter(ratio, SMOOTHED, mode="nearest")
    difference = float(np.median(np.abs(mixed * factor[:, None] - logged))) * width
    values = np.clip(
        curve.spin_min + width * share * np.interp(time, at, factor)[:, None], 0.0, 1.0
    )
    last = np.clip(np.searchsorted(outputs.time, time, side="right") - 1, 0, None)
    idle = ~flying[last]
    values[idle] = outputs.values[last[idle]]
    return values, difference


def simulator_of(parameters: Parameters) -> str:
    """Return ArduPilot's simulator where its own parameters are in the log; empty elsewhere."""
    return SITL if "SIM_RATE_HZ" in parameters.values or "SIM_SPEEDUP" in parameters.values else ""


def logged_motors(parameters: Parameters, *, battery: bool) -> LoggedMotors | None:
    """Make the law by which the firmware linearises thrust; speed in parts of the full one.

    None where the log has no MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX (before 3.5).
    """
    curve = thrust_curve(parameters)
    if curve is None or curve.expo < 0.0:
        return None
    law = SpeedLaw(
        curve=SquareRootLaw(1.0, *map(_short, (curve.expo, curve.spin_min, curve.spin_max))),
        voltage=_voltage(parameters) if battery else None,
    )
    names = ["MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX"]
    names += [] if law.voltage is None else ["MOT_BAT_VOLT_MAX"]
    return LoggedMotors(law=law, words=", ".join(names))


def _short(value: float) -> float:
    """Return a parameter as it was typed: logs hold them in single precision."""
    return float(f"{value:.6g}")


def _voltage(parameters: Parameters) -> VoltageFactor | None:
    """Return the battery's factor where the firmware makes up for it: both limits are set."""
    low, high = (parameters.number(f"MOT_BAT_VOLT_{end}") or 0.0 for end in ("MIN", "MAX"))
    return VoltageFactor(_short(high), 1.0) if 0.0 < low < high else None
