"""Do the declared rotors explain the sign of the vehicle's response? Refuse what they contradict.

Roll and pitch must accelerate with the torque of the thrusts, yaw with that of drag and spin-up.
The check looks at the share of each angular acceleration that the torque of the declared rotors
explains, and compares it with other declarations: spins reversed, axes turned, motors in another
order. Where another one explains the flight much better, or the motors explain it but no torque
of the declared rotors does, the declaration is wrong and every number would be.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FrameError
from rotorfit.fit.dataset.coupled_turns import (
    with_coupled_tilts,
    with_coupled_yaw,
    yaw_by_drag,
)
from rotorfit.fit.dataset.plausible_units import refuse_implausible_size
from rotorfit.fit.dataset.response_signals import (
    CLEAR,
    Response,
    explained_share,
    inside_band,
    remove_parallel,
    rotor_patterns,
    select_response_band,
    square_columns,
)
from rotorfit.fit.dataset.turned_imu import refuse_turned
from rotorfit.fit.reduction.frequency_bands import prepared_bands
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.flight.imu_tilt import LEAST_TILT, mean_force_tilt, tilt_phrase
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.signals import signal_layout
from rotorfit.model.vehicle import LAYOUTS, Rotor, Vehicle, layout_rotors, reversed_rotor

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.experiment.experiment import MotorsEntry

BETTER = 0.6
"""Log of how many times less another declaration leaves unexplained, summed over the axes."""
COUPLED: Final = 0.3
"""The same where roll and pitch may mix by a product of inertia."""
ALIKE = 0.02
"""Declarations whose scores differ by less explain the flight equally well."""
LAGS_TRIED = (LAG_PRIOR[0], 0.06, 0.1, 0.012)
"""Of motors whose lag is not known [s]: a refusal holds for all of them. At one that is too short
a vehicle that circles in roll and pitch, as in a limit cycle, responds as if its IMU was turned."""
PARALLEL = 1e-9
"""Share of two drives' product of squares, up to which they are one."""


def response(factors: Factors, vehicle: Vehicle, *, made_for: Vehicle | None = None) -> Response:
    """Compute the shares by which the rotors explain the response of each axis.

    `made_for`: the vehicle whose spins are in the signals; None: this one. Of other spins the
    spin-up of the rotors is left out, and yaw has the drag alone.
    """
    declared = made_for or vehicle
    return _response_by_rotors(
        signal_products(inside_band(factors), declared), vehicle, declared=declared
    )


def free_response(factors: Factors, vehicle: Vehicle) -> Response:
    """Compute the shares that the rotors' squared speeds explain, wherever the rotors are."""
    R, layout = inside_band(factors), signal_layout(vehicle)
    squares = R[:, square_columns(vehicle)]
    thrust = squares @ vehicle.axes[:, 2]
    shares = [
        explained_share(
            remove_parallel(R[:, [layout.index(name)]], thrust)[:, 0],
            remove_parallel(squares, thrust),
        )
        for name in ("dwx", "dwy", "dwz")
    ]
    return Response(roll=shares[0], pitch=shares[1], yaw=shares[2])


def signal_products(R: Float[np.ndarray, "z z"], declared: Vehicle) -> Float[np.ndarray, "c c"]:
    """Return the products of roll, pitch, yaw, the rotors' spin-up and their squared speeds."""
    layout = signal_layout(declared)
    named = [layout.index(name) for name in ("dwx", "dwy", "dwz", "dHz")]
    columns = R[:, [*named, *square_columns(declared)]]
    return columns.T @ columns


def _response_by_rotors(
    products: Float[np.ndarray, "c c"], vehicle: Vehicle, *, declared: Vehicle
) -> Response:
    """Compute the response by these rotors, from the products made for the declared ones."""
    roll, pitch, yaw = _signed_shares(products, drive_columns(vehicle, declared)).tolist()
    return Response(roll=roll, pitch=pitch, yaw=yaw)


def drive_columns(vehicle: Vehicle, declared: Vehicle) -> Float[np.ndarray, "3 4 c"]:
    """Return for roll, pitch and yaw the thrust, signal and drive, of `signal_products`.

    One drive or two; zeros stand for none.
    """
    s = vehicle.spins
    one = np.eye(4, 4 + len(s))
    drives = np.pad(rotor_patterns(vehicle).T, ((0, 0), (4, 0)))
    thrust, roll, pitch, drag = drives
    agree = float(s @ declared.spins) / len(s)
    # The signal of the rotors' spin-up holds the declared spins: it serves all or none.
    spin_up = -agree * one[3] if abs(agree) == 1.0 else np.zeros(len(thrust))
    none = np.zeros(len(thrust))
    return np.array(
        [
            [thrust, one[0], roll, none],
            [thrust, one[1], pitch, none],
            [thrust, one[2], drag, spin_up],
        ]
    )


