"""Lag and delay of the motors, estimated together with everything else.

From a coarse start (`timing_search.py`) the joint fit moves the motors' times as it moves all other
parameters: the signals' slopes by them are reduced beside the signals, and where the fit has moved
far the signals are made anew there. So the deviations of the times, and what they leave open of the
other numbers, are those of the fit itself. Of a first-order lag and a delay the sum is well
determined, the split less; a prior on the lag, weak unless the user knows better, keeps it from
running away. Rotors that rise and fall at different rates get a lag for each where the flights ask
for it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Unpack

import numpy as np

from rotorfit.errors import EstimationError, UnsettledError
from rotorfit.estimation.banded import BandedEstimate, response_sensitivity
from rotorfit.fit.intervals.joint_numbers import formal_covariance, random_half_width
from rotorfit.fit.joint.joint_fit import INTERMEDIATE, FitSettings, joint_fit
from rotorfit.fit.reduction.motor_timing import SPLIT_FAULT, SUM_FAULT, MotorTiming
from rotorfit.fit.sensors.lateness import lateness
from rotorfit.fit.sensors.sensor_response import TURNS, flight_spectra
from rotorfit.fit.timing.timed_fit import LEAST_GAIN, LEAST_LAG, LONGEST_MOVE, TimedFit
from rotorfit.fit.timing.timing_faults import hold_fault, shape_fault
from rotorfit.fit.timing.timing_rounds import accelerated_move, round_between, timing_round
from rotorfit.fit.timing.timing_search import coarse_timing, gust_bias, liveliest
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.terms.registry import DEFAULT, DEFAULT_TERMS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.timing.timed_dataset import TimedDataset

SUMMED: Final = ("motor_lag", "motor_delay")
"""Times whose sum is known better than each."""
MOST_ROUNDS: Final = 15
"""Fits of one search, along the lines of the flights or with signals made anew."""
LONGEST_LAG: Final = 0.2
LONGEST_DELAY: Final = 0.16
UNIDENTIFIABLE_BIAS: Final = 0.03
"""From here on [s], which is where the turns are explained less than five times over their
residual, lag and delay of commanded motors are those of the autopilot's response to gusts (70 ms
instead of 39 in a hover)."""
STARTS: Final = (1.0, 0.5, 2.0)
"""Factors of the lag that the fit begins with, one after the other where it gets lost."""
LONGER_LAGS: Final = (0.008, 0.016, 0.032)
"""Lags of usual motors [s], one of which is likely where the search lost a lag on its way: of an
autopilot's simulator, whose motors have none, they lose thousands of log-likelihood."""
SURE_LOSS: Final = 500.0
"""Log-likelihood that one of them loses, from which longer ones are not tried: autopilots'
simulators lose 3 000 to 15 000. In a noisy throw of a small vehicle 8 ms lost 140, though it has a
lag of 16 ms: bands that a fit explains count, and each lag has others."""
LOST: Final = 1.0
"""A fit that moves a time further has lost the motion: its slopes hold for some 20 ms [s]."""
FEWEST_TERMS: Final = tuple(term.name for term in DEFAULT if term.dropped is None)


def time_motors(
    dataset: TimedDataset,
    *,
    lag: bool,
    report: Callable[[str], None],
    near: MotorTiming | None = None,
    terms: Sequence[str] = DEFAULT_TERMS,
) -> TimedDataset:
    """Find lag and delay of the motors, where they are unknown; without `lag` the delay alone.

    `near`, `terms`: see `find_timing`.
    """
    if not dataset.unknown_times:
        return dataset
    report("timing the motors against the motion")
    return replace(dataset, motor_timing=find_timing(dataset, lag=lag, near=near, terms=terms))


def find_timing(
    dataset: TimedDataset,
    *,
    lag: bool = True,
    near: MotorTiming | None = None,
    terms: Sequence[str] = DEFAULT_TERMS,
) -> MotorTiming | None:
    """Estimate the timing; None if the flights do not determine it.

    `dataset`: all flights. `lag`: look for the motors' lag, too, where it is unknown; else all
    lateness is delay. `near`: a timing of the same flights with another law or other axes, from
    which the search begins in place of a coarse one. `terms`: optional terms of the model.
    """
    unknown = tuple(name for name in dataset.unknown_times if lag or name != "lag")
    names = tuple(f"motor_{name}" for name in unknown)
    if near is not None and near.frees(names):
        with suppress(EstimationError):
            found = fitted_timing(
                dataset, near.response, near.free, tuple(terms), guess=near.without_biases
            )
            if found is not None:
                return found.with_lag_of(near)
    start = coarse_timing(dataset, unknown) if unknown else None
    if start is None:
        return None
    for tried in (tuple(terms), FEWEST_TERMS):
        with suppress(UnsettledError):
            return fitted_timing(dataset, start, names, tried)
    # Neither settles: the flights do not show the lag, and without one they would be fitted wrong.
    return (
        unidentifiable_timing(dataset, delay_free="delay" in unknown) if "lag" in unknown else None
    )


