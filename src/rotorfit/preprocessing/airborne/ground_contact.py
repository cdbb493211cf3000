"""Does a stretch that was asked for hold the ground? There rotors turn and nothing moves.

While the vehicle stands, the ground carries it: gravity is in the accelerometer and not in the
thrust. A fit of both would give too small a thrust beside a bias of metres per second squared, so
these parts of a window are cut out and said.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.errors import FlightError
from rotorfit.preprocessing.airborne.airborne_part import (
    GRAVITY,
    SHORTEST_FLIGHT,
    Motion,
    thrust_to_force,
)
from rotorfit.preprocessing.signals import true_runs, whole_samples

STILL: Final = 0.06
"""Deviation of the rates of a vehicle that stands, motors idling [rad/s]."""
SLOW: Final = 0.1
"""Mean rate of a vehicle that stands: a gyro's bias at most [rad/s]."""
LITTLE: Final = 0.4
"""Thrust over that of the flight, below which a calm vehicle does not fly: standing ones of the
logs at hand have up to 0.2, a racer that glides at speed 0.55 and more."""
FLYING_PERCENTILE: Final = 75.0
"""Of the squared rotor speeds: that of the flight even where half of a window is not."""
CARRIED: Final = 0.2
"""Share of gravity by which the specific force of what stands may differ from it; what falls with
little thrust reads less."""
PIECE: Final = 0.5
"""Looked at in pieces of this length [s]."""
SHORT: Final = 0.1
"""Over which the rates are averaged [s]."""
LEAST_PIECES: Final = 2
"""In a row: in half a second of falling nobody stands still, but may seem to."""
ON_THE_GROUND: Final = "stands on the ground"

Rows = tuple[int, int]


def ground_contact(
    motion: Motion, flights: list[Rows], *, stretches: tuple[Rows, ...] | None = None
) -> list[Rows]:
    """Return from which row to which (exclusive) a vehicle stands on the ground.

    Calm for a second at little thrust, and yet carried. Little is what that is beside the thrust of
    the flights or, of flights that hold nothing but the ground, beside the weight, by what the
    rotors lift in the rest of the log.

    Parameters
    ----------
    motion
        Forces, rates and rotor speeds, in body axes.
    flights
        The rows that are looked at.
    stretches
        All rows with data, of a log that has more of them.
    """
    piece, short = (whole_samples(t * motion.sample_rate) for t in (PIECE, SHORT))
    squares = motion.thrust
    rows = np.concatenate([np.arange(a, b) for a, b in flights])
    flown = float(np.percentile(squares[rows], FLYING_PERCENTILE))
    lift = thrust_to_force(replace(motion, stretches=stretches or motion.stretches), squares)
    little = LITTLE * max(flown, GRAVITY / lift if lift > 0.0 else 0.0)
    found: list[Rows] = []
    for first, stop in flights:
        starts = np.arange(first, stop - piece + 1, piece)
        stands = np.array(
            [
                squares[at : at + piece].mean() < little
                and _is_calm(motion.angular_velocity[at : at + piece], short)
                and _is_carried(motion.specific_force[at : at + piece])
                for at in starts
            ],
            dtype=bool,
        )
        found += [
            (int(starts[a]), int(starts[b - 1]) + piece)
            for a, b in true_runs(stands)
            if b - a >= LEAST_PIECES
        ]
    return found


def _is_calm(rates: Float[np.ndarray, "n 3"], short: int) -> bool:
    # Means of a moment each: a gyro's noise, and what motors shake, is no motion.
    whole = len(rates) // short * short
    means = rates[:whole].reshape(-1, short, 3).mean(axis=1)
    return bool(means.std(axis=0).max() < STILL and np.abs(means.mean(axis=0)).max() < SLOW)


def _is_carried(force: Float[np.ndarray, "n 3"]) -> bool:
    return abs(float(np.linalg.norm(force.mean(axis=0))) - GRAVITY) < CARRIED * GRAVITY


def aloft(motion: Motion, flights: list[Rows], standing: list[Rows]) -> list[Rows]:
    """Return the flights without where the vehicle stands, and without a moment around it.

    Raises
    ------
    FlightError
        If nothing is left.
    """
    if not standing:
        return flights
    margin = whole_samples(PIECE * motion.sample_rate)
    shortest = max(whole_samples(SHORTEST_FLIGHT * motion.sample_rate), 3)
    kept: Bool[np.ndarray, " n"] = np.zeros(len(motion.rotor_speed), dtype=bool)
    for a, b in flights:
        kept[a:b] = True
    for a, b in standing:
        kept[max(a - margin, 0) : b + margin] = False
    # Flights that follow one another are apart by a gap, which `kept` does not show.
    left = [
        (first + a, first + b)
        for first, stop in flights
        for a, b in true_runs(kept[first:stop])
        if b - a >= shortest
    ]
    if not left:
        raise FlightError(
            "the vehicle stands on the ground between start and end (motors turn, nothing moves); "
            "give the start and the end of a flight, in seconds since the first sample of the log"
        )
    return left


def ground_said(time: Float[np.ndarray, " n"], standing: list[Rows]) -> tuple[str, ...]:
    """Return in words where the vehicle stands, in seconds since the log's first sample [s]."""
    if not standing:
        return ()
    when = ", ".join(f"{time[a] - time[0]:.1f} to {time[b - 1] - time[0]:.1f}" for a, b in standing)
    return (
        f"the vehicle stands on the ground at {when} s: these parts of the stretch between "
        "start and end are left out, as the ground carries some of the weight there",
    )
