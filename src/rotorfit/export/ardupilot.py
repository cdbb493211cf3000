"""ArduPilot: the parameters of the motors' law, for a real Copter.

Source: ArduPilot, libraries/AP_Motors/AP_Motors_Thrust_Linearization.cpp (relative thrust
f u^2 + (1 - f) u of a command u from MOT_SPIN_MIN to MOT_SPIN_MAX, f = MOT_THST_EXPO) and
AP_MotorsMulticopter.cpp (MOT_THST_HOVER: hover thrust over full, 0.125 to 0.6875).
"""

from collections.abc import Sequence
from typing import Final

from rotorfit.export.betaflight import required_law
from rotorfit.export.header import hash_comment, noted
from rotorfit.export.px4 import hover_thrust
from rotorfit.export.units import text
from rotorfit.export.vehicle import ROTORS, SPEED, VehicleModel
from rotorfit.preprocessing.motors.thrust_curve import command_range, thrust_curve

NEEDS: Final = ("mass", *ROTORS, *SPEED)
HOVER_RANGE: Final = (0.125, 0.6875)


def write_ardupilot(model: VehicleModel, head: Sequence[str]) -> str:
    """Return a parameter file, as ground stations and MAVProxy load it."""
    law = required_law(model, "ardupilot")
    start, end = command_range(law)
    curve = thrust_curve(law, start=start, end=end)
    hover = hover_thrust(model)
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
    return hash_comment(noted(head, *remarks)) + "".join(
        f"{name},{text(value)}\n" for name, value in lines
    )
