"""The optional terms of the model, in the words of the experiment file.

Mass, thrust, drag torque, first moments and inertia are always there; what else is in the model is
a choice of these terms: by the user, or by what the flights say (`term_choice.py`).
"""

import difflib
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal, cast, get_args

from pydantic import BeforeValidator

Term = Literal[
    "rotor_inertia",
    "rotor_spread",
    "accel_bias",
    "twist",
    "rotor_drag",
    "climb_drag",
    "drag",
    "turn_damping",
    "inflow",
    "translational_lift",
    "torque_offset",
]  # in the order of the documentation
TERMS: Final[tuple[Term, ...]] = get_args(Term)
DEFAULT_TERMS: Final[tuple[Term, ...]] = (
    *("rotor_inertia", "rotor_spread", "accel_bias", "twist", "rotor_drag", "climb_drag"),
)
"""Always in the model unless the user says otherwise: every real vehicle has them, and they cost
next to nothing where it has not."""
ADDED_TERMS: Final[tuple[Term, ...]] = (
    *("drag", "turn_damping", "inflow", "translational_lift", "torque_offset"),
)
"""Added where the flights ask for them."""
OF_VELOCITY: Final[tuple[Term, ...]] = ("drag", "inflow", "translational_lift")
"""Those that need the velocity."""
TERM_WORDS: Final[dict[Term, str]] = {
    "rotor_inertia": "the spin inertia of the rotors (Jr)",
    "rotor_spread": "a thrust coefficient of each rotor's own (kt_1, kt_2, ...)",
    "accel_bias": "the bias of the accelerometer",
    "twist": "a yaw torque in proportion to thrust, of motors tilted about their arms",
    "rotor_drag": "a yaw torque of rotors that move sideways through the air in a turn",
    "climb_drag": "a force against the velocity along z that accelerometer and gyro feel",
    "drag": "air drag of the frame, in proportion to its velocity",
    "turn_damping": "damping of roll and pitch, in proportion to their rates",
    "inflow": "thrust that falls as the rotors climb",
    "translational_lift": "thrust that rises with the square of the sideways velocity",
    "torque_offset": "a constant torque",
}


def known_terms(given: object, info: Any) -> object:
    """Return what a file gives as its terms, each named once.

    Raises
    ------
    ValueError
        If a name is no term, with the nearest one; or if the method has terms of its own.
    """
    if given is None or not isinstance(given, list | tuple):
        return given
    if info.data.get("method", "banded") != "banded" or info.data.get("preset") is not None:
        raise ValueError('they belong to method = "banded"; the other methods have their own')
    names = [str(name) for name in cast("Sequence[object]", given)]
    for name in names:
        if name not in TERMS:
            close = difflib.get_close_matches(name, TERMS, n=1, cutoff=0.4)
            nearest = f", did you mean {close[0]!r}?" if close else ";"
            raise ValueError(f"no term {name!r}{nearest} known terms: {', '.join(TERMS)}")
    return tuple(dict.fromkeys(names))


Terms = Annotated[tuple[Term, ...], BeforeValidator(known_terms)]
"""What stands under ``terms`` of an experiment."""
