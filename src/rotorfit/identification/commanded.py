"""Results from commanded rotor speed: units where no law makes speeds of commands, and doubts."""

import dataclasses
from typing import Final

from rotorfit.identification.experiment import MotorsEntry
from rotorfit.identification.result import Parameter
from rotorfit.identification.tables import Tables
from rotorfit.model.parameters import EFFECTIVE_UNITS

_PER_MASS: Final = " per kg"

NO_LAW: Final = (
    "no law from command to rotor speed is given: the command (0 to 1) stands for the speed in "
    "parts of its largest, w_max; kt, kd and Jr are per (squared) command, so that kt is the "
    "thrust of one rotor at full command (kt w_max^2); kt w_max^2, kd/kt, inertia and CoM are "
    "physical as far as the speed is in proportion to the command: else give law under [motors]"
)


LARGEST_BIAS: Final = 1.0
"""No accelerometer that anyone flies with has more [m/s^2]."""


def of_commanded_speed(tables: Tables, motors: MotorsEntry) -> Tables:
    """Return the tables with the units and the doubts that commands instead of speeds bring."""
    if motors.speed == "measured":
        return tables
    doubts = (*tables.warnings, *_law_doubts(tables.parameters))
    if motors.law is not None:
        return dataclasses.replace(tables, warnings=doubts)
    return dataclasses.replace(
        tables,
        parameters=tuple(
            dataclasses.replace(p, unit=effective_unit(p.name, p.unit)) for p in tables.parameters
        ),
        derived=tuple(
            dataclasses.replace(d, unit=effective_unit(d.name, d.unit)) for d in tables.derived
        ),
        warnings=(*doubts, NO_LAW),
    )


def _law_doubts(parameters: tuple[Parameter, ...]) -> tuple[str, ...]:
    """Return a doubt about the law where the thrust has an offset that is no sensor's.

    A thrust that is no square of the speed taken looks like one plus a constant about hover, and
    the constant like a bias of the accelerometer.
    """
    for p in parameters:
        if p.name == "accel_bias_z" and p.value is not None and abs(p.value) > LARGEST_BIAS:
            return (
                f"accel_bias_z is {p.value:.2g} m/s^2, more than an accelerometer has: the thrust "
                "is not in proportion to the square of the speed that the commands stand for; kt "
                "and what scales with it, inertia, hold about hover only: give law under [motors] "
                "as a thrust stand shows it, or log the rotor speed",
            )
    return ()


def effective_unit(name: str, unit: str) -> str:
    """Return the unit of a parameter in commands; ``kt_1`` and so on are as ``kt``."""
    base = "kt" if name.startswith("kt_") else name
    if base not in EFFECTIVE_UNITS:
        return unit
    return EFFECTIVE_UNITS[base] + (_PER_MASS if unit.endswith(_PER_MASS) else "")
