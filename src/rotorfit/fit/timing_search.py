"""When the rotors do what the motor data say: delay of measured speed, lag of commanded speed.

By profile likelihood of the three angular accelerations: every trial makes only the rotor columns
anew. Only the pilot's band and others in which the vehicle is moved are looked at: elsewhere rotor
speeds are the autopilot's answer to gusts and to the noise of its own gyro, which comes later than
they do and would be taken for a delay (8 ms in simulation, where there was none). Of a first-order
lag tau and a delay T the sum is well determined, the split hardly; a prior on tau, weak unless the
user knows better, keeps it from running away. Rotors that rise and fall at different rates get a
lag for each where the flights ask for it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import optimize

from rotorfit.estimation.factors import Factors
from rotorfit.fit.flights import Flown
from rotorfit.fit.frequency_bands import PILOT_BAND
from rotorfit.fit.motor_timing import MotorTiming
from rotorfit.fit.row_fits import angular_log_likelihood, flown_turns, turn_ratios
from rotorfit.flight.motors import MotorResponse

DELAYS_TRIED: Final[Mapping[str, tuple[float, float, int]]] = {
    "imu": (-0.012, 0.012, 7),
    "imu commanded": (-0.012, 0.06, 10),
    "mocap": (-0.01, 0.1, 12),
    "mocap commanded": (-0.01, 0.1, 12),
}
"""The search for the delay of the motion against the motor data: from, to [s], and in how many
trials. Motion capture comes late by cameras, network and, with commands, the motors' own lag."""
FURTHEST: Final = 0.16
"""How far beyond that it goes on where the best delay is at its end [s]."""
LAGS_TRIED: Final = (0.0, 0.02, 0.04, 0.07, 0.1, 0.14)
SHARES_TRIED: Final = (0.25, 0.5, 0.75, 1.0)
"""Of the lag in lag plus delay."""
LONGEST_LAG: Final = 0.2
LONGEST_DELAY: Final = 0.1
SKEW_TRIED: Final = 0.15
LARGEST_SKEW: Final = 0.8
LEAST_GAIN: Final = 10.0
"""Of the log-likelihood, for which rising and falling speed get a lag each."""
DELAY_FAULT: Final = 1e-3
SUM_FAULT: Final = 1e-3
SPLIT_FAULT: Final = 5e-3
"""Deviations that no curvature shows [s], of a delay alone, of lag plus delay and of their split:
drag and gusts, which the model of the three turns leaves out, moved them by up to twice that on
simulated flights (by 1.4 and 5 ms on average in the worst, drag and gusts on commands alone; a
delay by 1.3 ms on average in 20 s of drag and gusts)."""
HOLD_FAULT: Final = 0.25
"""Of a sample: half of the half-sample that lies between the two ways a command may have held."""
DELAY_PULL: Final = 0.15
"""Deviation of a delay that rests on the pilot's band alone, times explained over residual power
[s]: the autopilot answers gusts later than they come (by 0.14 to 0.5 on simulated flights)."""
UNTOLD_PULL: Final = 0.03
"""From here on [s], which is where the turns are explained less than five times over their
residual, lag and delay of commanded motors are those of the autopilot's answer to gusts (70 ms
instead of 39 in a hover)."""
FIRST_STEP: Final = 0.008
STENCIL: Final = 2e-3
SMALLEST_STEP: Final = 1e-3
SMALLEST_RATIO: Final = 0.1
SMALLEST_GAIN: Final = 2.0
"""Where the descent ends [s, log-likelihood]: a parabola through the last trials does the rest."""
MOST_TRIALS: Final = 60


def find_timing(flown: Flown, *, lag: bool = True) -> MotorTiming | None:
    """Return the timing that fits best; None where the flights do not determine it.

    Parameters
    ----------
    flown
        All flights.
    lag
        Look for the motors' lag, too, where it is unknown; else all lateness is delay.
    """
    unknown = flown.unknown_times
    if lag and "lag" in unknown:
        return _find_lag(flown, delay_free="delay" in unknown)
    return _find_delay(flown) if unknown else None


Counted = tuple[Bool[np.ndarray, "_ 3"], ...]
"""Which blocks of each configuration count for roll, pitch and yaw."""


def _cost(flown: Flown, response: MotorResponse, counted: Counted | None) -> float:
    """Return minus the log-likelihood of the angular accelerations; None: of the pilot's band."""
    return _cost_of_bands(flown, flown.bands(response), counted)


