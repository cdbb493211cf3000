"""Betaflight and INDIflight, made from it: lines for their CLI.

Betaflight, the motors' law: src/main/flight/pid.c (pidApplyThrustLinearization: output x becomes
x (1 + c (1 - x)^2), c = thrust_linear / 100, between idle and full output) and cli/settings.c
(thrust_linear 0 to 150, of a PID profile).

INDIflight, control effectiveness and motors: tudelft/indiflight, src/main/flight/indi_init.c
(units: g1_f* 0.01 m/s^2, g1_roll ... 0.1 rad/s^2, both at u = 1; g2_* 1e-5), indi.c (u is the
thrust as a fraction of that at act_max_rpm; u = k d^2 + (1 - k) d of the output d, k =
act_nonlinearity / 100 within 0.025 to 0.7; body axes x forward, y right, z down) and cli/settings.c
(16 bit numbers, 8 bit lag in ms).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import RPM, hash_comment, with_notes
from rotorfit.export.vehicle import VehicleModel, effectiveness, required_law, spread
from rotorfit.flight.motors.motor_model import betaflight_linear, thrust_curve

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float


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


_FORCE, _TURN = "m/s^2 at full thrust", "rad/s^2 at full thrust"
_SPIN_UP = "rad/s^2 per rad/s^2 of the rotor"
_ROWS: Final = (
    *((f"g1_{axis}", _FORCE, 0.01) for axis in ("fx", "fy", "fz")),
    *((f"g1_{axis}", _TURN, 0.1) for axis in ("roll", "pitch", "yaw")),
    *((f"g2_{axis}", _SPIN_UP, 1e-5) for axis in ("roll", "pitch", "yaw")),
)
"""Names, what they are, and their units in INDIflight."""
LARGEST: Final = 32767
LONGEST_LAG: Final = 255
NONLINEARITY: Final = (0.025, 0.7)


def write_indiflight(
    model: VehicleModel, head: Sequence[str], drawn: Sequence[VehicleModel] = ()
) -> str:
    """Write lines for the CLI tab of the configurator."""
    comment = with_notes(
        head,
        "paste into the CLI tab under the INDI profile that it is for (indiprofile 0), then  save",
        "actuators in the order of the log's motors; body axes FRD; g1 is at full thrust, the "
        "thrust at act_max_rpm",
        *_model_remarks(model),
    )
    lines = [f"set indi_act_num = {len(model.rotors)}\n"]
    lines += _motor_lines(model)
    found = spread(_effectiveness_rows, model, drawn)
    for i, (name, kind, unit) in enumerate(_ROWS):
        if np.isfinite(found.value[i]).all():
            lines.append(f"\n# {kind}: {found.row_text(i)}\n")
            lines.append(_setting_line(name, found.value[i] / unit))
    return hash_comment(comment) + "\n" + "".join(lines)


def _effectiveness_rows(model: VehicleModel) -> Float[np.ndarray, "9 N"]:
    """Compute the rows of G1 at full thrust, and of G2, which are NaN where Jr is not known."""
    found = effectiveness(model)
    full = model.max_speed**2
    spin_up = np.full((3, len(model.rotors)), np.nan) if found.spin_up is None else found.spin_up
    return np.vstack([full * found.force, full * found.turn, spin_up])


def _motor_lines(model: VehicleModel) -> list[str]:
    rotors = len(model.rotors)
    lines = [
        _repeated_setting("max_rpm", model.max_speed / RPM, rotors),
        _repeated_setting("hover_rpm", model.hover_speed / RPM, rotors),
    ]
    lag = 1e3 * model.mean_lag
    if 0.5 <= lag < LONGEST_LAG:
        lines.append(_repeated_setting("time_constant_ms", lag, rotors))
    if model.law is not None:
        low, high = NONLINEARITY
        factor = min(max(thrust_curve(model.law).factor, low), high)
        lines.append(_repeated_setting("nonlinearity", 100.0 * factor, rotors))
    return lines


def _model_remarks(model: VehicleModel) -> list[str]:
    remarks: list[str] = []
    if model.law is None:
        remarks.append(
            "act_nonlinearity is left out: no law from command to rotor speed is known (identify a "
            "log with commands and measured rotor speeds)"
        )
    else:
        curve = thrust_curve(model.law)
        low, high = NONLINEARITY
        beyond = (
            ""
            if low <= curve.factor <= high
            else f"; INDIflight takes {100 * low:g} to {100 * high:g}"
        )
        remarks.append(
            f"act_nonlinearity {100 * curve.factor:.3g} is fitted to the law, within "
            f"{100 * curve.error:.2g} % of full thrust{beyond}"
        )
    if not np.isfinite(model.mean_lag):
        remarks.append("act_time_constant_ms is left out: the motors' lag is not known")
    elif model.lag_up != model.lag_down:
        remarks.append("act_time_constant_ms is the mean of rising and falling speed")
    if model.Jr is None:
        remarks.append("g2 is left out: Jr is not known")
    return remarks


def _repeated_setting(name: str, value: float, rotors: int) -> str:
    return f"set indi_act_{name} = {','.join([str(round(value))] * rotors)}\n"


def _setting_line(name: str, values: Float[np.ndarray, " N"]) -> str:
    numbers: list[int] = np.rint(values).astype(int).tolist()
    most = max(numbers, key=abs)
    if abs(most) > LARGEST:
        raise OutputError(
            f"indi_act_{name} would be {most}, over the {LARGEST} that INDIflight "
            "takes: lower max_speed (--assume max_speed=VALUE, the speed that motors are limited "
            "to)"
        )
    return f"set indi_act_{name} = {','.join(map(str, numbers))}\n"
