"""When the rotors do what the motor data say: delay of measured speed, lag of commanded speed.

By profile likelihood of the three angular accelerations: every trial makes only the rotor columns
anew. Of a first-order lag tau and a delay T the sum is well determined, the split hardly; a prior
on tau, weak unless the user knows better, keeps it from running away. Rotors that rise and fall at
different rates get a lag for each where the flights ask for it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float
from scipy import optimize

from rotorfit.flight.motors import MotorResponse
from rotorfit.identification.rows import PILOT_BAND, angular_log_likelihood

if TYPE_CHECKING:
    from rotorfit.identification.flights import Flown

DELAYS_TRIED: Final[Mapping[str, tuple[float, float, int]]] = {
    "imu": (-0.012, 0.012, 7),
    "imu commanded": (-0.012, 0.06, 10),
    "mocap": (-0.01, 0.1, 12),
    "mocap commanded": (-0.01, 0.1, 12),
}
"""The search for the delay of the motion against the motor data: from, to [s], and in how many
trials. Motion capture comes late by cameras, network and, with commands, the motors' own lag."""
LAGS_TRIED: Final = (0.0, 0.02, 0.04, 0.07, 0.1, 0.14)
LONGEST_LAG: Final = 0.2
LONGEST_DELAY: Final = 0.1
LAG_PRIOR: Final = (0.035, 0.03)
"""Mean and deviation of a motor's time constant before the flight [s]."""
SKEW_TRIED: Final = 0.15
LARGEST_SKEW: Final = 0.8
LEAST_GAIN: Final = 10.0
"""Of the log-likelihood, for which rising and falling speed get a lag each."""
SUM_FAULT: Final = 6e-4
SPLIT_FAULT: Final = 2e-3
"""Deviations of the sum and of its split that no curvature shows [s]: drag and gusts, which the
model of the three turns leaves out, moved them by up to twice that on simulated flights."""
FIRST_STEP: Final = 0.008
STENCIL: Final = 2e-3
SMALLEST_STEP: Final = 1e-3
SMALLEST_GAIN: Final = 2.0
"""Where the descent ends [s, log-likelihood]: a parabola through the last trials does the rest."""
MOST_TRIALS: Final = 60
SLOW: Final = (np.inf, PILOT_BAND[1])
"""Upper edges [Hz]: of all bands, and of those of the pilot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTiming:
    """What the flights tell of the motors' timing.

    Attributes
    ----------
    response
        Lag and delay, found or given [s].
    lag_std, delay_std
        Their standard deviations [s]; None for what was given or has no meaning.
    total_std
        Standard deviation of lag plus delay [s].
    """

    response: MotorResponse
    total_std: float
    lag_std: float | None = None
    delay_std: float | None = None


def find_timing(flown: "Flown") -> MotorTiming | None:
    """Return the timing that fits best; None where the flights do not determine it."""
    unknown = flown.unknown_times
    if "lag" in unknown:
        return _find_lag(flown, delay_free="delay" in unknown)
    return _find_delay(flown) if unknown else None


def _costs(flown: "Flown", response: MotorResponse, tops: tuple[float, ...]) -> list[float]:
    """Return minus the log-likelihood of the angular accelerations, below each of `tops` [Hz]."""
    costs = [0.0] * len(tops)
    for factors, configured in zip(flown.bands(response), flown.configurations, strict=True):
        for i, top in enumerate(tops):
            below = factors.select(factors.band[:, 0] < top)
            costs[i] -= angular_log_likelihood(below, flown.model, mass=configured.mass)
    return costs


def _find_delay(flown: "Flown") -> MotorTiming | None:
    """Return the delay alone, None where the best one is at the edge of the search."""
    kind = " commanded" if flown.motors.speed == "commanded" else ""
    low, high, trials = DELAYS_TRIED[f"{flown.source}{kind}"]

    def costs(delay: float, tops: tuple[float, ...]) -> Float[np.ndarray, " t"]:
        return np.array(_costs(flown, replace(flown.declared, delay=delay), tops))

    grid = np.linspace(low, high, trials)
    values = [costs(float(delay), SLOW[:1])[0] for delay in grid]
    best = int(np.argmin(values))
    if best in (0, trials - 1):
        return None
    found = optimize.minimize_scalar(
        lambda delay: float(costs(delay, SLOW[:1])[0]),
        bounds=(float(grid[best - 1]), float(grid[best + 1])),
        method="bounded",
        options={"xatol": SMALLEST_STEP},
    )
    place = float(found.x)
    middle, plus, minus = (costs(place + move, SLOW) for move in (0.0, STENCIL, -STENCIL))
    move, slow = _parabola_shifts(middle, plus, minus)
    curvature = float((plus - 2.0 * middle + minus)[0]) / STENCIL**2
    # The autopilot's answer to gusts, later than the gusts, looks like a delay: the deviation
    # holds what the best place moves by where only the pilot's frequencies are used.
    std = _norm(1.0 / float(np.sqrt(max(curvature, 1e-6))), slow - move, SUM_FAULT)
    response = replace(flown.declared, delay=place + move)
    return MotorTiming(response=response, delay_std=std, total_std=std)


Costs = Callable[[Float[np.ndarray, " t"], tuple[float, ...]], list[float]]
"""Of a point (lag, delay, skew), or only the first of them, below each of some edges [Hz]."""


def _find_lag(flown: "Flown", *, delay_free: bool) -> MotorTiming | None:
    """Return lag and delay of commanded motors, found together (or the lag alone).

    Then a skew s, lag (1 - s) up and (1 + s) down, if it gains enough.
    """
    costs = _penalised(flown)
    # The way there on the first configuration alone; the last steps see all of them.
    first = _penalised(replace(flown, configurations=flown.configurations[:1]))
    known = flown.declared.delay
    grid = [first(np.array([lag, known]), (np.inf,))[0] for lag in LAGS_TRIED]
    best = int(np.argmin(grid))
    if best == len(LAGS_TRIED) - 1:
        return None
    start = np.array([max(LAGS_TRIED[best], 0.005), known])
    free = 2 if delay_free else 1
    place, value = _descended(first, start, np.array([FIRST_STEP, FIRST_STEP])[:free])
    skewed, gained = _with_skew(first, np.append(place, 0.0), value)
    if gained > LEAST_GAIN:
        steps = np.array([0.5 * FIRST_STEP, 0.5 * FIRST_STEP, SKEW_TRIED])
        place, _ = _descended(costs, skewed, steps if delay_free else steps[[0, 2]])
    elif delay_free:
        place = _split_again(costs, place)
    if abs(place[1]) >= LONGEST_DELAY - SMALLEST_STEP:
        return None  # at its limit: the motion does not follow these commands at all
    return _with_deviations(costs, place, delay_free=delay_free)


def _split_again(costs: Costs, place: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
    """Return lag and delay of the same sum, split by the pilot's frequencies alone.

    Over all bands the answer to gusts, which comes later than they do, takes the lag for delay.
    """
    total = float(place.sum())
    longest = min(total + LONGEST_DELAY, LONGEST_LAG)
    if longest <= 0.0:
        return place

    def cost(lag: float) -> float:
        return costs(np.array([lag, total - lag]), SLOW[1:])[0]

    found = optimize.minimize_scalar(
        cost,
        bounds=(0.0, longest),
        method="bounded",
        options={"xatol": 2e-3},
    )
    return np.array([float(found.x), total - float(found.x)])


def _penalised(flown: "Flown") -> Costs:
    """Return the cost with what is known of a lag beforehand, rising steeply out of bounds."""
    mean, std = flown.lag_prior

    def costs(point: Float[np.ndarray, " t"], tops: tuple[float, ...]) -> list[float]:
        largest = np.array([LONGEST_LAG, LONGEST_DELAY, LARGEST_SKEW])[: len(point)]
        smallest = np.array([0.0, -LONGEST_DELAY, -LARGEST_SKEW])[: len(point)]
        inside = np.clip(point, smallest, largest)
        beyond = 1e6 * float(np.abs(point - inside).sum())
        prior = 0.5 * ((float(point[0]) - mean) / std) ** 2
        return [cost + prior + beyond for cost in _costs(flown, _response(inside), tops)]

    return costs


def _response(point: Float[np.ndarray, " t"]) -> MotorResponse:
    """Return the response at lag, delay and, if it is there, skew."""
    lag, delay = float(point[0]), float(point[1])
    if len(point) == 2:
        return MotorResponse(lag=lag, delay=delay)
    skew = float(point[2])
    return MotorResponse(lag=lag * (1.0 - skew), delay=delay, lag_down=lag * (1.0 + skew))


def _descended(
    costs: Costs, start: Float[np.ndarray, " t"], steps: Float[np.ndarray, " s"]
) -> tuple[Float[np.ndarray, " t"], float]:
    """Return place and value of the minimum near `start`.

    With one step fewer than coordinates, the delay stays where it is.
    """
    moved = [i for i in range(len(start)) if len(steps) == len(start) or i != 1]

    def cost(part: Float[np.ndarray, " s"]) -> float:
        point = start.copy()
        point[moved] = part
        return costs(point, (np.inf,))[0]

    first = start[moved]
    found = optimize.minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([first, first + np.diag(steps)]),
            "xatol": SMALLEST_STEP,
            "fatol": SMALLEST_GAIN,
            "maxfev": MOST_TRIALS,
        },
    )
    place = start.copy()
    place[moved] = found.x
    place[0] = max(float(place[0]), 0.0)
    return place, float(found.fun)


def _with_skew(
    costs: Costs, place: Float[np.ndarray, " 3"], value: float
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return the best skew at this lag and delay by a parabola, and what it gains."""
    turn = np.array([0.0, 0.0, 1.0])
    ahead, behind = place + SKEW_TRIED * turn, place - SKEW_TRIED * turn
    up, down = costs(ahead, (np.inf,))[0], costs(behind, (np.inf,))[0]
    curvature, slope = up - 2.0 * value + down, 0.5 * (up - down)
    if curvature <= 0:
        return (ahead, value - up) if up < down else (behind, value - down)
    skew = float(np.clip(-slope / curvature * SKEW_TRIED, -LARGEST_SKEW, LARGEST_SKEW))
    return place + skew * turn, 0.5 * slope**2 / curvature


