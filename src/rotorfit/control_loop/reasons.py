"""Why margins are withheld, and what they rest on, in words."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from rotorfit.control_loop.controllers import moving_filters
from rotorfit.control_loop.proof import (
    SHARP,
    Band,
    LoopError,
    ReplayedMixer,
    ReplayedOutput,
)
from rotorfit.control_loop.vehicle import Flown
from rotorfit.logs.flight_log import FlightLog

PROVED_AXES: Final = (0, 1)
"""Yaw's closed loop is not predicted well enough to be proved."""
NEAR: Final = 2.0
"""Factor about the crossover in which the closed loop must be proved."""
LIMITED: Final = 0.02
"""Share of a flight with a motor at its limit, from which it is said."""


def contradictions(
    axis: int,
    replay: ReplayedOutput,
    mixer: ReplayedMixer | None,
    error: LoopError | None,
    flight: Flown,
) -> list[str]:
    """Say what contradicts the controller and mixer as they were read, or an error the result."""
    if axis not in PROVED_AXES:
        return ["unproven: drag torque and the rotors' inertia act together"]
    doubts: list[str] = []
    if not replay.is_right:
        doubts.append(
            f"the logged output is {replay.slope:.2f} times, and the rate's derivative "
            f"{replay.derivative:.2f} times, that of the controller as its parameters set it: a "
            "filter or a gain is not what they say, or changed in flight"
        )
    if mixer is not None and not mixer.is_right:
        doubts.append(
            f"the motors' commands follow the output as with {mixer.name} {mixer.factor:.2f}, which"
            f" makes {mixer.slope:.2f} times the thrust that the parameters of the log do: the "
            "curve or the spin range is not what they say"
        )
    if error is not None:
        gain, late = error.half_widths
        when = "later" if error.delay > 0.0 else "earlier"
        words = (
            f"this flight's closed loop has {error.gain:.2f} +- {gain:.2f} times the predicted "
            f"effectiveness and answers {1e3 * abs(error.delay):.1f} +- {1e3 * late:.1f} ms {when}:"
            " the vehicle, its delay or a filter is another than the result has it"
        )
        limited = 1.0 - float(flight.free.mean())
        if limited > LIMITED:
            words += (
                f", or it is the {100 * limited:.0f} % of the flight with a motor at its limit: fly"
                " with less throttle and smaller steps"
            )
        doubts.append(words)
    return doubts


def too_little(crossover: float, bands: Sequence[Band], error: LoopError) -> list[str]:
    """Say where the flight does not show the closed loop about the crossover [Hz], and why."""
    near = [b for b in bands if b.high > crossover and b.low < crossover * NEAR]
    gain, late = error.half_widths
    turn = 2.0 * np.pi * crossover * late
    if not any(b.proved for b in near):
        end = max((b.high for b in bands if b.proved), default=0.0)
        why = f"it follows the set point as predicted up to {end:.1f} Hz" if end else "none is seen"
    elif gain > SHARP:
        why = f"effectiveness is seen to {100 * gain:.0f} %"
    elif turn > SHARP:
        why = f"the delay decides there, and is seen to {np.degrees(turn):.0f} degrees"
    else:
        return []
    return [
        f"the flight shows too little of the closed loop about the crossover at {crossover:.1f} Hz:"
        f" {why}; fly 30 s of quick roll and pitch steps"
    ]


def notes_of(flight: Flown, log: FlightLog) -> list[str]:
    """Say what the loops rest on."""
    battery = log.channels.get("battery")
    mean = float(flight.commands.mean())
    notes = [
        f"the loops are those of hover as in this flight (motor command {mean:.2f} in the mean); "
        "fast flight and another load change them"
    ]
    if battery is not None:
        notes.append(
            f"at {float(np.nanmean(battery.values)):.1f} V: without compensation by the autopilot "
            "the gain falls with the battery's voltage"
        )
    if log.gyro_lowpass is not None:
        notes.append(
            f"the gyro's low-pass of {log.gyro_lowpass:g} Hz is in the log, and counted once"
        )
    moving = moving_filters(flight.log)
    if moving:
        notes.append(
            f"notches of the gyro that follow the rotors, or are split ({', '.join(moving)}): they "
            "are in the loop by the delay and the size that the gyro's two records show of them up "
            "to 40 Hz, not by their shape; the other filters are in it exactly"
        )
    changed = [n for n in flight.log.changed if n.startswith(("MC_", "ATC_RAT", "ATC_ANG", "IMU_"))]
    if changed:
        notes.append(f"{', '.join(changed[:4])} changed within the log: the last values are taken")
    return notes
