"""Places and spins of the rotors as the flight itself shows them, where no airframe is given.

For a look at a flight before its airframe is known, not for an estimate.
"""

from __future__ import annotations

from itertools import combinations, permutations
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.fit.dataset.declared_rotors import BETTER, response
from rotorfit.fit.dataset.response_signals import BAND
from rotorfit.fit.reduction.frequency_bands import PILOT_BAND, prepared_bands
from rotorfit.flight.filters import butterworth, filter_both_ways
from rotorfit.flight.signals import whole_samples
from rotorfit.model.vehicle import Rotor, Vehicle, layout_rotors, reversed_rotor
from rotorfit.tools.inspection.flown_part import SPINS_UNSURE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.reduction.reduce import Lines
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.prepare import PreparedFlight

Convention = Literal["px4", "betaflight", "crazyflie", "paper"]
CONVENTIONS: Final[tuple[Convention, ...]] = ("px4", "betaflight", "crazyflie", "paper")
LAYOUTS: Final = {
    4: ("quad-x", "quad-plus"),
    6: ("hexa-x", "hexa-plus"),
    8: ("octo-x", "octo-plus", "octo-coax-x"),
}
LEAST_ORDER_FIT: Final = 0.4
"""Share of roll and pitch that a motor order must explain before it is named."""
LEAST_YAW: Final = 0.1
"""Share of yaw that the spins must explain before they are believed."""
SPREAD: Final = 0.15
"""Deviation of the rotors' places on each axis; any will do [m]."""
MOST_TRIED: Final = 12
"""Rotors up to which every pattern of spins is tried; above, they alternate."""
LEAST_SPIN_FIT: Final = 0.3
"""Share of what the best spins explain of yaw from which others might be the true ones."""
MOST_SPINS: Final = 6
LEAST_MOVED: Final = 0.02
"""Motion of the rotors against each other, over the strongest, below which it is noise: six rotors
are moved in four ways only."""


def likely_motors(factors: Factors, made_for: Vehicle) -> tuple[Vehicle, str] | None:
    """Select the known layout and motor order that the flight confirms, and name it.

    The spins of `made_for` are in the signals of `factors`.
    """
    tried = [
        (response(factors, vehicle, made_for=made_for), vehicle, name)
        for vehicle, name in _usual_vehicles(len(made_for.rotors))
    ]
    found = [one for one in tried if min(one[0].roll, one[0].pitch) > LEAST_ORDER_FIT]
    if not found:
        return None
    best, vehicle, name = max(found, key=lambda one: one[0].score)
    return vehicle, name if best.yaw > LEAST_YAW else f"{name} ({SPINS_UNSURE})"


def confirmed_motors(
    timed: PreparedFlight, *, body: tuple[Lines, ...]
) -> tuple[Vehicle, str] | None:
    """Select and name the layout and order that a timed flight confirms.

    `body`: the lines of its body, which are the same for all layouts.
    """
    return likely_motors(*factors_on_circle(timed, body=body))


def factors_on_circle(timed: PreparedFlight, *, body: tuple[Lines, ...]) -> tuple[Factors, Vehicle]:
    """Reduce a timed flight for `likely_motors` and `own_order`, with rotors on a circle."""
    circle = rotors_on_circle(timed.data.rotor_speed.shape[1])
    return prepared_bands(timed, circle, None, body=body, top=BAND[1]), circle


def own_order(factors: Factors, circle: Vehicle, confirmed: Vehicle | None) -> Vehicle | None:
    """Find the motor order of a quadrotor, any at all, by which a flight responds.

    None where the flight shows none, or not the spins, or where `confirmed`, the vehicle of a known
    order, explains it as well; the rest is from `factors_on_circle`.
    """
    if len(circle.rotors) != 4:
        return None
    tried = [(response(factors, v, made_for=circle), v) for v in _quadrotors_in_any_order()]
    best, vehicle = max(tried, key=lambda one: one[0].score)
    is_shown = min(best.roll, best.pitch) > LEAST_ORDER_FIT and best.yaw > LEAST_YAW
    if confirmed is None:
        others = [r for r, v in tried if not np.array_equal(v.positions, vehicle.positions)]
    else:
        others = [response(factors, confirmed, made_for=circle)]
    is_clear = all(best.gain_over(other) > BETTER for other in others)
    return vehicle if is_shown and is_clear else None


def _quadrotors_in_any_order() -> Iterator[Vehicle]:
    """Yield quad-x and quad-plus in every motor order, propellers in and out."""
    for layout in LAYOUTS[4]:
        rotors = layout_rotors(layout, arm=0.2, order="px4")
        for numbered in permutations(rotors):
            yield Vehicle(rotors=numbered)
            yield Vehicle(rotors=tuple(reversed_rotor(rotor) for rotor in numbered))