def _signed_shares(
    products: Float[np.ndarray, "c c"], drives: Float[np.ndarray, "*v 4 c"]
) -> Float[np.ndarray, "*v"]:
    """Return the share of each signal that its drives with coefficients of one sign explain."""
    Q = drives @ products @ np.swapaxes(drives, -1, -2)
    # What varies with the total thrust is left out: it acts on a CoM that is off the centre.
    size = Q[..., 0, 0, None, None]
    level = np.where(size > 0.0, size, 1.0)
    rest = Q[..., 1:, 1:] - (size > 0.0) * Q[..., 1:, :1] * Q[..., :1, 1:] / level
    total, b = np.maximum(rest[..., 0, 0], 0.0), rest[..., 1:, 0]
    own = np.diagonal(rest, axis1=-2, axis2=-1)[..., 1:]
    known = own > np.finfo(float).eps * np.diagonal(Q, axis1=-2, axis2=-1)[..., 2:]
    known &= (total > 0.0)[..., None]
    # Each drive alone explains with its own sign.
    alone = _divide_where(b * np.abs(b), own * total[..., None], known)
    (D, E), cross = np.moveaxis(own, -1, 0), rest[..., 1, 2]
    determinant = D * E - cross**2
    both = known.all(axis=-1) & (determinant > PARALLEL * D * E)
    x = _divide_where(E * b[..., 0] - cross * b[..., 1], determinant, both)
    y = _divide_where(D * b[..., 1] - cross * b[..., 0], determinant, both)
    together = _divide_where(
        np.sign(x) * (x * b[..., 0] + y * b[..., 1]), total, both & (x * y > 0.0)
    )
    shares = np.concatenate([alone, together[..., None]], axis=-1)
    best = np.abs(shares).argmax(axis=-1)
    return np.take_along_axis(shares, best[..., None], axis=-1)[..., 0]


def _divide_where(
    above: Float[np.ndarray, "*v"], below: Float[np.ndarray, "*v"], where: Bool[np.ndarray, "*v"]
) -> Float[np.ndarray, "*v"]:
    """Return quotients, zero elsewhere."""
    return np.where(where, above, 0.0) / np.where(where, below, 1.0)


def check_frame(factors: Factors, vehicle: Vehicle) -> Response:
    """Return the response of the declared rotors, or refuse their declaration.

    Raises `FrameError` if the data contradict it; the message says which declaration would fit, or
    that no body on these arms can respond as the gyro says.
    """
    R = inside_band(factors)
    products = signal_products(R, vehicle)
    declared = _response_by_rotors(products, vehicle, declared=vehicle)
    every, words = _others_tried(products, vehicle, declared)
    scores = every.sum(axis=1)
    roll, pitch, yaw = every[int(np.argmax(scores))].tolist()
    best = Response(roll=roll, pitch=pitch, yaw=yaw)
    free = free_response(factors, vehicle)
    drives = drive_columns(vehicle, vehicle), _other_drives(vehicle)[0][int(np.argmax(scores))]
    coupled, best_coupled = (
        with_coupled_tilts(found, products, drive)
        for found, drive in zip((declared, best), drives, strict=True)
    )
    seen = (
        f"the declared rotors explain roll, pitch and yaw by {_shown_response(declared)} "
        "(+1: fully, 0: not at all, -1: reversed)"
    )
    better = best.fits and best.gain_over(declared) > BETTER
    better = better and best_coupled.gain_over(coupled) > COUPLED
    better = better and _is_sure(best, declared, R, vehicle)
    if better and not _is_hidden(best, free):
        # The simplest that fit come first; where several fit alike, two are named.
        alike = [words[int(i)] for i in np.flatnonzero(scores > best.score - ALIKE)[:2]]
        raise FrameError(
            f"{seen}; with {', or with '.join(alike)}, they would respond {_shown_response(best)}: "
            "correct the rotors' order and spin, or the log's axes"
        )
    refuse_turned(factors, vehicle)
    if better or _is_hidden(with_coupled_yaw(coupled, free, R, vehicle), free):
        raise FrameError(
            f"{seen}; with rotor positions left free, the speeds explain {_shown_response(free)}: "
            "check the rotors' positions, order and spin, and the log's axes"
        )
    refuse_implausible_size(select_response_band(factors), vehicle)
    return declared


def _is_sure(best: Response, declared: Response, R: np.ndarray, vehicle: Vehicle) -> bool:
    """Return whether another declaration may be taken for right before the fit."""
    others = np.abs(best.shares - declared.shares)[:2]
    # Where it changes yaw alone, yaw must follow the drag of the declared rotors reversed whatever
    # roll and pitch torques do to it: by products of inertia or tilted motors they turn about z,
    # and an autopilot that holds yaw opposes that by drag of either sign.
    return bool(others.max() > ALIKE) or yaw_by_drag(R, vehicle) < -CLEAR


