r"""Check the units of gyro, arms and rotor speeds by the flight itself.

Two references. Over some seconds of flight the specific force, turned by the gyro into axes that do
not rotate, has the mean of gravity (see `weight_balance`); with a gyro in deg/s that is taken for
rad/s it averages out. And the angular acceleration that a difference of thrusts makes gives the
radius of gyration over the arm, whatever the mass: with the thrust of a rotor :math:`k_t O^2`,
:math:`a_z = c \sum O_i^2` with :math:`c = k_t / m`, and the roll acceleration is :math:`s \sum y_i
O_i^2` with :math:`s = k_t / I_{xx}`, so that :math:`I_{xx} / m = c / s`. Bodies are not ten times
larger or smaller than their arms.

The speed of hovering rotors has bounds, too: their radius is a quarter of the arm at the least and
nine tenths at the most, and the tips of what hovers make 40 to 130 m/s.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.errors import FlightError, FrameError
from rotorfit.fit.dataset.weight_balance import held_up, hovering, turning
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.flight_checks import UNIT_OF_GYRO
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import AS_A_TABLE
from rotorfit.model.signals import signal_layout
from rotorfit.model.terms.body import ACCEL_BIAS_STD

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

WINDOW: Final = 0.5
"""Length of the pieces that are or are not at rest [s]."""
LEAST_REST: Final = 1.0
"""Least rest in all, below which nothing is reported [s]."""
QUIET: Final = 0.03
"""Deviation of the gyro at rest at most [rad/s]."""
STEADY: Final = 0.5
"""The same of the accelerometer [m/s^2]."""
IDLE: Final = 0.5
"""Rotor speed at rest at most, over the median in flight."""
ALLOWED: Final = ACCEL_BIAS_STD / GRAVITY


@frozen_dataclass
class GravitySeen:
    """Readings of the accelerometer where gravity is known.

    - `at_rest`: mean size of the specific force on the ground, over gravity; None without rest.
    - `in_flight`: mean of the specific force along the vertical where the flight hovers, over
      gravity; None if no such stretch is long enough.
    - `in_flight_std`: its standard deviation, from the unknown change of velocity.
    """

    at_rest: float | None
    in_flight: float | None
    in_flight_std: float | None


def gravity_seen(data: FlightData) -> GravitySeen:
    """Measure gravity by the accelerometer of a prepared flight, at rest and in flight."""
    held = held_up(turning(hovering(data)), data.specific_force)
    return GravitySeen(
        at_rest=gravity_at_rest(data),
        in_flight=None if held is None else held.ratio,
        in_flight_std=None if held is None else held.std,
    )


def gravity_at_rest(data: FlightData) -> float | None:
    """Measure the mean specific force on the ground, over gravity; None without rest."""
    rest = [float(np.linalg.norm(force)) for _, force in rest_forces(data)]
    return float(np.median(rest)) / GRAVITY if len(rest) * WINDOW >= LEAST_REST else None


def rest_forces(data: FlightData) -> Iterator[tuple[int, Float[np.ndarray, " 3"]]]:
    """Yield the first row and the mean specific force [m/s^2] of every piece at rest."""
    rows = max(int(WINDOW * data.sample_rate), 8)
    count = len(data.time) // rows
    flying = np.zeros(len(data.time), dtype=bool)
    for segment in data.segments:
        flying[max(segment.start - rows, 0) : segment.stop + rows] = True
    level = data.rotor_speed.mean(axis=1)
    hover = float(np.median(level[flying])) if flying.any() else 0.0
    aside = np.flatnonzero(~flying[: count * rows].reshape(count, rows).any(axis=1))

    def pieces(values: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "p r *k"]:
        return values[: count * rows].reshape(count, rows, *values.shape[1:])[aside]

    time, force = pieces(data.time), pieces(data.specific_force)
    whole = time[:, -1] - time[:, 0] < 1.5 * rows / data.sample_rate
    still = pieces(data.angular_velocity).std(axis=1).max(axis=1) < QUIET
    steady = force.std(axis=1).max(axis=1) < STEADY
    idle = pieces(level).mean(axis=1) < IDLE * hover
    resting = whole & still & steady & idle
    yield from zip((aside[resting] * rows).tolist(), force[resting].mean(axis=1), strict=True)


def gravity_doubts(seen: GravitySeen) -> list[str]:
    """Describe each contradiction to a calibrated accelerometer in a sentence."""
    doubts: list[str] = []
    rest, flight = seen.at_rest, seen.in_flight
    if rest is not None and abs(rest - 1.0) > ALLOWED:
        doubts.append(
            f"at rest on the ground the accelerometer reads {rest * GRAVITY:.2f} m/s^2 where "
            f"gravity is {GRAVITY:.2f}: calibrate it; a bias is estimated and removed, but a "
            "wrong scale goes straight into kt and all inertia"
        )
    half = 1.96 * (seen.in_flight_std or 0.0)
    if flight is None or abs(flight - 1.0) <= ALLOWED + half:
        return doubts
    read = f"in hover the accelerometer reads {with_half(flight * GRAVITY, half * GRAVITY)}"
    if rest is None:
        doubts.append(f"{read} m/s^2 where gravity is {GRAVITY:.2f}: calibrate it (bias or scale)")
    elif abs(flight - rest) > ALLOWED + half:
        doubts.append(
            f"{read} m/s^2, at rest {rest * GRAVITY:.2f}: vibration shifts it, or the gyro is "
            "wrong; mount it softer, calibrate both"
        )
    return doubts


DEGREE: Final = float(np.pi / 180.0)
LOST_GRAVITY: Final = 0.6
"""A gyro in wrong units averages the specific force to a fifth of gravity; a right one to all."""
NEAR_GRAVITY: Final = 0.15
SLIMMEST: Final = 0.15
STOUTEST: Final = 1.6
"""Radii of gyration over the arm beyond which something is wrong. Flat frames have 0.2 to 0.6,
payloads on the arms up to 1; the gyro's unit makes a factor of 7.6, an arm in cm one of 10."""
EXPLAINED: Final = 0.6
"""Share of an angular acceleration that the rotors must explain before its size counts."""

