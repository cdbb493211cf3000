"""Results from commanded rotor speed: units where no law makes speeds of commands, and doubts."""

import dataclasses
from typing import Final

from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.model.parameters import EFFECTIVE_UNITS
from rotorfit.results.parameter_tables import Tables

_PER_MASS: Final = " per kg"

NO_LAW: Final = (
    "no law from command to rotor speed is given: the command (0 to 1) stands for the speed in "
    "parts of its largest, w_max; kt, kd and Jr are per (squared) command, so that kt is the "
    "thrust of one rotor at full command (kt w_max^2); kt w_max^2, kd/kt, inertia and CoM are "
    "physical as far as the speed is in proportion to the command: else give law under [motors]"
)


def of_commanded_speed(tables: Tables, motors: MotorsEntry) -> Tables:
    """Return the tables with the units and the doubts that commands instead of speeds bring."""
    if motors.speed == "measured":
        return tables
    if motors.law is not None:
        return tables
    return dataclasses.replace(
        tables,
        parameters=tuple(
            dataclasses.replace(p, unit=effective_unit(p.name, p.unit)) for p in tables.parameters
        ),
        derived=tuple(
            dataclasses.replace(d, unit=effective_unit(d.name, d.unit)) for d in tables.derived
        ),
        warnings=(*tables.warnings, NO_LAW),
    )


def effective_unit(name: str, unit: str) -> str:
    """Return the unit of a parameter in commands; ``kt_1`` and so on are as ``kt``."""
    base = "kt" if name.startswith("kt_") else name
    if base not in EFFECTIVE_UNITS:
        return unit
    return EFFECTIVE_UNITS[base] + (_PER_MASS if unit.endswith(_PER_MASS) else "")
