"""The option --mass: kilograms, or with the unit behind it."""

from __future__ import annotations

import math
import re
from typing import Literal

import typer

from rotorfit.errors import ExperimentError

HEAVIEST = 100.0
"""Mass from which a number without a unit is taken for grams [kg]: heavier ones carry people."""


def parse_mass(text: str) -> float | Literal["unknown"]:
    """Parse ``--mass`` in kilograms, or with the unit behind it: 428g, 0.428kg."""
    if text == "unknown":
        return "unknown"
    found = re.fullmatch(r"(.*?)\s*(kg|g)?", text.strip(), re.IGNORECASE)
    number, unit = found.groups() if found is not None else (text, None)
    try:
        mass = float(number)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not a mass; give kilograms such as 0.428, grams such as 428g, "
            'or "unknown"',
            param_hint="--mass",
        ) from None
    if unit is None and HEAVIEST < mass < math.inf:
        raise ExperimentError(
            f"--mass {text} is {mass:g} kg: did you mean {mass:g} g? Then give --mass {number}g; "
            f"if not, --mass {number}kg"
        )
    if unit is not None and unit.lower() == "g":
        mass /= 1000.0
    if not (math.isfinite(mass) and mass > 0):
        raise ExperimentError(
            f"--mass is {text}, expected more than 0 kg; weigh the vehicle as it flies, battery "
            'included, or give "unknown"'
        )
    return mass
