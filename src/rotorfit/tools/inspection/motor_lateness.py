"""Estimate how much later than its motor data a vehicle turns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.timing.timing_search import DELAYS_TRIED
from rotorfit.flight.signals import central_difference, smooth, whole_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData

LATEST: Final = 0.1
SEARCHED: Final = DELAYS_TRIED["imu"][1]
"""Reach of the search for the delay of measured speeds, and of motor data that come late [s]."""
FARTHEST: Final = 0.5
"""End of the search where nothing shows within `LATEST` [s]."""
STRIDE: Final = 0.004
"""Stride of that search [s]."""
LOW_PASS: Final = 15.0
"""Low-pass for comparing motors and gyro [Hz]."""
LEAST_EXPLAINED: Final = 0.3
"""Share of the angular acceleration that motors must explain for their delay to be known."""


def motor_lateness(data: FlightData) -> float | None:
    """Estimate how much later than the motors the vehicle turns [s]; None if it does not show."""
    near = _lateness_within(data, LATEST)
    # Only where nothing shows within a tenth of a second it is looked for further away.
    return _lateness_within(data, FARTHEST) if near is None else near


def _lateness_within(data: FlightData, seconds: float) -> float | None:
    """Estimate the lateness, in a search that ends at so many seconds both ways."""
    longest = max(data.segments, key=len, default=None)
    reach = whole_samples(seconds * data.sample_rate)
    if longest is None or len(longest) < 20 * max(reach, 1) or reach < 2:
        return None
    rows = slice(longest.start, longest.stop)
    rates = smooth(data.angular_velocity[rows], data.sample_rate, LOW_PASS)
    turn = central_difference(rates, data.sample_rate)
    squares = smooth(data.rotor_speed[rows] ** 2, data.sample_rate, LOW_PASS)
    stride = max(whole_samples(STRIDE * data.sample_rate), 1)
    shifts = range(-reach, reach + 1, stride)
    shares = explained_shares(turn[:, :2], squares, shifts, reach)
    best = int(np.argmax(shares))
    if shares[best] < LEAST_EXPLAINED or best in (0, len(shares) - 1):
        return None
    left, top, right = shares[best - 1 : best + 2]
    bend = left - 2.0 * top + right
    between = 0.0 if bend == 0.0 else 0.5 * (left - right) / bend
    return float((shifts[best] + between * stride) / data.sample_rate)


def explained_shares(
    turn: Float[np.ndarray, "n k"],
    squares: Float[np.ndarray, "n N"],
    shifts: Sequence[int],
    reach: int,
) -> Float[np.ndarray, " s"]:
    """Compute the mean share of the turns that motor data of earlier samples explain."""
    n = len(turn)
    y = np.ascontiguousarray(turn[reach : n - reach].T)
    y -= y.mean(axis=1, keepdims=True)
    total: Float[np.ndarray, " k"] = (y * y).sum(axis=1)
    # A row for each motor: the means along rows are what takes the time.
    motors = np.ascontiguousarray(squares.T)
    shares = np.empty(len(shifts))
    for i, shift in enumerate(shifts):
        x = motors[:, reach - shift : n - reach - shift]
        x = x - x.mean(axis=1, keepdims=True)
        cross = x @ y.T
        square: Float[np.ndarray, "N N"] = x @ x.T
        inverse: Float[np.ndarray, "N N"] = np.linalg.pinv(square, 1e-8, hermitian=True)
        solved: Float[np.ndarray, "N k"] = inverse @ cross
        explained: Float[np.ndarray, " k"] = np.einsum("ij,ij->j", cross, solved)
        shares[i] = (explained / np.where(total > 0, total, 1.0)).mean()
    return shares