def timed_again(
    dataset: TimedDataset, terms: Sequence[str], *, begin: Mapping[str, float] | None = None
) -> TimedDataset:
    """Estimate the timing of the flights again with other terms of the model.

    Damping of the turns that the model lacks makes the motors look quick. Where the fit does not
    settle with the terms, the timing stays. `begin`: values of a fit with these terms, at the
    timing that the flights have.
    """
    found = dataset.motor_timing
    if found is None or not found.free:
        return dataset
    terms = tuple(terms)
    try:
        if begin is None:
            again = fitted_timing(dataset, found.response, found.free, terms)
        else:
            first = fit_at(dataset, terms, begin=begin)
            again = _settled_timing(first, found.free, terms)
    except UnsettledError:
        return dataset
    if again is None:
        return dataset
    return replace(dataset, motor_timing=again.with_lag_of(found))


def fitted_timing(
    dataset: TimedDataset,
    start: MotorResponse,
    names: tuple[str, ...],
    terms: tuple[str, ...],
    *,
    guess: Mapping[str, float] | None = None,
) -> MotorTiming | None:
    """Fit the timing from a start with these terms; None if the motion follows no motors.

    `guess`: where the first fit, of the pilot's band, begins; None: at the row fits.
    """
    return _settled_timing(first_fit(dataset, start, names, terms, guess=guess), names, terms)


def _settled_timing(
    begun: TimedFit, names: tuple[str, ...], terms: tuple[str, ...]
) -> MotorTiming | None:
    """Fit the timing on from a first fit; None if the motion follows no motors."""
    fit = settled_fit(begun, terms)
    if fit.loses_the_motion:
        return _timing_without_lag(fit, terms)
    return _timing_of_settled(fit, names, terms)


def _timing_of_settled(
    fit: TimedFit, names: tuple[str, ...], terms: tuple[str, ...]
) -> MotorTiming | None:
    """Look for a skew, and add the deviations; None if the motion follows no motors."""
    if "motor_skew" in names and not fit.shows_skew:
        names = tuple(name for name in names if name != "motor_skew")
        at = MotorResponse(lag=fit.free.at.mean_lag, delay=fit.free.at.delay)
        fit = settled_fit(fit_at(fit.dataset.at(at, names), terms), terms)
    elif "motor_skew" not in names and _may_skew(fit.dataset, names):
        fit = _with_skew(fit, terms)
    response = fit.ended
    if response.mean_lag >= LONGEST_LAG or abs(response.delay) >= LONGEST_DELAY:
        return None  # the motion does not follow these commands at all
    bias = gust_bias(fit.dataset)
    total = response.mean_lag + response.delay
    # Before the command no motor responds: there the autopilot responds to its gyro's noise. Of
    # motors without lag, as simulators have them, the turns that are flown show it.
    late = total > 0.0 and (response.mean_lag > LEAST_LAG or bias == 0.0)
    if "motor_lag" in names and (bias > UNIDENTIFIABLE_BIAS or not late):
        return unidentifiable_timing(fit.dataset, delay_free="motor_delay" in names)
    # Above, the fit knows what the autopilot answers; below, nothing confirms that.
    gusts = bias if bias > UNIDENTIFIABLE_BIAS else 0.0
    found = timing_with_deviations(fit, gusts=gusts)
    return replace(found, bands=fit.dataset.found_with()) if fit.is_near else found


def fit_at(
    dataset: TimedDataset, terms: tuple[str, ...], **settings: Unpack[FitSettings]
) -> TimedFit:
    """Fit flights at a timing; `settings` are those of `joint_fit`."""
    return TimedFit(dataset, *joint_fit(dataset, terms=terms, **settings))


