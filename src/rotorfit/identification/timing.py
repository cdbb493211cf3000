"""When the rotors do what the motor data say: delay of measured speed, lag of commanded speed.

By profile likelihood of the three angular accelerations: every trial makes only the rotor columns
anew. Of a first-order lag tau and a delay T the sum is well determined, the split hardly; a weak
prior on tau keeps it from running away.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float
from scipy import optimize

from rotorfit.identification.experiment import Source
from rotorfit.identification.rows import PILOT_BAND, fit_rows

if TYPE_CHECKING:
    from rotorfit.identification.flights import Flown

DELAYS_TRIED: Final[Mapping[Source, tuple[float, float, int]]] = {
    "imu": (-0.012, 0.012, 7),
    "mocap": (-0.01, 0.1, 12),
}
"""The search for the delay of the motion against the motor data: from, to [s], and in how many
trials. Motion capture comes late by cameras, network and, with commands, the motors' own lag."""
LAGS_TRIED: Final = (0.0, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.13)
LONGEST_LAG: Final = 0.2
LAG_PRIOR: Final = (0.035, 0.03)
"""Mean and deviation of a motor's time constant before the flight [s]."""
FIRST_STEP: Final = 0.008
SMALLEST_STEP: Final = 2e-4
MOST_TRIALS: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTiming:
    """What the flights tell of the motors' timing.

    Attributes
    ----------
    delay
        The motion shows what the motor data ask that much later [s].
    delay_std
        Its standard deviation [s].
    lag, lag_std
        Time constant of the motors [s]; None where it was given or has no meaning.
    total_std
        Standard deviation of lag plus delay [s].
    """

    delay: float
    delay_std: float
    lag: float | None = None
    lag_std: float | None = None
    total_std: float | None = None


def find_timing(flown: "Flown") -> MotorTiming | None:
    """Return the timing that fits best; None where the flights do not determine it."""
    if flown.searches_lag:
        return _find_lag(flown)
    found = _best_delay(flown, np.inf)
    if found is None:
        return None
    # The autopilot's answer to gusts, later than the gusts, looks like a delay: the deviation
    # holds what the best place moves by where only the pilot's frequencies are used.
    slow = _best_delay(flown, PILOT_BAND[1])
    shift = 0.0 if slow is None else slow[0] - found[0]
    return MotorTiming(delay=found[0], delay_std=float(np.hypot(found[1], shift)))


def _cost(flown: "Flown", lag: float | None, delay: float, top: float) -> float:
    """Return minus the log-likelihood of the angular accelerations at one timing."""
    total = 0.0
    for factors, configured in zip(
        flown.bands(flown.timing_of(lag, delay)), flown.configurations, strict=True
    ):
        below = factors.select(factors.band[:, 0] < top)
        total -= fit_rows(below, flown.model, mass=configured.mass).log_likelihood
    return total


def _best_delay(flown: "Flown", top: float) -> tuple[float, float] | None:
    """Return the best delay by the bands that begin below `top` [Hz]."""
    first, last, trials = DELAYS_TRIED[flown.source]
    return _minimum(lambda d: _cost(flown, None, d, top), np.linspace(first, last, trials))


def _minimum(
    cost: Callable[[float], float], grid: Float[np.ndarray, " t"]
) -> tuple[float, float] | None:
    """Return place and width of the minimum of a smooth function, None if it is at an edge."""
    values = [cost(float(x)) for x in grid]
    best = int(np.argmin(values))
    if best in (0, len(grid) - 1):
        return None
    found = optimize.minimize_scalar(
        cost,
        bounds=(float(grid[best - 1]), float(grid[best + 1])),
        method="bounded",
        options={"xatol": 1e-4},
    )
    place, h = float(found.x), 1e-3
    curvature = (cost(place - h) - 2.0 * float(found.fun) + cost(place + h)) / h**2
    return place, float(1.0 / np.sqrt(max(curvature, 1e-6)))


def _find_lag(flown: "Flown") -> MotorTiming | None:
    """Return lag and delay of commanded motors, found together."""
    mean, std = LAG_PRIOR

    def cost(point: Float[np.ndarray, " 2"]) -> float:
        lag, delay = float(point[0]), float(point[1])
        # Outside the bounds the cost rises steeply, and the simplex turns back.
        beyond = max(-lag, 0.0) + max(lag - LONGEST_LAG, 0.0) + max(abs(delay) - 0.1, 0.0)
        prior = 0.5 * ((lag - mean) / std) ** 2
        inside = _cost(flown, float(np.clip(lag, 0.0, LONGEST_LAG)), delay, np.inf)
        return inside + prior + 1e6 * beyond

    grid = [cost(np.array([lag, 0.0])) for lag in LAGS_TRIED]
    best = int(np.argmin(grid))
    if best == len(LAGS_TRIED) - 1:
        return None
    start = np.array([max(LAGS_TRIED[best], 0.005), 0.0])
    simplex = np.vstack([start, start + FIRST_STEP * np.eye(2)])
    found = optimize.minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "initial_simplex": simplex,
            "xatol": SMALLEST_STEP,
            "fatol": 0.05,
            "maxfev": MOST_TRIALS,
        },
    )
    lag, delay = max(float(found.x[0]), 0.0), float(found.x[1])
    return _with_deviations(cost, lag, delay)


def _with_deviations(
    cost: Callable[[Float[np.ndarray, " 2"]], float], lag: float, delay: float
) -> MotorTiming:
    """Return the timing with the deviations that the curvature of the cost gives."""
    place, h = np.array([lag, delay]), 2e-3
    steps = np.eye(2) * h
    middle = cost(place)
    hessian = np.empty((2, 2))
    for i in range(2):
        hessian[i, i] = cost(place + steps[i]) - 2.0 * middle + cost(place - steps[i])
    cross = cost(place + steps[0] + steps[1]) + cost(place - steps[0] - steps[1])
    cross -= cost(place + steps[0] - steps[1]) + cost(place - steps[0] + steps[1])
    hessian[0, 1] = hessian[1, 0] = 0.25 * cross
    covariance = np.linalg.pinv(hessian / h**2)
    variances = np.maximum(np.diagonal(covariance), 0.0)
    total = max(float(covariance.sum()), 0.0)
    return MotorTiming(
        delay=delay,
        delay_std=float(np.sqrt(variances[1])),
        lag=lag,
        lag_std=float(np.sqrt(variances[0])),
        total_std=float(np.sqrt(total)),
    )
