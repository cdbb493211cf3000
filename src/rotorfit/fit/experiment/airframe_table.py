"""The ``[airframe]`` table of the experiment file: rotors, layout, IMU, axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.strict_tables import Finite, NotNegative, Positive, Strict, Vector
from rotorfit.model.vehicle import Rotor, Spin, layout_rotors, spaced_rotors

if TYPE_CHECKING:
    from collections.abc import Sequence

Axes = Literal["FLU", "FRD"]
Order = Literal["px4", "ardupilot", "betaflight", "crazyflie", "paper"]
SHORTEST_ARM: Final = 0.01
LONGEST_ARM: Final = 5.0
"""Arms of a multirotor, from the smallest toy to the largest that carries people [m]."""
FARTHEST_IMU: Final = 2.0
"""Distance of the IMU from the rotors' centre, in longest arms: it sits on the frame, which hardly
reaches beyond its rotors. An IMU 2 cm up, declared as 2, gave a centre of mass 2 m off."""


Propeller = Annotated[Positive, Field(ge=0.02, le=3.0)]
"""Diameter of a propeller [m]."""
Tilt = Annotated[Finite, Field(ge=-45, le=45)]
"""Tilt of the IMU in the vehicle [deg]: roll (right side down), pitch (nose up)."""


class RotorEntry(Strict):
    """One rotor: position from the body origin [m], spin seen from above, thrust axis."""

    position: Vector
    spin: Spin
    axis: Vector | None = None
    group: str | None = None


class ImuEntry(Strict):
    """Where the accelerometer is, from the body origin [m]."""

    position: Vector
    position_std: NotNegative = 0.0


class AirframeEntry(Strict):
    """The ``[airframe]`` table: rotors listed one by one, or a named layout."""

    axes: Axes = "FLU"
    rotors: tuple[RotorEntry, ...] | None = None
    layout: str | None = None
    arm: Positive | None = None
    spacing: tuple[Positive, Positive] | None = None
    arm_std: NotNegative = 0.0
    propeller: Propeller | None = None
    order: Order = "px4"
    imu: ImuEntry | None = None
    imu_tilt_deg: tuple[Tilt, Tilt] | None = None
    imu_tilt_std_deg: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_description(self) -> AirframeEntry:
        if (self.rotors is None) == (self.layout is None):
            raise ValueError(
                "give either rotors = [ { position = [x, y, z], spin = 'ccw' }, ... ] "
                "or layout = 'quad-x' with spacing = [0.18, 0.24] or arm = 0.15 (and order)"
            )
        if self.layout is not None and (self.arm is None) == (self.spacing is None):
            raise ValueError(
                "layout needs either spacing = [x, y], front to back and left to right between the "
                "motor axes, or arm, from the centre to a motor axis [m]"
            )
        if self.rotors is None:
            self._refuse_unknown_layout()
        else:
            self._refuse_odd_rotors(self.rotors)
        if self.imu is not None:
            self._refuse_far_imu(self.imu)
        return self

    def tolerances(self) -> dict[str, float]:
        """Return further declared standard deviations [SI], by the name of their interval term."""
        return {"IMU mounting": math.radians(self.imu_tilt_std_deg)}

    def _refuse_unknown_layout(self) -> None:
        try:
            rotors = self.of_layout()
        except ExperimentError as error:
            raise ValueError(str(error)) from error
        refuse_impossible_arms([rotor.position for rotor in rotors])

    def _refuse_far_imu(self, imu: ImuEntry) -> None:
        rotors = self.of_layout() if self.rotors is None else self.rotors
        places = np.array([rotor.position for rotor in rotors], dtype=float)
        centre = places.mean(axis=0)
        arm = float(np.linalg.norm(places - centre, axis=1).max())
        distance = math.dist(centre.tolist(), imu.position)
        if distance > FARTHEST_IMU * arm:
            raise ValueError(
                f"the IMU is {distance:.4g} m from the centre of the rotors, whose longest arm is "
                f"{arm:.3g} m: imu = {{ position }} is in metres (2 cm is 0.02), from the same "
                "origin as the rotors' positions"
            )

    def of_layout(self) -> tuple[Rotor, ...]:
        """Place the rotors of the named layout, FLU."""
        layout = self.layout or ""
        if self.spacing is not None:
            return spaced_rotors(layout, spacing=self.spacing, order=self.order)
        return layout_rotors(layout, arm=self.arm or 0.0, order=self.order)

    def _refuse_odd_rotors(self, rotors: tuple[RotorEntry, ...]) -> None:
        if not 3 <= len(rotors) <= 16:
            raise ValueError(f"{len(rotors)} rotors; a multirotor has 3 to 16")
        refuse_impossible_arms([rotor.position for rotor in rotors])
        if {"arm", "spacing", "order"} & self.model_fields_set:
            raise ValueError(
                "arm, spacing and order belong to layout; listed rotors have positions"
            )
        # Coaxial rotors may share a position, but then they turn against each other.
        places = [(rotor.position, rotor.spin) for rotor in rotors]
        for number, place in enumerate(places, start=1):
            first = places.index(place) + 1
            if first != number:
                raise ValueError(
                    f"rotors {first} and {number} are both at {list(place[0])} and turn {place[1]}"
                )


def refuse_impossible_arms(positions: Sequence[Sequence[float]]) -> None:
    """Raise ValueError where rotors are so near or far from the centre that metres are unlikely."""
    places = np.array([position[:2] for position in positions], dtype=float)
    with np.errstate(over="ignore"):
        arm = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())
        farthest = float(np.linalg.norm(places, axis=1).max())
    if arm >= SHORTEST_ARM and max(arm, farthest) <= LONGEST_ARM:
        return
    distance = arm if arm < SHORTEST_ARM else max(arm, farthest)
    raise ValueError(
        f"the rotors are {distance:.4g} m from the centre, expected {SHORTEST_ARM:g} to "
        f"{LONGEST_ARM:g} m: positions and arm are in metres (25 cm is 0.25)"
    )