def first_fit(
    dataset: TimedDataset,
    start: MotorResponse,
    names: tuple[str, ...],
    terms: tuple[str, ...],
    *,
    guess: Mapping[str, float] | None = None,
) -> TimedFit:
    """Make the first fit; of many flights, near where the liveliest few of them settle."""
    few = liveliest(dataset)
    if few is not dataset:
        with suppress(EstimationError):
            settled = settled_fit(first_fit(few, start, names, terms, guess=guess), terms)
            start, guess = settled.ended, settled.values
    tried: list[TimedFit] = []
    for share in STARTS if start.lag > 0.0 else STARTS[:1]:
        begun = dataset.at(_scaled_lag(start, share), names)
        tried.append(fit_at(begun, terms, guess=guess))
        moved = tried[-1].estimate.estimate
        if max(abs(moved.value(name)) for name in names) < LOST:
            return tried[-1]
    return tried[0]


def _scaled_lag(response: MotorResponse, share: float) -> MotorResponse:
    """Return a response with its lags times a share."""
    down = None if response.lag_down is None else share * response.lag_down
    return replace(response, lag=share * response.lag, lag_down=down)


def settled_fit(begun: TimedFit, terms: tuple[str, ...]) -> TimedFit:
    """Fit until the signals are made where the fit ends; with the flights at that timing.

    Each round searches along the lines of the flights first (`moved_along_lines`), and reduces the
    samples again where that ends.
    """
    made, last = begun, None
    rounds = iter(range(MOST_ROUNDS - 1))
    for _ in rounds:
        if made.is_near or made.is_lagless:
            break
        along = _search_along_lines(made, terms, rounds)
        moved_along = along.dataset is not made.dataset
        if moved_along and along.loses_the_motion:
            return along
        own = round_between(made.free, timing_round(along.free, along.estimate))
        if moved_along:  # it ended within a deviation, and needs no limit
            moved = along.ended
        else:
            moved = made.moved(accelerated_move(own, last, longest=LONGEST_MOVE))
        dataset, last = made.dataset.at(moved, made.free.names), own
        made = fit_at(dataset, terms, begin=along.values)
    return made


def _search_along_lines(made: TimedFit, terms: tuple[str, ...], rounds: Iterator[int]) -> TimedFit:
    """Fit on along the lines of flights until a fit moves no time by more than a deviation."""
    fit, last = made, None
    while True:
        own = timing_round(fit.free, fit.estimate)
        if (
            fit.loses_the_motion
            or (np.abs(own.move) <= own.std).all()
            or next(rounds, None) is None
        ):
            return fit
        moved = fit.moved(accelerated_move(own, last, longest=LONGEST_MOVE))
        dataset, last = made.dataset.moved_along_lines(moved), own
        begin, fit = fit.values, fit._replace(dataset=dataset)
        # Of motors without lag the fit would lose the motion: it is the last one before.
        if fit.loses_the_motion:
            return fit
        fit = fit_at(dataset, terms, begin=begin, close=INTERMEDIATE)


def _timing_without_lag(begun: TimedFit, terms: tuple[str, ...]) -> MotorTiming | None:
    """Fit the delay of motors without lag, as simulators have them, or with one that is unknown."""
    at, dataset = begun.free.at, begun.dataset
    # The slope by a lag below `LEAST_LAG` is that of a delay, and the two run away from each other.
    start = dataset.at(MotorResponse(lag=0.0, delay=at.mean_lag + at.delay), ("motor_delay",))
    late = settled_fit(fit_at(start, terms, begin=begun.values), terms)
    longer = _likeliest_longer_lag(late, terms)
    if longer is not None:  # the search has lost its way
        late = longer
        split = settled_fit(fit_at(late.dataset.at(late.ended, SUMMED), terms), terms)
        if not split.loses_the_motion:
            return _timing_of_settled(split, SUMMED, terms)
    found = _settled_timing(late, ("motor_delay",), terms)
    # As with a lag: what comes before its command, or in a calm flight, is the autopilot's answer.
    # Yaw does not show a lag: its quick turns are by the rotors' inertia.
    flown = gust_bias(dataset, turns=2) == 0.0 and _turns_show_times(late)
    if (
        found is None
        or not found.identifiable
        or not flown
        or found.response.mean_lag + found.response.delay <= 0.0
    ):
        return unidentifiable_timing(dataset, delay_free=True)
    # So short a lag is known no better than its sum with the delay; a longer one, of which these
    # flights show nothing but the sum, no better than before.
    before = dataset.lag_prior[1] if longer is not None else LEAST_LAG / 1.96
    return found.with_lag_std(max(before, found.total_std))


def _turns_show_times(fit: TimedFit) -> bool:
    """Return whether the turns of a flight would be late by less than the shortest longer lag.

    Where nobody steers, an autopilot that answers its gyro at once looks like motors without lag.
    """
    found = (lateness(spectra, TURNS) for _, spectra in flight_spectra(fit))
    return any(late is not None and 1.96 * late.std < LONGER_LAGS[0] for late in found)


