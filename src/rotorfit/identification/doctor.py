"""What one log could tell, cheaply: excitation of each axis, and whose motor order it has."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.estimation.factors import Factors
from rotorfit.flight.data import FlightData
from rotorfit.flight.doctor import LOOK
from rotorfit.flight.motors import MotorResponse
from rotorfit.flight.prepare import PreparedFlight
from rotorfit.flight.signals import smooth
from rotorfit.identification.bands import EDGES, STRETCH
from rotorfit.identification.excitation import LEAST_EXCITATION, NO_EXCITATION
from rotorfit.identification.flights import retimed
from rotorfit.identification.frame_check import Response, free_response, response
from rotorfit.model.layouts import layout_rotors
from rotorfit.model.reduce import BandPlan, band_factors
from rotorfit.model.vehicle import Rotor, Vehicle

Axis = Literal["roll", "pitch", "yaw"]
Prospect = Literal["well", "roughly", "not"]
Convention = Literal["px4", "betaflight", "crazyflie", "paper"]

AXES: Final[tuple[Axis, ...]] = ("roll", "pitch", "yaw")
CONVENTIONS: Final[tuple[Convention, ...]] = ("px4", "betaflight", "crazyflie", "paper")
LAYOUTS: Final = {
    4: ("quad-x", "quad-plus"),
    6: ("hexa-x", "hexa-plus"),
    8: ("octo-x", "octo-plus", "octo-coax-x"),
}
CLEAR: Final = 0.4
"""Share of roll and pitch that a motor order must explain before it is named."""
LEAST_YAW: Final = 0.1
"""Share of yaw that the spins must explain before they are believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """How one axis was moved.

    Attributes
    ----------
    turning
        Deviation of the angular acceleration below 15 Hz [rad/s^2].
    rho
        Its power that the motors explain over the rest: what limits an estimate.
    """

    axis: Axis
    turning: float
    rho: float

    @property
    def prospect(self) -> Prospect:
        """How well numbers of this axis can be found."""
        if self.rho <= NO_EXCITATION:
            return "not"
        return "well" if self.rho > LEAST_EXCITATION else "roughly"


@dataclass(frozen=True, slots=True, kw_only=True)
class Prospects:
    """What a flight could tell.

    Attributes
    ----------
    excitation
        Of roll, pitch and yaw.
    thrust_change
        Deviation of the thrust over its mean.
    motors
        The layout and order whose motors explain the motion, in words; None where none does.
    """

    excitation: tuple[Excitation, ...]
    thrust_change: float
    motors: str | None


def prospects(prepared: PreparedFlight, motors: MotorResponse | None = None) -> Prospects:
    """Return what a prepared flight could tell, whatever its airframe.

    Parameters
    ----------
    prepared
        The flight.
    motors
        How late the motors do what their data say; None leaves the flight as it was prepared.
    """
    prepared = replace(prepared, data=retimed(prepared, motors))
    data = prepared.data
    stand_in = _stand_in(data.rotor_speed.shape[1])
    factors = _factors(prepared, stand_in)
    shares = free_response(factors, stand_in).shares
    known = likely_motors(factors, stand_in)
    if known is not None:
        # With the spins known the spin-up of the rotors counts, too.
        shares = np.maximum(shares, response(_factors(prepared, known[0]), known[0]).shares)
    shares = np.clip(shares, 0.0, 0.999)
    rows = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    return Prospects(
        excitation=tuple(
            Excitation(axis=axis, turning=size, rho=float(share / (1.0 - share)))
            for axis, size, share in zip(AXES, _turning(data), shares, strict=True)
        ),
        thrust_change=_thrust_change(data, rows),
        motors=None if known is None else known[1],
    )


def likely_motors(factors: Factors, made_for: Vehicle) -> tuple[Vehicle, str] | None:
    """Return the known layout and motor order that the flight bears out, and its words.

    Parameters
    ----------
    factors, made_for
        Of the flight, and the rotors whose spins are in its signals.
    """
    tried = [
        (response(factors, other, made_for=made_for), other, words)
        for other, words in _known(len(made_for.rotors))
    ]
    found = [one for one in tried if _bears_out(one[0])]
    if not found:
        return None
    best, vehicle, words = max(found, key=lambda one: one[0].score)
    return vehicle, words if best.yaw > LEAST_YAW else f"{words} (spins unsure: yaw hardly moves)"


def _bears_out(found: Response) -> bool:
    return found.roll > CLEAR and found.pitch > CLEAR


def _known(rotor_count: int) -> Iterator[tuple[Vehicle, str]]:
    """Yield vehicles of the common layouts and orders, propellers in and out."""
    for layout in LAYOUTS.get(rotor_count, ()):
        for order in CONVENTIONS:
            try:
                rotors = tuple(layout_rotors(layout, arm=0.2, order=order))
            except ExperimentError:
                continue
            name = f'layout = "{layout}", order = "{order}"'
            yield Vehicle(rotors=rotors), name
            turned = tuple(replace(r, spin="cw" if r.spin == "ccw" else "ccw") for r in rotors)
            yield Vehicle(rotors=turned), f"{name} with every spin reversed (list the rotors)"


def _stand_in(rotor_count: int) -> Vehicle:
    """Return rotors on a circle: only their number counts where places are free."""
    angles = 2.0 * np.pi * np.arange(rotor_count) / rotor_count
    return Vehicle(
        rotors=tuple(
            Rotor(
                position=(float(0.2 * np.cos(a)), float(0.2 * np.sin(a)), 0.0),
                spin="ccw" if i % 2 else "cw",
            )
            for i, a in enumerate(angles)
        )
    )


def _factors(prepared: PreparedFlight, vehicle: Vehicle) -> Factors:
    data = replace(prepared.data, segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return band_factors(data, vehicle, plan=BandPlan(edges=edges, longest=STRETCH))


def _turning(data: FlightData) -> list[float]:
    """Return the deviation of each angular acceleration below 15 Hz [rad/s^2]."""
    parts = [
        smooth(data.angular_acceleration[s.start : s.stop], data.sample_rate, LOOK)
        for s in data.segments
    ]
    return [float(x) for x in np.concatenate(parts).std(axis=0)]


def _thrust_change(data: FlightData, rows: np.ndarray) -> float:
    squares = (data.rotor_speed[rows] ** 2).sum(axis=1)
    return float(squares.std() / squares.mean()) if len(rows) else 0.0
