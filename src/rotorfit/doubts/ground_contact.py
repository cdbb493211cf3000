"""Does a stretch of flight that was asked for hold the ground? There rotors turn and nothing moves.

A window by start and end is taken as it is given. While the vehicle stands, the ground carries
it: gravity is in the accelerometer and not in the thrust, and every second opinion about thrust,
battery and accelerometer would blame the wrong one.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool

from rotorfit.fit.flights import Configured
from rotorfit.flight.data import FlightData
from rotorfit.flight.signals import whole_samples
from rotorfit.logs.files import file_name

STILL: Final = 0.06
"""Deviation of the rates of a vehicle that stands, motors idling [rad/s]."""
LITTLE: Final = 0.6
"""Thrust over that of most of the flight, below which a calm vehicle does not fly."""
PIECE: Final = 0.5
"""Looked at in pieces of this length [s]."""
LEAST_PIECES: Final = 2
"""In a row: in half a second of falling nobody stands still, but may seem to."""


def ground_contact(data: FlightData) -> list[tuple[float, float]]:
    """Return from when to when a vehicle stands in its used stretches [s of the log].

    Calm for a second at little thrust: what flies with that falls, and at the end of a second does
    so at several metres per second.
    """
    piece = whole_samples(PIECE * data.sample_rate)
    squares = (data.rotor_speed**2).sum(axis=1)
    used = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    usual = float(np.median(squares[used]))
    spans: list[tuple[float, float]] = []
    for s in data.segments:
        starts = np.arange(s.start, s.stop - piece + 1, piece)
        stands = np.array(
            [
                squares[at : at + piece].mean() < LITTLE * usual
                and float(data.angular_velocity[at : at + piece].std(axis=0).max()) < STILL
                for at in starts
            ],
            dtype=bool,
        )
        for at in starts[_in_rows(stands)]:
            begin, end = float(data.time[at]), float(data.time[at + piece - 1])
            follows = bool(spans) and begin - spans[-1][1] < PIECE
            spans[-1:] = [(spans[-1][0], end)] if follows else [*spans[-1:], (begin, end)]
    return spans


def _in_rows(stands: Bool[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
    """Return which pieces are among `LEAST_PIECES` in a row."""
    kept = np.zeros_like(stands)
    for at in range(len(stands) - LEAST_PIECES + 1):
        if stands[at : at + LEAST_PIECES].all():
            kept[at : at + LEAST_PIECES] = True
    return kept


def ground_sentence(configurations: Sequence[Configured]) -> str | None:
    """Return which flights hold the ground, and when, in seconds since their log's first sample."""
    said: list[str] = []
    for configured in configurations:
        for flight in configured.flights:
            data = flight.prepared.data
            spans = ground_contact(data)
            if not spans:
                continue
            zero = float(data.time[0])
            when = ", ".join(f"{a - zero:.1f} to {b - zero:.1f}" for a, b in spans)
            name = file_name(flight.entry.file)
            said.append(
                f"{name}: the vehicle stands on the ground at {when} s of the stretch that "
                "is used: set start and end to where it flies; until then trust "
                "neither thrust nor inertia"
            )
    return "; ".join(said) if said else None
