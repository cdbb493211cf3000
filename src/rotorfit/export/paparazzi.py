"""Paparazzi: control effectiveness of its INDI stabilisation, a section of an airframe file.

Source: paparazzi, sw/airborne/firmwares/rotorcraft/stabilization/stabilization_indi.c (G1 and G2
are 1000 times, INDI_G_SCALING, what one unit of an actuator does, 0 to MAX_PPRZ = 9600; rows roll,
pitch, yaw [rad/s^2] and thrust [m/s^2 along z], body axes x forward, y right, z down; the
estimation there has angular acceleration = G1 u + G2 (du/dt) / PERIODIC_FREQUENCY; ACT_FREQ is the
corner frequency of the actuators [rad/s]). One unit is what the law gives about hover.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import brentq

from rotorfit.errors import OutputError
from rotorfit.export.file_format import text, with_notes, xml_comment
from rotorfit.export.vehicle import VehicleModel, effectiveness, spread
from rotorfit.flight.motors.motor_model import speeds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

FULL: Final = 9600.0
"""MAX_PPRZ."""
SCALING: Final = 1000.0
"""INDI_G_SCALING."""
FREQUENCY: Final = 512.0
"""PERIODIC_FREQUENCY of a rotorcraft, where the airframe file says no other [Hz]."""
ROWS: Final = ("G1_ROLL", "G1_PITCH", "G1_YAW", "G1_THRUST", "G2")
STEP: Final = 1e-3
"""Step of the command, for the slope of the law."""


def write_paparazzi(
    model: VehicleModel, head: Sequence[str], drawn: Sequence[VehicleModel] = ()
) -> str:
    """Write a section ``STABILIZATION_ATTITUDE_INDI`` with G1 and G2."""
    comment = with_notes(
        head,
        "actuators in the order of the log's motors; body axes FRD; one unit of an actuator is "
        f"1/{FULL:g} of full command, at hover ({_speed_per_unit(model):.4g} rad/s of the rotor)",
        *_model_remarks(model),
    )
    found = spread(_effectiveness_rows, model, drawn)
    lines = "".join(
        xml_comment([f"{name}: {found.row_text(i)}"]) + _define_line(name, found.value[i].tolist())
        for i, name in enumerate(ROWS)
        if np.isfinite(found.value[i]).all()
    )
    if model.mean_lag > 0.0:
        lines += _define_line("ACT_FREQ", [1.0 / model.mean_lag] * len(model.rotors))
    return (
        xml_comment(comment)
        + '<section name="STABILIZATION_ATTITUDE_INDI" prefix="STABILIZATION_INDI_">\n'
        + lines
        + "</section>\n"
    )


def _speed_per_unit(model: VehicleModel) -> float:
    """Differentiate the law at hover: rotor speed over one unit of its actuator [rad/s]."""
    if model.law is None:  # in proportion to the command
        return model.max_speed / FULL
    law, hover = model.law, model.hover_speed

    def excess(command: float) -> float:
        return float(speeds(law, np.array([command]))[0]) - hover

    if excess(0.0) > 0.0 or excess(1.0) < 0.0:
        raise OutputError(
            f"the motors' law does not reach the {hover:.0f} rad/s of hover between no and full "
            "command; give another law under [motors]"
        )
    at = min(max(float(brentq(excess, 0.0, 1.0)), STEP), 1.0 - STEP)
    return (excess(at + STEP) - excess(at - STEP)) / (2.0 * STEP) / FULL


def _effectiveness_rows(model: VehicleModel) -> Float[np.ndarray, "5 N"]:
    """Compute the rows of G1, and G2, which is NaN where Jr is not known."""
    found = effectiveness(model)
    unit = SCALING * _speed_per_unit(model)
    spin_up = np.full(len(model.rotors), np.nan) if found.spin_up is None else found.spin_up[2]
    return np.vstack(
        [
            2.0 * model.hover_speed * unit * np.vstack([found.turn, found.force[2:]]),
            FREQUENCY * unit * spin_up,
        ]
    )


def _define_line(name: str, values: Sequence[float]) -> str:
    listed = ", ".join(text(float(f"{value:.5g}")) for value in values)
    return f'  <define name="{name}" value="{{{listed}}}"/>\n'


def _model_remarks(model: VehicleModel) -> list[str]:
    remarks = [f"G2 is for PERIODIC_FREQUENCY {FREQUENCY:g} Hz, with which it goes in proportion"]
    if model.Jr is None:
        remarks = ["G2 is left out: Jr is not known"]
    if model.law is None:
        remarks.append("rotor speed is taken as proportional to the command: no law is known")
    remarks.append(
        f"with INDI_RPM_FEEDBACK a unit is 1/{FULL:g} of the range of the servo in RPM: multiply "
        "G1 and G2 by that unit in rad/s over the rad/s above"
    )
    if not np.isfinite(model.mean_lag):
        remarks.append("ACT_FREQ is left out: the motors' lag is not known")
    return remarks
