"""Results from commanded rotor speed: units where no law makes speeds of commands, and doubts."""

import dataclasses
from typing import Final

from rotorfit.dataset.dataset import Dataset
from rotorfit.findings import doubt
from rotorfit.model.parameters import EFFECTIVE_UNITS
from rotorfit.results.result import IdentificationResult

_PER_MASS: Final = " per kg"

NO_LAW: Final = (
    "no law from command to rotor speed is given: the command (0 to 1) is taken as the speed "
    "over its maximum, w_max; kt, kd and Jr are per (squared) command, so that kt is the thrust "
    "of one rotor at full command (kt w_max^2); kt w_max^2, kd/kt, inertia and CoM are physical "
    "if the speed is proportional to the command: if not, give law under [motors]"
)
RELATIVE_LAW: Final = (
    "the motors' law has no speed in rad/s: rotor speed is taken as a fraction of its maximum, "
    "so that kt is the thrust of one rotor at full command and kd its torque; kd/kt, inertia "
    "and CoM are "
    "physical"
)


def in_command_units(result: IdentificationResult, dataset: Dataset) -> IdentificationResult:
    """Convert a result to the units of commands, where no law makes speeds of them."""
    motors = dataset.motors
    if motors.speed == "measured" or not motors.law_is_relative or dataset.speeds_commanded:
        return result
    relative = doubt("no-speed-law", RELATIVE_LAW)
    if motors.law is None:
        relative = doubt(
            "no-speed-law",
            NO_LAW,
            numbers=("thrust_to_weight", "max_thrust"),
            doubtful_because="thrust is taken to grow with the square of the command",
            next_step="log the rotor speed, or measure thrust over command and give law under "
            "[motors]",
        )
    return dataclasses.replace(
        result,
        parameters=tuple(
            dataclasses.replace(p, unit=effective_unit(p.name, p.unit)) for p in result.parameters
        ),
        derived=tuple(
            dataclasses.replace(d, unit=effective_unit(d.name, d.unit)) for d in result.derived
        ),
    ).found(relative)


def effective_unit(name: str, unit: str) -> str:
    """Return the unit of a parameter in commands; ``kt_1`` and so on are as ``kt``."""
    base = "kt" if name.startswith("kt_") else name
    if base not in EFFECTIVE_UNITS:
        return unit
    return EFFECTIVE_UNITS[base] + (_PER_MASS if unit.endswith(_PER_MASS) else "")


def is_per_command(result: IdentificationResult) -> bool:
    """Return whether the coefficients of a result are per squared command, not per rad/s."""
    kt = result.parameter("kt").unit.removesuffix(_PER_MASS)
    return kt == EFFECTIVE_UNITS["kt"]
