"""A mass as people write it: in kilograms, or with the unit behind it."""

from __future__ import annotations

import math
import re
from typing import Final, Literal

from rotorfit.errors import ExperimentError

Mass = float | Literal["unknown"]
EXAMPLES: Final = 'kilograms such as 0.428, grams such as 428g, or "unknown"'
HEAVIEST: Final = 100.0
"""Mass from which a number without a unit is taken for grams [kg]: heavier ones carry people."""


def read_mass(text: str, subject: str) -> Mass:
    """Read a mass in kilograms, or with the unit behind it: 428g, 0.428kg, unknown.

    Parameters
    ----------
    text
        As it was written.
    subject
        What is read, for messages: an option such as ``--mass``, or a noun.

    Raises
    ------
    ValueError
        If the text is no mass.
    ExperimentError
        If the mass is no mass of a multirotor.
    """
    if text == "unknown":
        return "unknown"
    found = re.fullmatch(r"(.*?)\s*(kg|g)?", text.strip(), re.IGNORECASE)
    number, unit = found.groups() if found is not None else (text, None)
    mass = float(number)
    if unit is None and HEAVIEST < mass < math.inf:
        option = f"{subject} " if subject.startswith("--") else ""
        given = f"{subject} {text}" if option else subject
        raise ExperimentError(
            f"{given} is {mass:g} kg: did you mean {mass:g} g? "
            f"Then give {option}{number}g; if not, {option}{number}kg"
        )
    if unit is not None and unit.lower() == "g":
        mass /= 1000.0
    if not (math.isfinite(mass) and mass > 0):
        raise ExperimentError(
            f"{subject} is {text}, expected more than 0 kg; weigh the vehicle as it flies, battery "
            'included, or give "unknown"'
        )
    return mass
