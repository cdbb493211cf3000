"""A law of the motors with another power of its speed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.motors.motor_model import speeds
from rotorfit.logs.motor_law import MotorLaw, PowerCurve, TableCurve

if TYPE_CHECKING:
    from jaxtyping import Float

BENT_ROWS: Final = 201
"""Of the table that a bent law becomes."""


def bend_law(law: MotorLaw, power: float, *, anchor: float) -> MotorLaw:
    """Return a law with another power of a law's speed, which is the same at a speed `anchor`."""
    if power == 1.0:
        return law
    voltage = law.voltage
    if voltage is not None:
        voltage = replace(
            voltage,
            exponent=power * voltage.exponent,
            exponent_std=power * voltage.exponent_std,
            missing_std=voltage.missing_std and power * voltage.missing_std,
        )
    if isinstance(law.curve, PowerCurve):
        full = float(bend_speed(np.array([law.curve.full_speed]), power, anchor=anchor)[0])
        curve = replace(law.curve, full_speed=full, exponent=power * law.curve.exponent)
        return replace(law, curve=curve, voltage=voltage)
    command = np.linspace(0.0, 1.0, BENT_ROWS)
    rising = np.maximum.accumulate(speeds(law, command))
    speed = bend_speed(rising, power, anchor=anchor)
    turning = np.flatnonzero(np.diff(speed) > 0.0)
    rows = [*turning, turning[-1] + 1]
    table = TableCurve(tuple(command[rows].tolist()), tuple(speed[rows].tolist()))
    return MotorLaw(curve=table, voltage=voltage, speed_std=law.speed_std, stated=law.stated)


def bend_speed(
    speed: Float[np.ndarray, "..."], power: float, *, anchor: float
) -> Float[np.ndarray, "..."]:
    """Return a power of speeds, at least 0, which is the same at a speed `anchor`."""
    return anchor * (np.maximum(speed, 0.0) / anchor) ** power