FASTEST_HOVER: Final = 8000.0
"""The smallest rotors that are flown, of 31 mm, hover below 5000 rad/s [rad/s]."""
SMALLEST_ROTOR: Final = 0.25
LARGEST_ROTOR: Final = 0.9
"""Radii of rotors over the arm."""
FASTEST_TIP: Final = 200.0
"""In a hover there is as much to come as was used: beyond, full throttle is faster than sound
[m/s]."""
SLOWEST_TIP: Final = 30.0
"""Slower tips hold up hardly anything [m/s]."""


def gyration(factors: Factors, vehicle: Vehicle) -> float | None:
    """Estimate the radius of gyration over the arm, in roll or pitch, whichever is clearer.

    None where the rotors explain too little of the motion. `factors` are those of the band that
    the vehicle responds in.
    """
    R, layout = factors.total, signal_layout(vehicle)
    squares = R[:, [layout.index(f"O2_{i + 1}") for i in range(len(vehicle.rotors))]]
    thrust = squares @ vehicle.axes[:, 2]
    torques = squares @ vehicle.levers
    if not thrust.any():
        return None
    per_square, _ = _slope_with_share(R[:, layout.index("az")], thrust)
    responses = [
        _slope_with_share(
            _remove_parallel(R[:, layout.index(name)], thrust),
            _remove_parallel(torques[:, k], thrust),
        )
        for k, name in enumerate(("dwx", "dwy"))
    ]
    slope, share = max(responses, key=lambda response: response[1])
    if share < EXPLAINED or slope <= 0.0 or per_square <= 0.0:
        return None
    return float(np.sqrt(per_square / slope)) / vehicle.arm


def _slope_with_share(
    y: Float[np.ndarray, " z"], x: Float[np.ndarray, " z"]
) -> tuple[float, float]:
    """Return y over x, and the share of y that x explains."""
    size, total = float(x @ x), float(y @ y)
    if size == 0.0 or total == 0.0:
        return 0.0, 0.0
    slope = float(x @ y) / size
    return slope, slope**2 * size / total


def _remove_parallel(
    y: Float[np.ndarray, " z"], x: Float[np.ndarray, " z"]
) -> Float[np.ndarray, " z"]:
    """Remove the part of y along x: thrust turns a vehicle whose CoM is off the centre."""
    return y - x * (float(x @ y) / float(x @ x))


def refuse_gyro_in_degrees(
    flights: Mapping[str, FlightData], *, takes_columns: bool = True
) -> None:
    """Raise an error if the specific force only has the mean of gravity if a gyro is in deg/s.

    Also of a flight so gentle that no single reading is impossible. `flights` are by the name of
    their file; `takes_columns`: whether units of these logs can be declared.
    """
    for name, data in flights.items():
        words = gyro_in_degrees(data, takes_columns=takes_columns)
        if words is not None:
            raise FlightError(f"{name}: {words}")


