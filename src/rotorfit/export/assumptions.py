"""What a user may put in the place of numbers that the flights did not give: NAME=VALUE."""

import math
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Final

from rotorfit.model.parameters import DERIVED, INERTIA, PARAMETERS
from rotorfit.model.terms.rotors import MOST_ROTORS
from rotorfit.model.terms.term import ParameterInfo

_LENGTHS: Final = ("com_x", "com_y", "com_z", "rotor_center_x", "rotor_center_y")
POSITIVE: Final = (
    *("mass", "kt", "kd", "max_speed", *(f"kt_{i}" for i in range(1, MOST_ROTORS + 1))),
    *("Ixx", "Iyy", "Izz", "Ixx_com", "Iyy_com", "Izz_com"),
)
NOT_NEGATIVE: Final = ("Jr", "motor_lag", "motor_lag_up", "motor_lag_down")
MAY_BE_ASSUMED: Final = (
    *POSITIVE,
    *NOT_NEGATIVE,
    *_LENGTHS,
    *(name for name in INERTIA if name not in POSITIVE),
    *(f"{name}_com" for name in INERTIA if f"{name}_com" not in POSITIVE),
)


def unit_of(name: str) -> str:
    """Return the SI unit of a number by its name."""
    return "rad/s" if name == "max_speed" else (PARAMETERS | DERIVED)[name].unit


def per_kilogram(info: ParameterInfo, like: str) -> str:
    """Return the unit of a number, per kilogram where that of another is."""
    return f"{info.unit} per kg" if info.mass_power and like.endswith(" per kg") else info.unit


def parse_assumptions(words: Sequence[str]) -> dict[str, float]:
    """Return the assumed numbers by name, SI.

    Parameters
    ----------
    words
        Such as ``kd=3.7e-9``.

    Raises
    ------
    ValueError
        If a name is unknown or given twice, or a value is no number or cannot be physical.
    """
    assumed: dict[str, float] = {}
    for word in words:
        name, sign, text = (part.strip() for part in word.partition("="))
        if not sign:
            raise ValueError(f"{word!r} is no assumption; write NAME=VALUE, such as kd=3.7e-9")
        if name not in MAY_BE_ASSUMED:
            near = get_close_matches(name, MAY_BE_ASSUMED, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            names = ", ".join(n for n in MAY_BE_ASSUMED if not n.startswith("kt_"))
            raise ValueError(f"nothing named {name!r} can be assumed{hint} (known: {names})")
        if name in assumed:
            raise ValueError(f"{name} is assumed twice")
        assumed[name] = _physical(name, text)
    return assumed


def _physical(name: str, text: str) -> float:
    """Return the value, refused where nature has none such."""
    try:
        value = float(text)
    except ValueError as error:
        raise ValueError(f"{name}={text}: {text!r} is no number [{unit_of(name)}]") from error
    if not math.isfinite(value):
        raise ValueError(f"{name}={text} is not finite [{unit_of(name)}]")
    if name in POSITIVE and value <= 0.0:
        raise ValueError(f"{name}={text} cannot be: it is above 0 [{unit_of(name)}]")
    if name in NOT_NEGATIVE and value < 0.0:
        raise ValueError(f"{name}={text} cannot be: it is 0 or more [{unit_of(name)}]")
    return value