def _cost_of_bands(flown: Flown, bands: Sequence[Factors], counted: Counted | None) -> float:
    """Return the same from the bands at a timing, whose making is what a trial costs."""
    cost = 0.0
    for c, (factors, configured) in enumerate(zip(bands, flown.configurations, strict=True)):
        own = _slow(factors) if counted is None else counted[c]
        cost -= angular_log_likelihood(factors, flown.model, mass=configured.mass, counted=own)
    return cost


def _slow(factors: Factors) -> Bool[np.ndarray, "b 3"]:
    return np.repeat((factors.band[:, 0] < PILOT_BAND[1])[:, None], 3, axis=1)


def _counted(flown: Flown, response: MotorResponse) -> Counted:
    """Return the pilot's band and what else is flown, as seen at about the right timing."""
    parts = zip(flown.bands(response), flown.configurations, strict=True)
    return tuple(
        _slow(factors) | flown_turns(factors, flown.model, mass=configured.mass)
        for factors, configured in parts
    )


def _pull(flown: Flown, response: MotorResponse, counted: Counted) -> float:
    """Return by how much the autopilot's answer may have moved a delay [s].

    Nothing beyond `DELAY_FAULT` where a turn is flown above the pilot's band; else by the ratio
    of explained to residual power in it, of the turn that has most of it.
    """
    bands = flown.bands(response)
    if any((own & ~_slow(factors)).any() for own, factors in zip(counted, bands, strict=True)):
        return 0.0
    ratios = [
        turn_ratios(factors.select(_slow(factors)[:, 0]), flown.model, mass=c.mass).max()
        for factors, c in zip(bands, flown.configurations, strict=True)
    ]
    return DELAY_PULL / max(float(max(ratios)), SMALLEST_RATIO)


def _hold_fault(flown: Flown) -> float:
    """Return the deviation of a delay by not knowing how long a logged command held [s].

    It holds until the next one of the log or, where the log keeps only some of a faster loop's
    commands, is over sooner: up to half a sample of the log later on the whole.
    """
    if flown.motors.speed == "measured":
        return 0.0
    rates = [f.prepared.motor_rate for c in flown.configurations for f in c.flights]
    return HOLD_FAULT / min(rates)


def _find_delay(flown: Flown) -> MotorTiming | None:
    """Return the delay alone, None where the best one is at the edge of the search."""
    kind = " commanded" if flown.motors.speed == "commanded" else ""
    low, high, trials = DELAYS_TRIED[f"{flown.source}{kind}"]

    def at(delay: float) -> MotorResponse:
        return replace(flown.declared, delay=float(delay))

    grid = np.linspace(low, high, trials)
    values = [_cost(flown, at(delay), None) for delay in grid]
    best = int(np.argmin(values))
    if best in (0, trials - 1):
        # Speeds stamped late or early by more than usual: further out on that side.
        stride = float(grid[1] - grid[0]) * (1.0 if best else -1.0)
        edge, first = float(grid[best]), values[best]
        grid = edge + stride * np.arange(round(FURTHEST / abs(stride)))
        values = [first, *(_cost(flown, at(delay), None) for delay in grid[1:])]
        best = int(np.argmin(values))
        if best in (0, len(grid) - 1) or first - values[best] < LEAST_GAIN:
            return None
    counted = _counted(flown, at(grid[best]))

    def cost(delay: float) -> float:
        return _cost(flown, at(delay), counted)

    beside = (float(grid[best - 1]), float(grid[best + 1]))
    found = optimize.minimize_scalar(
        cost,
        bounds=(min(beside), max(beside)),
        method="bounded",
        options={"xatol": SMALLEST_STEP},
    )
    place = float(found.x)
    moved = [flown.bands(at(place + move)) for move in (0.0, STENCIL, -STENCIL)]
    middle, plus, minus = (_cost_of_bands(flown, bands, counted) for bands in moved)
    curvature = max((plus - 2.0 * middle + minus) / STENCIL**2, (high - low) ** -2)
    move = _parabola_shift(middle, plus, minus)
    slow = _parabola_shift(*(_cost_of_bands(flown, bands, None) for bands in moved))
    response = replace(flown.declared, delay=place + move)
    pull = _pull(flown, response, counted)
    std = _norm(1.0 / np.sqrt(curvature), slow - move, max(DELAY_FAULT, pull), _hold_fault(flown))
    return MotorTiming(response=response, delay_std=std, total_std=std)


Cost = Callable[[Float[np.ndarray, " t"]], float]
"""Of a point (lag, delay, skew), or only the first of them."""