def gyro_in_degrees(data: FlightData, *, takes_columns: bool = True) -> str | None:
    """Describe the contradiction to a gyro in rad/s; None if there is none."""
    as_said = held_up(turning(data), data.specific_force)
    if as_said is None or as_said.ratio > LOST_GRAVITY:
        return None
    scaled = dataclasses.replace(data, angular_velocity=data.angular_velocity * DEGREE)
    in_degrees = held_up(turning(scaled), data.specific_force)
    if in_degrees is None or abs(in_degrees.ratio - 1.0) > NEAR_GRAVITY:
        return None
    return (
        f"turned by the gyro, the specific force averages to {as_said.ratio * GRAVITY:.1f} m/s^2 "
        f"over a flight where gravity, {GRAVITY:.1f}, is expected; with rates 57 times smaller it "
        f"is {in_degrees.ratio * GRAVITY:.1f}: the gyro is in deg/s but taken for rad/s; "
        f"{UNIT_OF_GYRO if takes_columns else AS_A_TABLE}"
    )


def refuse_implausible_size(factors: Factors, vehicle: Vehicle) -> None:
    """Raise an error if no body with these arms can respond to its rotors as the gyro says."""
    words = implausible_size(gyration(factors, vehicle), vehicle.arm)
    if words is not None:
        raise FrameError(words)


def implausible_size(found: float | None, arm: float) -> str | None:
    """Describe an impossible radius of gyration over the arm [m]; None if it can be."""
    if found is None or SLIMMEST <= found <= STOUTEST:
        return None
    expected = f"{SLIMMEST:g} to {STOUTEST:g} was expected, most have 0.2 to 0.6"
    if found < SLIMMEST:
        causes = (
            f"the rotors' positions are too large (the arm is {arm:g} m: centimetres given as "
            "metres?), or the gyro reads too much (deg/s taken for rad/s?)"
        )
    else:
        causes = (
            "the gyro reads too little (rad/s declared as deg/s?), or the rotors' positions are "
            f"too small (the arm is {arm:g} m)"
        )
    return (
        f"the vehicle responds to its rotors like a body whose radius of gyration is "
        f"{found:.3g} times its arm ({expected}): {causes}; correct the unit"
    )


def hover_speed(data: FlightData) -> float:
    """Return the root mean square of the rotors' speeds, its median over the flight [rad/s]."""
    speeds = [data.rotor_speed[s.start : s.stop] for s in data.segments]  # views: flights are long
    squares = np.concatenate([np.einsum("nr,nr->n", O, O) for O in speeds])
    return float(np.sqrt(np.median(squares) / data.rotor_speed.shape[1]))


def refuse_rotors_too_fast(
    flights: Mapping[str, FlightData], arm: float, *, law: bool, takes_columns: bool = True
) -> None:
    """Raise an error if no rotor hovers at this speed, as when rpm are read as rad/s.

    `flights` are by the name of their file, `arm` in m; `law`: whether the speeds come from
    commands by a law; `takes_columns`: whether units of these logs can be declared.
    """
    for name, data in flights.items():
        speed = hover_speed(data)
        tip = speed * SMALLEST_ROTOR * arm
        if speed <= FASTEST_HOVER and tip <= FASTEST_TIP:
            continue
        remedy = (
            "the law of [motors] gives rad/s: divide its numbers by 9.549"
            if law
            else 'set unit = "rpm" (or "erpm", with poles) in columns, or correct poles'
            if takes_columns
            else "correct poles under [motors]"
        )
        raise FlightError(
            f"{name}: the rotors hover at {speed:.0f} rad/s (expected below {FASTEST_HOVER:.0f}), "
            f"and even rotors with a quarter of the arm ({arm:g} m) as radius would have tips at "
            f"{tip:.0f} m/s (expected up to {FASTEST_TIP:.0f}): rotor speeds look like rpm "
            f"read as rad/s: {remedy}; or correct the rotors' positions"
        )


def slow_rotor_doubts(
    data: FlightData, arm: float, *, law: bool, takes_columns: bool = True
) -> tuple[str, ...]:
    """Return a doubt where rotors of these arms hover too slowly, as where rad/s are taken for rpm.

    Parameters are those of `refuse_rotors_too_fast`. A doubt only: light vehicles come near.
    """
    speed = hover_speed(data)
    tip = speed * LARGEST_ROTOR * arm
    if tip >= SLOWEST_TIP:
        return ()
    unit = "correct their unit in columns, or poles" if takes_columns else "correct their poles"
    remedy = "correct the law of [motors]" if law else unit
    return (
        f"the rotors hover at {speed:.0f} rad/s: even rotors with 0.9 of the arm ({arm:g} m) as "
        f"radius would have tips at {tip:.0f} m/s, too slow to lift most vehicles (expected over "
        f"{SLOWEST_TIP:.0f}): "
        f"rotor speeds look like rad/s read as rpm; {remedy}, or the rotors' positions",
    )
