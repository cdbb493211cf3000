"""Every term of the model, in the order of the experiment file.

A new effect is a `Term` in `body.py`, `rotors.py` or `air.py`, named here. Sums over parameters
and the columns of the signals go in this order: a new one stands last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.model.terms.air import (
    CLIMB_DRAG,
    DRAG,
    INFLOW,
    TRANSLATIONAL_LIFT,
    TURN_DAMPING,
    WAKE_MOMENT,
)
from rotorfit.model.terms.body import ACCEL_BIAS, FIRST_MOMENTS, INERTIA, MASS, TORQUE_OFFSET
from rotorfit.model.terms.rotors import (
    DRAG_OF_ROTORS,
    IMU_MOUNTING,
    LINEAR_DRAG_TORQUE,
    ROTOR_CENTER,
    ROTOR_DRAG,
    ROTOR_INERTIA,
    ROTOR_SPREAD,
    THRUST,
    TORQUE,
    TWIST,
    YAW_DAMPING,
)

if TYPE_CHECKING:
    from collections.abc import Collection

    from rotorfit.model.signals import AddedSignals, SignalLayout
    from rotorfit.model.terms.term import Term

TERMS: Final[tuple[Term, ...]] = (
    *(MASS, FIRST_MOMENTS, INERTIA, THRUST, TORQUE),
    *(ROTOR_INERTIA, ROTOR_SPREAD, ACCEL_BIAS, ROTOR_CENTER, TWIST, ROTOR_DRAG, CLIMB_DRAG),
    *(DRAG, TURN_DAMPING, INFLOW, TRANSLATIONAL_LIFT, TORQUE_OFFSET, LINEAR_DRAG_TORQUE),
    *(IMU_MOUNTING, WAKE_MOMENT, YAW_DAMPING),
)
OPTIONAL: Final = tuple(term for term in TERMS if term.when != "always")
DEFAULT: Final = tuple(term for term in OPTIONAL if term.when == "default")
DEFAULT_TERMS: Final = tuple(term.name for term in DEFAULT)
"""Terms in the model unless the user says otherwise: every real vehicle has them, and they cost
next to nothing where it has not."""
BY_LIKELIHOOD: Final = tuple(term for term in OPTIONAL if term.when == "likelihood")
DROPPED: Final = tuple(
    sorted((t for t in DEFAULT if t.dropped is not None), key=lambda t: t.dropped or 0)
)
"""Left out one after the other where a fit does not settle."""


def terms_named(names: Collection[str]) -> tuple[Term, ...]:
    """Return the optional terms of these names, in the order of the model."""
    return tuple(term for term in OPTIONAL if term.name in names)


def considered_terms(asked: Collection[str] | None, *, velocity: bool, felt: bool) -> list[str]:
    """Return the optional terms whose signals a fit needs.

    `asked`: as the user chose; None for the default ones, and what the flights ask for. `velocity`:
    whether the velocity is known and wanted: all its terms share the same signals. `felt`: whether
    accelerometer and gyro feel the climb, and some flight knows no more.
    """
    usual = [t.name for t in DEFAULT] if asked is None else asked
    met: dict[str | None, bool] = {"velocity": velocity, "climb": felt}
    return [
        t.name
        for t in OPTIONAL
        if (t.needs == "velocity" and velocity) or (t.name in usual and met.get(t.needs, True))
    ]


def added_signals(
    names: Collection[str],
    *,
    carried: bool = False,
    rotor_air: bool = True,
    rotor_drag: bool = True,
) -> tuple[AddedSignals, ...]:
    """Return the signals that these terms add to a layout, each once.

    `carried`: whether any flight knows what carries its rotors. `rotor_air`, `rotor_drag`: whether
    the air moves at the rotors, and their drag is one of forces and turns; some simulators leave
    that out.
    """
    terms = [
        term
        for term in terms_named(names)
        if (rotor_air or not term.air_at_rotors)
        and (rotor_drag or DRAG_OF_ROTORS not in term.signals)
    ]
    by_velocity = rotor_air and rotor_drag and any(term.needs == "velocity" for term in terms)
    own: list[AddedSignals] = []
    for term in terms:
        instead = term.with_velocity if by_velocity else term.carried if carried else ()
        own += [*term.signals, *instead]
    return tuple(dict.fromkeys(own))


def signals_named(names: Collection[str]) -> tuple[AddedSignals, ...]:
    """Return added signals by their names."""
    every = dict.fromkeys(
        s for term in TERMS for s in (*term.signals, *term.carried, *term.with_velocity)
    )
    return tuple(signals for signals in every if signals.name in names)


def terms_in(layout: SignalLayout) -> tuple[Term, ...]:
    """Return all terms whose signals are in a layout."""
    return tuple(term for term in TERMS if term.stands_in(layout))