def _find_lag(flown: Flown, *, delay_free: bool) -> MotorTiming | None:
    """Return lag and delay of commanded motors, found together (or the lag alone).

    Then a skew s, lag (1 - s) up and (1 + s) down, if it gains enough.
    """
    # The way there on the first configuration alone; the last steps see all of them.
    one = replace(flown, configurations=flown.configurations[:1])
    slow, slow_of_one = _penalised(flown, None), _penalised(one, None)
    known = flown.declared.delay
    grid = [slow_of_one(np.array([lag, known])) for lag in LAGS_TRIED]
    best = int(np.argmin(grid))
    if best == len(LAGS_TRIED) - 1:
        return None
    start = np.array([max(LAGS_TRIED[best], 0.005), known])
    steps = np.array([FIRST_STEP, FIRST_STEP])[: 2 if delay_free else 1]
    place, _ = _descended(slow_of_one, start, steps)
    splits = _splits(place) if delay_free else [place]
    counted = _counted_at_any(flown, splits)
    cost, first = _penalised(flown, counted), _penalised(one, counted)
    place, value = _descended(first, min(splits, key=first), 0.5 * steps)
    skewed, gained = _with_skew(first, np.append(place, 0.0), value)
    if gained > LEAST_GAIN:
        steps = np.array([0.5 * FIRST_STEP, 0.5 * FIRST_STEP, SKEW_TRIED])
        place, _ = _descended(cost, skewed, steps if delay_free else steps[[0, 2]])
    elif delay_free:
        place = _split_again(slow, place)
    if abs(place[1]) >= LONGEST_DELAY - SMALLEST_STEP:
        return None  # at its limit: the motion does not follow these commands at all
    pull = _pull(flown, _response(place), counted)
    # Before the command no motor answers: there the autopilot answers the noise of its gyro.
    if pull > UNTOLD_PULL or float(place[:2].sum()) <= 0.0:
        return _untold(flown, delay_free=delay_free)
    found = _with_deviations(
        cost, slow, place, delay_free=delay_free, pull=pull, hold=_hold_fault(flown)
    )
    return _no_wider(found, flown.lag_prior[1])


def _untold(flown: Flown, *, delay_free: bool) -> MotorTiming:
    """Return what is known of lag and delay without the flights."""
    lag, std = flown.lag_prior
    return MotorTiming(
        response=MotorResponse(lag=lag, delay=flown.declared.delay),
        lag_std=std,
        delay_std=UNTOLD_PULL if delay_free else None,
        total_std=_norm(std, UNTOLD_PULL) if delay_free else std,
    )


def _splits(place: Float[np.ndarray, " 2"]) -> list[Float[np.ndarray, " 2"]]:
    """Return the place, and others with the same sum of lag and delay.

    The pilot's frequencies hardly tell the split, and at a wrong one nothing further up looks
    flown that could mend it.
    """
    total = float(place.sum())
    if total <= 0.0:
        return [place]
    return [place, *(np.array([share * total, (1.0 - share) * total]) for share in SHARES_TRIED)]


def _counted_at_any(flown: Flown, places: Sequence[Float[np.ndarray, " 2"]]) -> Counted:
    """Return what is flown as seen at any of the places."""
    return tuple(
        np.logical_or.reduce(seen)
        for seen in zip(*(_counted(flown, _response(place)) for place in places), strict=True)
    )