def _with_deviations(
    costs: Costs, place: Float[np.ndarray, " t"], *, delay_free: bool
) -> MotorTiming:
    """Return the timing at the bottom near `place`, with the deviations that its curvature gives.

    The sum has beside it what it moves by where only the pilot's frequencies are used, as it
    does where a motor is no first-order lag, or gusts look like one.
    """
    moves = (np.eye(len(place)) * STENCIL)[:2]
    lag, delay = moves

    def both(offset: Float[np.ndarray, " t"]) -> Float[np.ndarray, " 2"]:
        return np.array(costs(place + offset, SLOW))

    middle, plus, minus = both(0.0 * lag), both(delay), both(-delay)
    longer, shorter = both(lag), both(-lag)
    hessian = np.empty((2, 2))
    hessian[1, 1] = (plus - 2.0 * middle + minus)[0]
    hessian[0, 0] = (longer - 2.0 * middle + shorter)[0]
    if not delay_free:
        move, slow = _parabola_shifts(middle, longer, shorter)
        std = STENCIL / np.sqrt(max(hessian[0, 0], 1e-6))
        return MotorTiming(
            response=_response(place + move / STENCIL * lag),
            lag_std=_norm(std, slow - move, SUM_FAULT),
            total_std=_norm(std, slow - move, SUM_FAULT),
        )
    move, slow = _parabola_shifts(middle, plus, minus)
    cross = both(lag + delay) + both(-lag - delay) - both(lag - delay) - both(delay - lag)
    hessian[0, 1] = hessian[1, 0] = 0.25 * cross[0]
    covariance = np.linalg.pinv(hessian / STENCIL**2)
    lag_std, delay_std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).tolist()
    total = float(np.sqrt(max(float(covariance.sum()), 0.0)))
    return MotorTiming(
        response=_response(place + move / STENCIL * delay),
        lag_std=_norm(lag_std, slow - move, SPLIT_FAULT),
        delay_std=_norm(delay_std, slow - move, SPLIT_FAULT),
        total_std=_norm(total, slow - move, SUM_FAULT),
    )


def _norm(*deviations: float) -> float:
    return float(np.linalg.norm(deviations))


def _parabola_shifts(
    middle: Float[np.ndarray, " 2"], plus: Float[np.ndarray, " 2"], minus: Float[np.ndarray, " 2"]
) -> tuple[float, float]:
    """Return where the parabolas through three costs, `STENCIL` apart, are least [s]."""
    curvature = plus - 2.0 * middle + minus
    bottom = -0.5 * (plus - minus) / np.where(curvature > 0, curvature, np.inf)
    shifts = np.clip(bottom, -5.0, 5.0) * STENCIL
    return float(shifts[0]), float(shifts[1])
