"""The optional terms of the model, in the words of the experiment file.

Mass, thrust, drag torque, first moments and inertia are always there; what else is in the model is
a choice of these terms: by the user, or by what the flights say (`choice.py`).
"""

from typing import Final, Literal, get_args

Term = Literal[
    "rotor_inertia", "rotor_spread", "accel_bias", "twist", "drag", "torque_offset"
]  # in the order of the documentation
TERMS: Final[tuple[Term, ...]] = get_args(Term)
DEFAULT_TERMS: Final[tuple[Term, ...]] = ("rotor_inertia", "rotor_spread", "accel_bias", "twist")
"""Always in the model unless the user says otherwise: every real vehicle has them, and they cost
next to nothing where it has not."""
ADDED_TERMS: Final[tuple[Term, ...]] = ("drag", "torque_offset")
"""Added where the flights ask for them."""
TERM_WORDS: Final[dict[Term, str]] = {
    "rotor_inertia": "the spin inertia of the rotors (Jr)",
    "rotor_spread": "a thrust coefficient of each rotor's own (kt_1, kt_2, ...)",
    "accel_bias": "the bias of the accelerometer",
    "twist": "a yaw torque in proportion to thrust, of motors tilted about their arms",
    "drag": "air drag of the frame, in proportion to its velocity",
    "torque_offset": "a torque that does not change",
}
