"""Betaflight: what its CLI takes of the motors' law.

Source: betaflight, src/main/flight/pid.c (pidApplyThrustLinearization: output x becomes
x (1 + c (1 - x)^2), c = thrust_linear / 100, between idle and full output) and cli/settings.c
(thrust_linear 0 to 150, of a PID profile).
"""

from collections.abc import Sequence

from rotorfit.export.file_format import hash_comment, with_notes
from rotorfit.export.vehicle import VehicleModel, required_law
from rotorfit.preprocessing.motors.thrust_curve import betaflight_linear


def write_betaflight(model: VehicleModel, head: Sequence[str]) -> str:
    """Write lines for the CLI tab of the configurator."""
    linear = betaflight_linear(required_law(model, "betaflight"))
    comment = with_notes(
        head,
        "paste into the CLI tab with the PID profile chosen that it is for, then  save",
        f"with thrust_linear thrust is within {100 * linear.error:.2g} % of full thrust of a "
        "straight line of the motor output, from idle to full",
        "it turns the loop gain up at low throttle: lower the PID gains if motors get warm there",
    )
    return hash_comment(comment) + f"\nset thrust_linear = {round(100 * linear.factor)}\n"
