"""What gravity tells of the accelerometer without an airframe: at rest, and over a flight."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.weight_balance import held_up, hovering, turning
from rotorfit.model.terms.body import ACCEL_BIAS_STD
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.flight_data import FlightData

WINDOW: Final = 0.5
"""Length of the pieces that are or are not at rest [s]."""
LEAST_REST: Final = 1.0
"""Of rest in all, below which nothing is said [s]."""
QUIET: Final = 0.03
"""Deviation of the gyro at rest at most [rad/s]."""
STEADY: Final = 0.5
"""The same of the accelerometer [m/s^2]."""
IDLE: Final = 0.5
"""Rotor speed at rest at most, over the median in flight."""
ALLOWED: Final = ACCEL_BIAS_STD / GRAVITY


@dataclass(frozen=True, slots=True, kw_only=True)
class GravitySeen:
    """What the accelerometer reads where gravity is known.

    Attributes
    ----------
    at_rest
        Mean size of the specific force on the ground, over gravity; None without a second of rest.
    rest_seconds
        How long that was looked at [s].
    in_flight
        Mean of the specific force along the vertical where the flight hovers, over gravity; None
        where no such stretch is long enough.
    in_flight_std
        Its standard deviation, from the unknown change of velocity.
    """

    at_rest: float | None
    rest_seconds: float
    in_flight: float | None
    in_flight_std: float | None


def gravity_seen(data: FlightData) -> GravitySeen:
    """Measure gravity by the accelerometer of a prepared flight, at rest and in flight."""
    rest = _rest_forces(data)
    is_enough = len(rest) * WINDOW >= LEAST_REST
    held = held_up(turning(hovering(data)), data.specific_force)
    return GravitySeen(
        at_rest=float(np.median(rest)) / GRAVITY if is_enough else None,
        rest_seconds=len(rest) * WINDOW,
        in_flight=None if held is None else held.ratio,
        in_flight_std=None if held is None else held.std,
    )


def _rest_forces(data: FlightData) -> Float[np.ndarray, " m"]:
    """Return the size of the mean specific force of every piece at rest [m/s^2]."""
    rows = max(int(WINDOW * data.sample_rate), 8)
    flying = np.zeros(len(data.time), dtype=bool)
    for segment in data.segments:
        flying[max(segment.start - rows, 0) : segment.stop + rows] = True
    level = data.rotor_speed.mean(axis=1)
    hover = float(np.median(level[flying])) if flying.any() else 0.0
    found: list[float] = []
    for a in range(0, len(data.time) - rows + 1, rows):
        part = slice(a, a + rows)
        force = data.specific_force[part]
        whole = data.time[a + rows - 1] - data.time[a] < 1.5 * rows / data.sample_rate
        still = data.angular_velocity[part].std(axis=0).max() < QUIET
        steady = force.std(axis=0).max() < STEADY
        idle = float(level[part].mean()) < IDLE * hover and not flying[part].any()
        if whole and still and steady and idle:
            found.append(float(np.linalg.norm(force.mean(axis=0))))
    return np.array(found)


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
    read = f"in hover the accelerometer reads {flight * GRAVITY:.2f} +- {half * GRAVITY:.2f}"
    if rest is None:
        doubts.append(f"{read} m/s^2 where gravity is {GRAVITY:.2f}: calibrate it (bias or scale)")
    elif abs(flight - rest) > ALLOWED + half:
        doubts.append(
            f"{read} m/s^2, at rest {rest * GRAVITY:.2f}: vibration shifts it, or the gyro is "
            "wrong; mount it softer, calibrate both"
        )
    return doubts