def _likeliest_longer_lag(late: TimedFit, terms: tuple[str, ...]) -> TimedFit | None:
    """Fit the delay with the likeliest longer lag; None if the flights show that there is none."""
    total, names = late.ended.delay, late.free.names
    likeliest, most = None, late.estimate.log_likelihood - LEAST_GAIN
    for lag in LONGER_LAGS:
        at = late.dataset.at(MotorResponse(lag=lag, delay=total - lag), names)
        try:
            longer = settled_fit(fit_at(at, terms, begin=late.values), terms)
        except EstimationError:
            continue
        if longer.estimate.log_likelihood >= most:
            likeliest, most = longer, longer.estimate.log_likelihood
        elif longer.estimate.log_likelihood < most - SURE_LOSS:
            break
    return likeliest


def _may_skew(dataset: TimedDataset, names: tuple[str, ...]) -> bool:
    """Return whether rising and falling speed may have a lag each."""
    # Low-passed beside motion capture, motor data rise and fall alike.
    at = dataset.timing
    return (
        at is not None
        and "motor_lag" in names
        and at.mean_lag > LEAST_LAG
        and dataset.source == "imu"
    )


def _with_skew(fit: TimedFit, terms: tuple[str, ...]) -> TimedFit:
    """Fit a lag for rising and one for falling speed, and keep them if the gain is enough."""
    wide = fit.dataset.at(fit.free.at, (*fit.free.names, "motor_skew"))
    try:
        first = fit_at(wide, terms, begin=fit.estimate.estimate.by_name)
        gain = first.estimate.log_likelihood - fit.estimate.log_likelihood
        found = settled_fit(first, terms) if gain > LEAST_GAIN else fit
    except EstimationError:
        return fit
    # Motors too quick to separate their rising from their falling lose the motion, step by step.
    return fit if found.exceeds_slopes else found


def unidentifiable_timing(dataset: Dataset, *, delay_free: bool) -> MotorTiming:
    """Set lag and delay to their values from before the flights."""
    lag, std = dataset.lag_prior
    return MotorTiming(
        response=MotorResponse(lag=lag, delay=dataset.declared.delay),
        lag_std=std,
        delay_std=UNIDENTIFIABLE_BIAS if delay_free else None,
        total_std=_norm_of_deviations(std, UNIDENTIFIABLE_BIAS) if delay_free else std,
    )


def timing_with_deviations(found: TimedFit, *, gusts: float = 0.0) -> MotorTiming:
    """Add the deviations: of chance, of the autopilot's answer and of faults.

    `gusts`: of the sum of the times, where nobody steers (`gust_bias`) [s].
    """
    dataset, free, fit = found.dataset, found.free, found.estimate
    names = fit.estimate.names
    each = {n: np.eye(len(names))[names.index(n)] for n in free.names if n in SUMMED}
    std = _std_of_combinations(fit, {**each, "total": np.sum(list(each.values()), axis=0)})
    lag, delay = (std.get(name) for name in SUMMED)
    hold, shape, response = hold_fault(dataset), shape_fault(dataset), found.ended
    split = SPLIT_FAULT if lag is not None and delay is not None else SUM_FAULT
    # With a delay that is given, what a command held too long or too short is taken for lag.
    held, late = (hold, gusts) if delay is None else (0.0, 0.0)
    return MotorTiming(
        response=response,
        lag_std=None
        if lag is None
        else dataset.lag_std(response.mean_lag, _norm_of_deviations(lag, split, held, shape, late)),
        delay_std=None if delay is None else _norm_of_deviations(delay, split, hold, shape, gusts),
        total_std=_norm_of_deviations(std["total"], SUM_FAULT, hold, shape, gusts),
        free=free.names,
        log_likelihood=fit.log_likelihood,
        reached=found.values,
    )


def _std_of_combinations(
    fit: BandedEstimate, combinations: Mapping[str, Float[np.ndarray, " f"]]
) -> dict[str, float]:
    rows = np.array(list(combinations.values()))
    chance = random_half_width(fit, rows, formal_covariance(fit, rows))
    by_response = np.abs(response_sensitivity(fit) @ rows.T).sum(axis=0)
    return dict(zip(combinations, (np.hypot(chance, by_response) / 1.96).tolist(), strict=True))


def _norm_of_deviations(*deviations: float) -> float:
    return float(np.linalg.norm(deviations))