def _split_again(slow: Cost, place: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
    """Return lag and delay of the same sum, split by the pilot's frequencies alone.

    Further up the answer to gusts, which comes later than they do, takes the lag for delay; and
    the descent ends before the split, of which the likelihood knows little, is at its best.
    """
    total = float(place.sum())
    longest = min(total + LONGEST_DELAY, LONGEST_LAG)
    if longest <= 0.0:
        return place
    found = optimize.minimize_scalar(
        lambda lag: slow(np.array([lag, total - lag])),
        bounds=(0.0, longest),
        method="bounded",
        options={"xatol": 2e-3},
    )
    return np.array([float(found.x), total - float(found.x)])


def _penalised(flown: Flown, counted: Counted | None) -> Cost:
    """Return the cost with what is known of a lag beforehand, rising steeply out of bounds."""
    mean, std = flown.lag_prior

    def cost(point: Float[np.ndarray, " t"]) -> float:
        largest = np.array([LONGEST_LAG, LONGEST_DELAY, LARGEST_SKEW])[: len(point)]
        smallest = np.array([0.0, -LONGEST_DELAY, -LARGEST_SKEW])[: len(point)]
        inside = np.clip(point, smallest, largest)
        beyond = 1e6 * float(np.abs(point - inside).sum())
        prior = 0.5 * ((float(point[0]) - mean) / std) ** 2
        return _cost(flown, _response(inside), counted) + prior + beyond

    return cost


def _response(point: Float[np.ndarray, " t"]) -> MotorResponse:
    """Return the response at lag, delay and, if it is there, skew."""
    lag, delay = float(point[0]), float(point[1])
    if len(point) == 2:
        return MotorResponse(lag=lag, delay=delay)
    skew = float(point[2])
    return MotorResponse(lag=lag * (1.0 - skew), delay=delay, lag_down=lag * (1.0 + skew))


def _descended(
    cost: Cost, start: Float[np.ndarray, " t"], steps: Float[np.ndarray, " s"]
) -> tuple[Float[np.ndarray, " t"], float]:
    """Return place and value of the minimum near `start`.

    With one step fewer than coordinates, the delay stays where it is.
    """
    moved = [i for i in range(len(start)) if len(steps) == len(start) or i != 1]

    def moved_cost(part: Float[np.ndarray, " s"]) -> float:
        point = start.copy()
        point[moved] = part
        return cost(point)

    first = start[moved]
    found = optimize.minimize(
        moved_cost,
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
    cost: Cost, place: Float[np.ndarray, " 3"], value: float
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return the best skew at this lag and delay by a parabola, and what it gains."""
    turn = np.array([0.0, 0.0, 1.0])
    ahead, behind = place + SKEW_TRIED * turn, place - SKEW_TRIED * turn
    up, down = cost(ahead), cost(behind)
    curvature, slope = up - 2.0 * value + down, 0.5 * (up - down)
    if curvature <= 0:
        return (ahead, value - up) if up < down else (behind, value - down)
    skew = float(np.clip(-slope / curvature * SKEW_TRIED, -LARGEST_SKEW, LARGEST_SKEW))
    return place + skew * turn, 0.5 * slope**2 / curvature


def _with_deviations(
    cost: Cost,
    slow: Cost,
    place: Float[np.ndarray, " t"],
    *,
    delay_free: bool,
    pull: float,
    hold: float,
) -> MotorTiming:
    """Return the timing at the bottom near `place`, with the deviations that its curvature gives.

    Beside them what the pilot's band alone moves it by, where a motor is no first-order lag, or
    drag and gusts look like one; the pull of the autopilot's answer to gusts, and what is not
    known of how long a command held [s].
    """
    lag, delay = (np.eye(len(place)) * STENCIL)[:2]
    free = delay if delay_free else lag
    middle, plus, minus = cost(place), cost(place + free), cost(place - free)
    move = _parabola_shift(middle, plus, minus)
    apart = _parabola_shift(slow(place), slow(place + free), slow(place - free)) - move
    response = _response(place + move / STENCIL * free)
    sum_fault, split_fault = max(SUM_FAULT, pull), max(SPLIT_FAULT, pull)
    if not delay_free:
        curvature = max((plus - 2.0 * middle + minus) / STENCIL**2, LONGEST_LAG**-2)
        std = _norm(1.0 / np.sqrt(curvature), apart, sum_fault, hold)
        return MotorTiming(response=response, lag_std=std, total_std=std)
    cross = cost(place + lag + delay) + cost(place - lag - delay)
    cross -= cost(place + lag - delay) + cost(place - lag + delay)
    own = cost(place + lag) - 2.0 * middle + cost(place - lag)
    hessian = np.array([[own, 0.25 * cross], [0.25 * cross, plus - 2.0 * middle + minus]])
    covariance = np.linalg.pinv(hessian / STENCIL**2)
    lag_std, delay_std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).tolist()
    return MotorTiming(
        response=response,
        lag_std=_norm(lag_std, apart, split_fault),
        delay_std=_norm(delay_std, apart, split_fault, hold),
        total_std=_norm(float(np.sqrt(max(float(covariance.sum()), 0.0))), apart, sum_fault, hold),
    )


def _no_wider(timing: MotorTiming, prior_std: float) -> MotorTiming:
    """Return the timing with a lag no less sure than it was beforehand, and the delay with it."""
    if timing.lag_std is None or timing.lag_std <= prior_std:
        return timing
    if timing.delay_std is None:  # the delay is given: the lag is all that the sum is unsure of
        return replace(timing, lag_std=prior_std, total_std=prior_std)
    delay_std = min(timing.delay_std, _norm(timing.total_std, prior_std))
    return replace(timing, lag_std=prior_std, delay_std=delay_std)


def _norm(*deviations: float) -> float:
    return float(np.linalg.norm(deviations))


def _parabola_shift(middle: float, plus: float, minus: float) -> float:
    """Return where the parabola through three costs, `STENCIL` apart, is least [s]."""
    curvature = plus - 2.0 * middle + minus
    if curvature <= 0:
        return 0.0
    return float(np.clip(-0.5 * (plus - minus) / curvature, -5.0, 5.0)) * STENCIL