FEWEST_TO_STEER: Final = 4
"""Rotors that thrust, roll, pitch and yaw take to be commanded apart."""
SPINNING: Final = 1.0
"""Rate about z of a vehicle that does not hold its heading [rad/s]: a turn in six seconds."""


def check_flights(flights: list[LoadedFlight], vehicle: Vehicle, motors: MotorsEntry) -> None:
    """Refuse the declared rotors if a flight contradicts them: with the declaration that would fit.

    Commands are looked at behind the lag that motors usually have: without it, what an autopilot
    responds in a hover to the noise of its gyro looks like a response with the sign reversed.
    `motors`: whether commanded, and whether their lag is in the flights already.
    """
    lagging = motors.speed == "measured" or motors.lag is not None
    tried = [MotorResponse(lag=lag, delay=motors.delay or 0.0) for lag in LAGS_TRIED]
    for flight in flights:
        refuse_held_heading(flight, vehicle)
        check_flight(flight, vehicle, [None] if lagging else tried)


def refuse_held_heading(flight: LoadedFlight, vehicle: Vehicle) -> None:
    """Raise where a vehicle holds its heading that has too few rotors to do so.

    Thrust, roll and pitch take the speeds of three fixed rotors, and such a vehicle spins.
    """
    turn = float(np.median(np.abs(flight.prepared.data.angular_velocity[:, 2])))
    if len(vehicle.rotors) >= FEWEST_TO_STEER or turn > SPINNING:
        return
    raise FrameError(
        f"{Path(flight.entry.file).name}: {len(vehicle.rotors)} rotors cannot hold a heading by "
        f"their speeds, but this vehicle does (it turns at {turn:.2g} rad/s): list every rotor "
        "that it has, and log all of them; a tricopter, whose servo tilts the tail rotor, cannot "
        "be identified"
    )


def check_flight(
    flight: LoadedFlight, vehicle: Vehicle, tried: Sequence[MotorResponse | None]
) -> None:
    """Refuse the declared rotors if a flight contradicts them with every response of the motors.

    Raises `FrameError`: with what the first response that was tried shows.
    """
    refused: FrameError | None = None
    for response in tried:
        try:
            check_frame(prepared_bands(flight.prepared, vehicle, response), vehicle)
            return
        except FrameError as error:
            refused = refused or error
    assert refused is not None
    raise FrameError(
        f"{Path(flight.entry.file).name}: {refused}{_describe_lean(flight)}"
    ) from refused


def _describe_lean(flight: LoadedFlight) -> str:
    """Describe a thrust that leans in the IMU's axes: rotors may seem wrong by it."""
    tilt = mean_force_tilt([flight.prepared.data])
    if tilt.angle < LEAST_TILT:
        return ""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"; or the IMU is mounted {tilt_phrase(tilt)}, as the thrust leans in its axes: declare "
        f"imu_tilt_deg = [{roll:.1f}, {pitch:.1f}] under [airframe]"
    )


def _others_tried(
    products: Float[np.ndarray, "c c"], vehicle: Vehicle, declared: Response
) -> tuple[Float[np.ndarray, "o 3"], tuple[str, ...]]:
    """Return the response of other declarations, in words, too."""
    drives, same_pattern, words = _other_drives(vehicle)
    shares = _signed_shares(products, drives)
    yaw = shares[:, 2]
    # For another pattern of spins the spin-up cannot be tried: where drag alone explains half of
    # what is explained with it, that is not held against it.
    excused = ~same_pattern & ~(yaw < 0.5 * declared.yaw)
    shares[:, 2] = np.where(excused, np.maximum(yaw, declared.yaw), yaw)
    return shares, words


@lru_cache(maxsize=4)
def _other_drives(
    vehicle: Vehicle,
) -> tuple[Float[np.ndarray, "o 3 4 c"], Bool[np.ndarray, " o"], tuple[str, ...]]:
    """Compute the drives of roll, pitch and yaw by other declarations, and which keep the spins."""
    others, words = zip(*_other_declarations(vehicle), strict=True)
    agree = np.array([float(other.spins @ vehicle.spins) for other in others])
    drives = np.array([drive_columns(other, vehicle) for other in others])
    return drives, np.abs(agree) == len(vehicle.rotors), words


def _is_hidden(found: Response, free: Response) -> bool:
    """Whether the rotors explain an axis that a declaration does not."""
    return bool(((free.shares > 1.0 - CLEAR) & (found.shares < CLEAR)).any())


def _shown_response(found: Response) -> str:
    return f"{found.roll:+.2f}, {found.pitch:+.2f}, {found.yaw:+.2f}"


