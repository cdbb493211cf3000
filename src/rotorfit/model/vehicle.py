"""The vehicle: where its rotors are, how they spin, and where its IMU sits.

Layouts have the motor order of the common autopilots. Angles are clockwise from the front seen from
above, as those autopilots' own tables give them. Sources: PX4 airframe reference; ArduPilot
"Connect ESCs and Motors"; Betaflight "Motor configuration" (props in); Crazyflie 2 "Motor
orientation"; Six et al. 2020, eq. 9 (paper).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np

from rotorfit.errors import LIST_ROTORS, ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float
    from numpy.typing import ArrayLike

Spin = Literal["ccw", "cw"]
PROPELLER_SHARE: Final = 0.8
"""Diameter of a propeller over the distance of neighbouring rotors: .71 (Crazyflie, Holybro X500)
to .85 (racing quadrotors)."""
COAXIAL: Final = 0.3
"""Distance of rotors, over the arm, up to which one stands over the other."""
UNIT: Final = 1e-3
"""Tolerance of the length of an axis, which was rounded, from 1."""


@frozen_dataclass
class Rotor:
    """One rotor of a vehicle.

    Attributes
    ----------
    position
        From the body origin, body axes FLU [m].
    spin
        Sense of rotation seen from above (from the tip of its axis).
    axis
        Unit vector of the thrust, body axes FLU.
    group
        Rotors of equal group share one thrust coefficient where those are estimated apart.

    Raises
    ------
    ExperimentError
        If it is no rotor.
    """

    position: tuple[float, float, float]
    spin: Spin
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    group: str | None = None

    def __post_init__(self) -> None:
        for name, vector in (("position", self.position), ("axis", self.axis)):
            if np.shape(vector) != (3,) or not all(map(math.isfinite, vector)):
                raise ExperimentError(
                    f"a rotor's {name} is {vector!r}, expected three numbers (x, y, z)"
                )
        if self.spin not in get_args(Spin):
            raise ExperimentError(
                f'a rotor\'s spin is {self.spin!r}, expected "ccw" or "cw", seen from above'
            )
        if abs(math.hypot(*self.axis) - 1.0) > UNIT:
            raise ExperimentError(
                f"a rotor's axis is {self.axis!r}, expected a unit vector: divide it by its length"
            )


# Without slots: the arrays are made once, because a fit asks for them thousands of times.
@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """The geometry that is known before the flight, body axes FLU.

    Attributes
    ----------
    rotors
        In the order of the log's motors.
    imu_position
        Of the accelerometer from the body origin [m]; None if unknown, and then the
        accelerometer is the origin.
    imu_position_std
        Standard deviation of each of its components [m].
    arm_std
        Standard deviation of the length of the arms, all measured with one tape [m].
    propeller
        Diameter of the propellers [m]; None if it was not declared.
    tolerances
        Further declared standard deviations [SI], by the name of their interval term.
    """

    rotors: tuple[Rotor, ...]
    imu_position: tuple[float, float, float] | None = None
    imu_position_std: float = 0.0
    arm_std: float = 0.0
    propeller: float | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict[str, float], hash=False)

    @cached_property
    def positions(self) -> Float[np.ndarray, "N 3"]:
        """Rotor positions from the body origin [m]."""
        return _read_only([rotor.position for rotor in self.rotors])

    @cached_property
    def axes(self) -> Float[np.ndarray, "N 3"]:
        """Unit thrust directions."""
        return _read_only([rotor.axis for rotor in self.rotors])

    @cached_property
    def spins(self) -> Float[np.ndarray, " N"]:
        """+1 for a rotor that turns counter-clockwise seen from above, -1 for clockwise."""
        return _read_only([1.0 if rotor.spin == "ccw" else -1.0 for rotor in self.rotors])

    @cached_property
    def levers(self) -> Float[np.ndarray, "N 3"]:
        """Torque of each rotor's thrust about the body origin, over that thrust [m]."""
        return _read_only(np.cross(self.positions, self.axes))

    @cached_property
    def squared_arms(self) -> Float[np.ndarray, " N"]:
        """Squared distance of each rotor from the body's z axis [m^2]."""
        return _read_only((self.positions[:, :2] ** 2).sum(axis=1))

    @cached_property
    def disk_area(self) -> float:
        """Area of all propellers' disks together [m^2], of a usual size where none is declared."""
        diameter = self.propeller
        if diameter is None:
            places = self.positions
            distances = np.linalg.norm(places[:, None] - places[None], axis=2)
            diameter = PROPELLER_SHARE * float(distances[distances > COAXIAL * self.arm].min())
        return len(self.rotors) * np.pi * diameter**2 / 4.0

    @cached_property
    def arm(self) -> float:
        """Mean distance of the rotors from the thrust line through their centre [m]."""
        offsets = self.positions[:, :2] - self.positions[:, :2].mean(axis=0)
        return float(np.hypot(offsets[:, 0], offsets[:, 1]).mean())


def _read_only(values: ArrayLike) -> Float[np.ndarray, "..."]:
    """Return an array that all who ask share, and nobody changes."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


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
        raise ExperimentError(
            f"no layout {layout!r} in the motor order {order!r}{_known_layouts(layout, order)}. "
            f"Of any other, {LIST_ROTORS}"
        )
    return tuple(_layout_rotor(float(angle), spin, arm) for angle, spin in seats)


def _known_layouts(layout: str, order: str) -> str:
    """List the layouts of a motor order, after the one that may be meant by an unknown name."""
    others = [whose for name, whose in LAYOUTS if name == layout]
    if others:
        return f"; known: {layout} in the order {', '.join(others)}"
    names = list(dict.fromkeys(name for name, whose in LAYOUTS if whose == order))
    names = names or list(dict.fromkeys(name for name, _ in LAYOUTS))
    near = get_close_matches(layout, names, n=1)
    return f"{f', did you mean {near[0]!r}?' if near else ';'} known: {', '.join(names)}"


def spaced_rotors(
    layout: str, *, spacing: tuple[float, float], order: str = "px4"
) -> tuple[Rotor, ...]:
    """Return the rotors of a named layout between whose motors a ruler was laid, body axes FLU.

    `layout`, `order`: as for `layout_rotors`. `spacing`: from the foremost motor axis to the
    rearmost, and from the leftmost to the rightmost [m].

    Raises `ExperimentError` if there is no such layout in that order.
    """
    rotors = layout_rotors(layout, arm=1.0, order=order)
    places = np.array([rotor.position for rotor in rotors])
    extent = places.max(axis=0) - places.min(axis=0)
    placed = places[:, :2] * np.array(spacing) / extent[:2]
    return tuple(
        Rotor(position=(round(float(x), 9), round(float(y), 9), 0.0), spin=rotor.spin)
        for (x, y), rotor in zip(placed, rotors, strict=True)
    )


def _layout_rotor(angle_deg: float, spin: Spin, arm: float) -> Rotor:
    angle = np.radians(angle_deg)
    x, y = arm * np.cos(angle), -arm * np.sin(angle)
    # Rounded to a nanometre, so that a rotor on an axis is on it.
    return Rotor(position=(round(float(x), 9), round(float(y), 9), 0.0), spin=spin)


def reversed_rotor(rotor: Rotor) -> Rotor:
    """Return a rotor that spins the other way."""
    return replace(rotor, spin="cw" if rotor.spin == "ccw" else "ccw")