def _usual_vehicles(rotor_count: int) -> Iterator[tuple[Vehicle, str]]:
    """Yield vehicles of the usual layouts and orders with their names, propellers in and out."""
    for layout in LAYOUTS.get(rotor_count, ()):
        for order in CONVENTIONS:
            try:
                rotors = tuple(layout_rotors(layout, arm=0.2, order=order))
            except ExperimentError:
                continue
            name = f'layout = "{layout}", order = "{order}"'
            yield Vehicle(rotors=rotors), name
            turned = tuple(reversed_rotor(rotor) for rotor in rotors)
            yield Vehicle(rotors=turned), f"{name} with every spin reversed (list the rotors)"


def rotors_on_circle(rotor_count: int) -> Vehicle:
    """Return rotors on a circle, where only their number counts."""
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


def guessed_vehicles(data: FlightData) -> list[Vehicle]:
    """Guess the places and spins of rotors from the response of a flight, up to a scale.

    All axes are upright. One or a few vehicles that differ by their spins, the likeliest first.
    Roll and pitch respond to each rotor's squared speed by its place, yaw by its spin; the scale is
    unknown, and excitation does not depend on it. Rotor speeds are those at the time of the motion.
    """
    turn, squares, slopes = _slow_signals(data)
    roll, pitch = (
        _scale_to_places(_solve_columns(squares, turn[:, 0])),
        _scale_to_places(_solve_columns(squares, turn[:, 1])),
    )
    places = [(float(-p), float(r), 0.0) for r, p in zip(roll, pitch, strict=True)]
    return [
        Vehicle(
            rotors=tuple(
                Rotor(position=place, spin="ccw" if spin > 0 else "cw")
                for place, spin in zip(places, spins, strict=True)
            )
        )
        for spins in _find_spins(turn[:, 2], squares, slopes)
    ]


def _slow_signals(
    data: FlightData,
) -> tuple[Float[np.ndarray, "z 3"], Float[np.ndarray, "z N"], Float[np.ndarray, "z N"]]:
    """Return turn, squared speeds and their slopes as a factor, in the pilot's band."""
    low, high = PILOT_BAND
    sos = butterworth(2, (low, min(high, 0.45 * data.sample_rate)), data.sample_rate)
    count = data.rotor_speed.shape[1]
    wide = 3 + 2 * count
    factor = np.zeros((0, wide))
    for s in data.segments:
        if len(s) < whole_samples(data.sample_rate / low):
            continue
        rows = slice(s.start, s.stop)
        columns = np.column_stack(
            [
                data.angular_acceleration[rows],
                data.rotor_speed[rows] ** 2,
                data.rotor_acceleration[rows],
            ]
        )
        slow = filter_both_ways(sos, columns)
        factor = np.linalg.qr(np.concatenate([factor, slow]), mode="r")
    # Never fewer rows than columns, so that a flight without a long stretch is no special case.
    factor = np.concatenate([factor, np.zeros((wide, wide))])
    return factor[:, :3], factor[:, 3 : 3 + count], factor[:, 3 + count :]


def _solve_columns(
    columns: Float[np.ndarray, "z k"], target: Float[np.ndarray, " z"]
) -> Float[np.ndarray, " k"]:
    solved: Float[np.ndarray, " k"] = np.linalg.pinv(columns, LEAST_MOVED) @ target
    return solved


def _scale_to_places(response: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Scale the response of an axis to each rotor to places along the other axis [m]."""
    places = response - response.mean()
    size = float(np.sqrt((places**2).mean()))
    # Where nothing responds, any place is as good as another, but for all at one.
    return np.linspace(-SPREAD, SPREAD, len(response)) if size == 0.0 else SPREAD * places / size


def _find_spins(
    turn: Float[np.ndarray, " z"],
    squares: Float[np.ndarray, "z N"],
    slopes: Float[np.ndarray, "z N"],
) -> list[Float[np.ndarray, " N"]]:
    """Find the spins, +1 for ccw, whose drag and spin-up explain yaw, the best first."""
    count = squares.shape[1]
    tried: list[tuple[float, Float[np.ndarray, " N"]]] = []
    for pattern in _spin_patterns(count):
        columns = np.column_stack([squares @ pattern, slopes @ pattern])
        lengths = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(lengths > 0, lengths, 1.0)
        weights = _solve_columns(columns, turn)
        # Drag and spin-up both turn the body against the rotor.
        spins = -pattern if weights.sum() > 0 else pattern
        tried.append((float(turn @ columns @ weights), spins))
    best = max(explained for explained, _ in tried)
    likely = [one for one in tried if one[0] >= LEAST_SPIN_FIT * best]
    likely.sort(key=lambda one: -one[0])
    return [spins for _, spins in likely[:MOST_SPINS]]


def _spin_patterns(count: int) -> Iterator[Float[np.ndarray, " N"]]:
    """Yield the patterns of as many ccw as cw (or one more), each once but for its sign."""
    if count > MOST_TRIED:
        yield np.array([(-1.0) ** i for i in range(count)])
        return
    for ccw in combinations(range(1, count), (count + 1) // 2 - 1):
        pattern = -np.ones(count)
        pattern[[0, *ccw]] = 1.0
        yield pattern
