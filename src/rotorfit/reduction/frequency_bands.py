"""Into which frequency bands a flight is cut, and in which of them a pilot moves the vehicle.

The autopilot answers disturbances: where no pilot moves an axis, rotor speeds and angular
accelerations are related by its gains, not by the vehicle's inertia. Such bands tell nothing of
the vehicle, and pull at every estimate.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.estimation.factors import Factors

EDGES: Final = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 11.0, 15.0, 20.0, 25.0, 30.0)
"""Of the frequency bands [Hz]. A band must not end inside the control bandwidth; above 30 Hz the
resolution of rotor speed takes over."""
STRETCH: Final = 20.0
"""Longest stretch of one noise level [s]. In 5 s a band holds too few different lines: on simulated
flights the deviation of k_d is a third larger; real ones agree on both."""
PILOT_BAND: Final = (0.3, 3.0)
"""Where explained and residual angular acceleration are compared [Hz]: where a pilot moves the
vehicle. Further up the gyro's own noise, differentiated, would hide a well flown axis."""
LEAST_RATIO: Final = 3.0
"""Explained over residual power of an angular acceleration from which a band counts. About its
bandwidth an autopilot's answer alone makes as much as one to three."""
WIDE: Final = 3.0
"""Width of a block over that of the band about its middle from which it is judged apart."""

_TINY: Final = float(np.finfo(float).tiny)


def slow_bands(factors: Factors) -> Bool[np.ndarray, "b 3"]:
    """Return which blocks of roll, pitch and yaw are not above the band in which a pilot flies."""
    return np.repeat((factors.band[:, 0] < PILOT_BAND[1])[:, None], 3, axis=1)


def excited_bands(
    factors: Factors, signal: Float[np.ndarray, "b k"], residual: Float[np.ndarray, "b k"]
) -> Bool[np.ndarray, "b k"]:
    """Return in which blocks a pilot moves an axis; a band is judged over all of a flight.

    Parameters
    ----------
    factors
        The blocks.
    signal, residual
        Sums of squares of angular accelerations and of their errors, one column per axis.
    """
    flown = np.zeros(signal.shape, dtype=bool)
    for band in _bands_of_flights(factors):
        flown[band] = signal[band].sum(axis=0) > (1.0 + LEAST_RATIO) * residual[band].sum(axis=0)
    return flown


def followed_bands(
    factors: Factors, signal: Float[np.ndarray, "b m"], made: Float[np.ndarray, "b m"]
) -> Bool[np.ndarray, " b"]:
    """Return in which blocks a signal follows what should make it, at any gain of the band.

    Parameters
    ----------
    factors
        The blocks.
    signal, made
        Their rows of the signal, and of what should make it.
    """
    followed = np.zeros(len(factors), dtype=bool)
    for band in _bands_of_flights(factors):
        power = float((made[band] ** 2).sum())
        explained = float((made[band] * signal[band]).sum()) ** 2 / max(power, _TINY)
        followed[band] = explained > LEAST_RATIO * ((signal[band] ** 2).sum() - explained)
    return followed


def counted_bands(factors: Factors, flown: Bool[np.ndarray, "b k"]) -> Bool[np.ndarray, "b k"]:
    """Return which blocks count: those flown, and all of an axis that is nowhere flown.

    And the band with the mean: trim is the same whoever steers, and tells of the centre of mass.
    """
    return flown | ~flown.any(axis=0) | (factors.band[:, 0] == 0.0)[:, None]


def _bands_of_flights(factors: Factors) -> Iterator[Bool[np.ndarray, " b"]]:
    """Yield which blocks are of one flight and about one frequency, wide ones apart.

    The ten lines of a short stretch reach far: about 5 Hz, they hold the pilot's motion at 1 Hz.
    """
    middle: Float[np.ndarray, " b"] = factors.band.mean(axis=1)
    place = np.digitize(middle, EDGES)
    width = np.diff(EDGES, append=np.inf)[place - 1]
    place = np.where(np.ptp(factors.band, axis=1) > WIDE * width, -place, place)
    for number in np.unique(factors.recording):
        own = factors.recording == number
        for one in np.unique(place[own]):
            yield own & (place == one)
