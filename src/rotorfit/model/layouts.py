"""Named rotor layouts in the motor order of the common autopilots.

Angles are clockwise from the front seen from above, as those autopilots' own tables give them.
Sources: PX4 airframe reference; ArduPilot "Connect ESCs and Motors"; Betaflight "Motor
configuration" (props in); Crazyflie 2 "Motor orientation"; Six et al. 2020, eq. 9 (paper).
"""

from typing import Final

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.model.vehicle import Rotor, Spin

Seat = tuple[float, Spin]

QUAD_X: Final[tuple[Seat, ...]] = ((45, "ccw"), (-135, "ccw"), (-45, "cw"), (135, "cw"))
QUAD_PLUS: Final[tuple[Seat, ...]] = ((90, "ccw"), (-90, "ccw"), (0, "cw"), (180, "cw"))
HEXA_X: Final[tuple[Seat, ...]] = (
    *((90, "cw"), (-90, "ccw"), (-30, "cw")),
    *((150, "ccw"), (30, "ccw"), (-150, "cw")),
)
HEXA_PLUS: Final[tuple[Seat, ...]] = (
    *((0, "cw"), (180, "ccw"), (-120, "cw")),
    *((60, "ccw"), (-60, "ccw"), (120, "cw")),
)
OCTO_X: Final[tuple[Seat, ...]] = (
    *((22.5, "cw"), (-157.5, "cw"), (67.5, "ccw"), (157.5, "ccw")),
    *((-22.5, "ccw"), (-112.5, "ccw"), (-67.5, "cw"), (112.5, "cw")),
)
OCTO_PLUS: Final[tuple[Seat, ...]] = (
    *((0, "cw"), (180, "cw"), (45, "ccw"), (135, "ccw")),
    *((-45, "ccw"), (-135, "ccw"), (-90, "cw"), (90, "cw")),
)
OCTO_COAX_X: Final[tuple[Seat, ...]] = (
    *((45, "ccw"), (-45, "cw"), (-135, "ccw"), (135, "cw")),
    *((-45, "ccw"), (45, "cw"), (135, "ccw"), (-135, "cw")),
)

LAYOUTS: Final[dict[tuple[str, str], tuple[Seat, ...]]] = {
    ("quad-x", "px4"): QUAD_X,
    ("quad-x", "ardupilot"): QUAD_X,
    ("quad-x", "betaflight"): ((135, "cw"), (45, "ccw"), (-135, "ccw"), (-45, "cw")),
    ("quad-x", "crazyflie"): ((45, "ccw"), (135, "cw"), (-135, "ccw"), (-45, "cw")),
    ("quad-plus", "px4"): QUAD_PLUS,
    ("quad-plus", "ardupilot"): QUAD_PLUS,
    ("quad-plus", "paper"): QUAD_PLUS,
    ("hexa-x", "px4"): HEXA_X,
    ("hexa-x", "ardupilot"): HEXA_X,
    ("hexa-plus", "px4"): HEXA_PLUS,
    ("hexa-plus", "ardupilot"): HEXA_PLUS,
    ("octo-x", "px4"): OCTO_X,
    ("octo-x", "ardupilot"): OCTO_X,
    ("octo-plus", "px4"): OCTO_PLUS,
    ("octo-plus", "ardupilot"): OCTO_PLUS,
    ("octo-coax-x", "px4"): OCTO_COAX_X,
    ("octo-coax-x", "ardupilot"): OCTO_COAX_X,
}


def layout_rotors(layout: str, *, arm: float, order: str = "px4") -> tuple[Rotor, ...]:
    """Return the rotors of a named layout, body axes FLU.

    Parameters
    ----------
    layout
        Such as ``"quad-x"``.
    arm
        Distance of each rotor axis from the centre [m].
    order
        Whose motor numbering: ``"px4"``, ``"ardupilot"``, ``"betaflight"``, ``"crazyflie"`` or
        ``"paper"`` (rotors 1, 2 ccw at y = -arm, +arm; 3, 4 cw at x = +arm, -arm).

    Raises
    ------
    ExperimentError
        If there is no such layout in that order.
    """
    seats = LAYOUTS.get((layout, order))
    if seats is None:
        known = ", ".join(f"{name} ({whose})" for name, whose in LAYOUTS)
        raise ExperimentError(
            f"no layout {layout!r} in the motor order {order!r}; known: {known}; "
            "or list the rotors with position and spin"
        )
    return tuple(_rotor(float(angle), spin, arm) for angle, spin in seats)


def spaced_rotors(
    layout: str, *, spacing: tuple[float, float], order: str = "px4"
) -> tuple[Rotor, ...]:
    """Return the rotors of a named layout between whose motors a ruler was laid, body axes FLU.

    Parameters
    ----------
    layout, order
        As for `layout_rotors`.
    spacing
        From the foremost motor axis to the rearmost, and from the leftmost to the rightmost [m].

    Raises
    ------
    ExperimentError
        If there is no such layout in that order.
    """
    rotors = layout_rotors(layout, arm=1.0, order=order)
    places = np.array([rotor.position for rotor in rotors])
    extent = places.max(axis=0) - places.min(axis=0)
    placed = places[:, :2] * np.array(spacing) / extent[:2]
    return tuple(
        Rotor(position=(round(float(x), 9), round(float(y), 9), 0.0), spin=rotor.spin)
        for (x, y), rotor in zip(placed, rotors, strict=True)
    )


def _rotor(angle_deg: float, spin: Spin, arm: float) -> Rotor:
    angle = np.radians(angle_deg)
    x, y = arm * np.cos(angle), -arm * np.sin(angle)
    # Rounded to a nanometre, so that a rotor on an axis is on it.
    return Rotor(position=(round(float(x), 9), round(float(y), 9), 0.0), spin=spin)
