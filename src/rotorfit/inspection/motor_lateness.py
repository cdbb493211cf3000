"""How much later than the motors the vehicle turns, from one flight and without an airframe."""

from typing import Final

import numpy as np
import scipy.linalg
from jaxtyping import Float

from rotorfit.fit.timing.timing_search import DELAYS_TRIED
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.signals import central_difference, smooth, whole_samples

LATEST: Final = 0.1
SEARCHED: Final = DELAYS_TRIED["imu"][1]
"""How far an estimate looks for the delay of measured speeds, and of motor data that come late
[s]."""
FAR: Final = 0.5
"""How far the motion may be apart from the motor data in the search for it: at first, and where
nothing shows so near [s]."""
STRIDE: Final = 0.004
"""Of that search [s]."""
LOOK: Final = 15.0
"""Low-pass for comparing motors and gyro [Hz]."""
SURE: Final = 0.3
"""Share of the angular acceleration that motors must explain before their delay is told."""


def motor_lateness(data: FlightData) -> float | None:
    """Return how much later than the motors the vehicle turns [s]; None where it does not show.

    The time shift at which the squared motor data explain the angular acceleration best.
    Negative: the motor data were recorded late. Of commands it holds the motors' lag, too.
    Only where nothing shows within a tenth of a second it is looked for further away.
    """
    near = _lateness_within(data, LATEST)
    return _lateness_within(data, FAR) if near is None else near


def _lateness_within(data: FlightData, seconds: float) -> float | None:
    """Return the lateness, in a search that ends at so many seconds both ways."""
    longest = max(data.segments, key=len, default=None)
    reach = whole_samples(seconds * data.sample_rate)
    if longest is None or len(longest) < 20 * max(reach, 1) or reach < 2:
        return None
    rows = slice(longest.start, longest.stop)
    rates = smooth(data.angular_velocity[rows], data.sample_rate, LOOK)
    turn = central_difference(rates, data.sample_rate)
    push = smooth(data.rotor_speed[rows] ** 2, data.sample_rate, LOOK)
    stride = max(whole_samples(STRIDE * data.sample_rate), 1)
    shifts = range(-reach, reach + 1, stride)
    shares = np.array([_explained(turn, push, shift, reach) for shift in shifts])
    best = int(np.argmax(shares))
    if shares[best] < SURE or best in (0, len(shares) - 1):
        return None
    left, top, right = shares[best - 1 : best + 2]
    bend = left - 2.0 * top + right
    between = 0.0 if bend == 0.0 else 0.5 * (left - right) / bend
    return float((shifts[best] + between * stride) / data.sample_rate)


def _explained(
    turn: Float[np.ndarray, "n 3"], push: Float[np.ndarray, "n N"], shift: int, reach: int
) -> float:
    """Return the mean share of roll and pitch acceleration that earlier motor data explain."""
    n = len(turn)
    y = turn[reach : n - reach, :2]
    x = push[reach - shift : n - reach - shift]
    y, x = y - y.mean(axis=0), x - x.mean(axis=0)
    gram = x.T @ x
    cross = x.T @ y
    solved: Float[np.ndarray, "N 2"] = scipy.linalg.pinvh(gram, rtol=1e-8) @ cross
    total: Float[np.ndarray, " 2"] = (y * y).sum(axis=0)
    explained: Float[np.ndarray, " 2"] = np.einsum("ij,ij->j", cross, solved)
    return float((explained / np.where(total > 0, total, 1.0)).mean())
