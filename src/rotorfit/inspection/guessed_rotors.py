"""Where the rotors are and how they spin, as far as a flight tells that nobody told.

For looking at a flight before its airframe is known, not for an estimate: roll and pitch answer
each rotor's squared speed by its place, yaw by its spin. A scale is in neither, and what is asked
of such a vehicle (how much the rotors explain of the motion) does not depend on it.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import Final

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import signal

from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.signals import whole_samples
from rotorfit.reduction.frequency_bands import PILOT_BAND

SPREAD: Final = 0.15
"""Deviation of the rotors' places on each axis; any will do [m]."""
MOST_TRIED: Final = 12
"""Rotors up to which every pattern of spins is tried; above, they alternate."""
LIKELY: Final = 0.3
"""Share of what the best spins explain of yaw from which others might be the true ones."""
MOST_LIKELY: Final = 6
LEAST_MOVED: Final = 0.02
"""Motion of the rotors against each other, over the strongest, below which it is noise: six rotors
are moved in four ways only."""


def guessed_vehicles(data: FlightData) -> list[Vehicle]:
    """Return rotors that answer as a flight does, all axes upright, of a size that means nothing.

    Parameters
    ----------
    data
        With rotor speeds brought to the time of the motion.

    Returns
    -------
    vehicles
        One or a few that differ by their spins, the likeliest by this look first.
    """
    turn, squares, slopes = _slow_signals(data)
    roll, pitch = _centred(_solved(squares, turn[:, 0])), _centred(_solved(squares, turn[:, 1]))
    places = [(float(-p), float(r), 0.0) for r, p in zip(roll, pitch, strict=True)]
    return [
        Vehicle(
            rotors=tuple(
                Rotor(position=place, spin="ccw" if spin > 0 else "cw")
                for place, spin in zip(places, spins, strict=True)
            )
        )
        for spins in _spins(turn[:, 2], squares, slopes)
    ]


def _slow_signals(
    data: FlightData,
) -> tuple[Float[np.ndarray, "z 3"], Float[np.ndarray, "z N"], Float[np.ndarray, "z N"]]:
    """Return turn, squared speeds and their slopes as a factor, where a pilot moves the vehicle."""
    low, high = PILOT_BAND
    sos = signal.butter(
        2, (low, min(high, 0.45 * data.sample_rate)), "bandpass", fs=data.sample_rate, output="sos"
    )
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
        slow = signal.sosfiltfilt(sos, columns, axis=0)
        factor = np.linalg.qr(np.concatenate([factor, slow]), mode="r")
    # Never fewer rows than columns, so that a flight without a long stretch is no special case.
    factor = np.concatenate([factor, np.zeros((wide, wide))])
    return factor[:, :3], factor[:, 3 : 3 + count], factor[:, 3 + count :]


def _solved(
    columns: Float[np.ndarray, "z k"], target: Float[np.ndarray, " z"]
) -> Float[np.ndarray, " k"]:
    solved: Float[np.ndarray, " k"] = scipy.linalg.pinv(columns, rtol=LEAST_MOVED) @ target
    return solved


def _centred(answer: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Return what an axis answers to each rotor as a place along the other one [m]."""
    places = answer - answer.mean()
    size = float(np.sqrt((places**2).mean()))
    # Where nothing answers, any place is as good as another, but for all at one.
    return np.linspace(-SPREAD, SPREAD, len(answer)) if size == 0.0 else SPREAD * places / size


def _spins(
    turn: Float[np.ndarray, " z"],
    squares: Float[np.ndarray, "z N"],
    slopes: Float[np.ndarray, "z N"],
) -> list[Float[np.ndarray, " N"]]:
    """Return the spins, +1 for ccw, whose drag and spin-up explain yaw, the best first."""
    count = squares.shape[1]
    tried: list[tuple[float, Float[np.ndarray, " N"]]] = []
    for pattern in _patterns(count):
        columns = np.column_stack([squares @ pattern, slopes @ pattern])
        lengths = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(lengths > 0, lengths, 1.0)
        answer = _solved(columns, turn)
        # Drag and spin-up both turn the body against the rotor.
        spins = -pattern if answer.sum() > 0 else pattern
        tried.append((float(turn @ columns @ answer), spins))
    best = max(explained for explained, _ in tried)
    likely = [one for one in tried if one[0] >= LIKELY * best]
    likely.sort(key=lambda one: -one[0])
    return [spins for _, spins in likely[:MOST_LIKELY]]


def _patterns(count: int) -> Iterator[Float[np.ndarray, " N"]]:
    """Yield the patterns of as many ccw as cw (or one more), each once whatever its sign."""
    if count > MOST_TRIED:
        yield np.array([(-1.0) ** i for i in range(count)])
        return
    for others in combinations(range(1, count), (count + 1) // 2 - 1):
        pattern = -np.ones(count)
        pattern[[0, *others]] = 1.0
        yield pattern