def _other_declarations(vehicle: Vehicle) -> Iterator[tuple[Vehicle, str]]:
    """Yield other declarations of the same rotors, the simplest first, in words."""
    rotors = vehicle.rotors
    flipped = "every spin reversed (props out instead of in)"
    yield _with_rotors(vehicle, map(reversed_rotor, rotors)), flipped
    yield _mirror_vehicle(vehicle), "the gyro's y and z reversed (FRD axes where FLU is declared)"
    yield _swapped_sides(vehicle), "the rotors' y reversed (FRD positions where FLU is declared)"
    for quarters in (1, 2, 3):
        words = f"the rotors turned by {90 * quarters} degrees counter-clockwise (a turned IMU)"
        turned = [_turn_rotor(rotor, quarters) for rotor in rotors]
        yield _with_rotors(vehicle, turned), words
        yield _with_rotors(vehicle, map(reversed_rotor, turned)), f"{words} and {flipped}"
    for order in _other_orders(len(rotors)):
        ordered = [rotors[i] for i in order]
        named = ", ".join(str(i + 1) for i in order)
        words = f"your rotors listed in the order {named}{_named_order(ordered)}"
        yield _with_rotors(vehicle, ordered), words
        yield _with_rotors(vehicle, map(reversed_rotor, ordered)), f"{words} and {flipped}"
        moved = [replace(o, spin=r.spin) for o, r in zip(ordered, rotors, strict=True)]
        if moved != ordered:
            words = f"the positions alone, without the spins, listed in the order {named}"
            yield _with_rotors(vehicle, moved), words


SAME_SEAT: Final = 0.94
"""Cosine of the 20 degrees, seen from the middle, within which a rotor is at a layout's."""


@cache
def _layout_seats(layout: str, order: str) -> tuple[Rotor, ...]:
    """Return the rotors of a named layout with arms of 1 m; each other declaration asks for all."""
    return layout_rotors(layout, arm=1.0, order=order)


def _named_order(rotors: Sequence[Rotor]) -> str:
    """Name the autopilot whose order of a layout the rotors are in; empty without one."""
    places = np.array([rotor.position[:2] for rotor in rotors])
    places = places - places.mean(axis=0)
    for layout, order in LAYOUTS:
        seats = _layout_seats(layout, order)
        if [seat.spin for seat in seats] != [rotor.spin for rotor in rotors]:
            continue
        along = (places * np.array([seat.position[:2] for seat in seats])).sum(axis=1)
        if bool((along >= SAME_SEAT * np.linalg.norm(places, axis=1)).all()):
            return f' (layout = "{layout}", order = "{order}")'
    return ""


def _other_orders(n: int) -> list[tuple[int, ...]]:
    """Return other orders of the rotors: all of a quadrotor's, else only swaps of two."""
    identity = tuple(range(n))
    if n <= 4:
        return sorted(
            (order for order in permutations(identity) if order != identity),
            key=lambda order: sum(i != k for i, k in enumerate(order)),
        )
    orders: list[tuple[int, ...]] = []
    for i in range(n):
        for k in range(i + 1, n):
            swapped = list(identity)
            swapped[i], swapped[k] = k, i
            orders.append(tuple(swapped))
    return orders


def _with_rotors(vehicle: Vehicle, rotors: Iterable[Rotor]) -> Vehicle:
    return replace(vehicle, rotors=tuple(rotors))


def _turn_rotor(rotor: Rotor, quarters: int) -> Rotor:
    """Return a rotor turned by quarters of a turn about z, counter-clockwise from above."""
    (x, y, z), (nx, ny, nz) = rotor.position, rotor.axis
    for _ in range(quarters):
        x, y, nx, ny = -y, x, -ny, nx
    return replace(rotor, position=(x, y, z), axis=(nx, ny, nz))


def _mirror_vehicle(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle that responds like this one seen by a gyro with y and z reversed."""
    return _with_rotors(vehicle, (_mirror_rotor(reversed_rotor(rotor)) for rotor in vehicle.rotors))


def _swapped_sides(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with every rotor on the other side, its spin kept: seen from above."""
    return _with_rotors(vehicle, (_other_side(rotor) for rotor in vehicle.rotors))


def _other_side(rotor: Rotor) -> Rotor:
    (x, y, z), (nx, ny, nz) = rotor.position, rotor.axis
    return replace(rotor, position=(x, -y, z), axis=(nx, -ny, nz))


def _mirror_rotor(rotor: Rotor) -> Rotor:
    """Return a rotor mirrored front to back."""
    (x, y, z), (nx, ny, nz) = rotor.position, rotor.axis
    return replace(rotor, position=(-x, y, z), axis=(-nx, ny, nz))
