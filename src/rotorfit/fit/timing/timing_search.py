"""The start of the fit of the motors' timing, and whether it is identifiable.

By the likelihood of the three angular accelerations on a coarse grid: every trial makes only the
rotor columns again. Only the pilot's band is looked at: elsewhere rotor speeds are the autopilot's
answer to gusts and to the noise of its own gyro, which comes later than they do and would be taken
for a delay (8 ms in simulation, where there was none).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.reduction.frequency_bands import PILOT_BAND, or_every, slow_bands
from rotorfit.fit.row_fits import angular_log_likelihood, excited_turns, turn_ratios, turned_flights
from rotorfit.flight.motors.motor_model import MotorResponse

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from rotorfit.fit.dataset.dataset import ConfigurationData, Dataset
    from rotorfit.fit.timing.timed_dataset import TimedDataset

DELAYS_TRIED: Final[Mapping[str, tuple[float, float, int]]] = {
    "imu": (-0.012, 0.012, 7),
    "imu commanded": (-0.012, 0.06, 10),
    "mocap": (-0.01, 0.1, 12),
    "mocap commanded": (-0.01, 0.1, 12),
}
"""The search for the delay of the motion against the motor data: from, to [s], and in how many
trials. Motion capture comes late by cameras, network and, with commands, the motors' own lag."""
ASKED_FOR: Final = 0.025
"""Time by which speeds are early that are asked for rather than measured [s]: motors lag by 20 to
90 ms. Moments of inertia with a delay in place of a lag of 20 ms are .9 % too large (half of their
half-width, three flights), of 40 ms 3 to 4 % (two to four half-widths, twelve flights)."""
FURTHEST: Final = 0.16
"""How far beyond that it goes on where the best delay is at its end [s]."""
LAGS_TRIED: Final = (0.0, 0.02, 0.04, 0.07, 0.1, 0.14)
FLIGHTS_TRIED: Final = 4
"""Of each configuration, the liveliest: more of them find no other start."""
LEAST_GAIN: Final = 10.0
"""Of the log-likelihood, for which a delay further out than usual is taken."""
CLEAR_GAIN: Final = 100.0
"""The same in every band, for which a lag or delay is taken that the pilot's band does not find:
thousands in ArduPilot's simulator, whose gyro is low-passed and has no noise, 600 to 800 in fast
flights of NeuroBEM, in which the air makes more of the slow turns than the rotors do."""
GUST_BIAS: Final = 0.15
"""Deviation of a delay that rests on the pilot's band alone, times explained over residual power
[s]: the autopilot answers gusts later than they come (by 0.14 to 0.5 on simulated flights)."""
SMALLEST_RATIO: Final = 0.1


def coarse_timing(dataset: TimedDataset, unknown: Collection[str]) -> MotorResponse | None:
    """Search lag and delay of the best trial; None if it is at the edge of the grid.

    `dataset`: all flights; the first configuration decides about a lag. `unknown`: ``"lag"``,
    ``"delay"`` or both.
    """
    few = liveliest(dataset)
    found = _coarse_search(few, unknown)
    return _coarse_search(dataset, unknown) if found is None and few is not dataset else found


def liveliest(dataset: TimedDataset) -> TimedDataset:
    """Select the few flights of each configuration that turn most; all where they are few."""
    if all(len(c.flights) <= FLIGHTS_TRIED for c in dataset.configurations):
        return dataset
    picked = [_most_turned(c) for c in dataset.configurations]
    body = dataset.body and tuple(
        tuple(own[i] for i in few) for own, few in zip(dataset.body, picked, strict=True)
    )
    configurations = tuple(
        replace(c, flights=[c.flights[i] for i in few])
        for c, few in zip(dataset.configurations, picked, strict=True)
    )
    return replace(dataset, configurations=configurations, body=body)


def _most_turned(configured: ConfigurationData) -> list[int]:
    """Select the flights of a configuration that have most of the squared rates."""
    turned: list[float] = []
    for flight in configured.flights:
        data = flight.prepared.data
        turned.append(sum(float((data.angular_velocity[s.start : s.stop] ** 2).sum())
                          / data.sample_rate for s in data.segments))  # fmt: skip
    return sorted(np.argsort(turned)[-FLIGHTS_TRIED:].tolist())


def _coarse_search(dataset: TimedDataset, unknown: Collection[str]) -> MotorResponse | None:
    if "lag" not in unknown:
        return _coarse_delay(dataset)
    body = None if dataset.body is None else dataset.body[:1]
    one = replace(dataset, configurations=dataset.configurations[:1], body=body)
    mean, std = dataset.lag_prior
    delay = dataset.declared.delay
    trials = [MotorResponse(lag=lag, delay=delay) for lag in LAGS_TRIED]
    costs = zip(LAGS_TRIED, pilot_band_costs(one, trials), strict=True)
    values = [cost + 0.5 * ((lag - mean) / std) ** 2 for lag, cost in costs]
    best = int(np.argmin(values))
    if best == len(LAGS_TRIED) - 1:
        # In the pilot's band damping that the model lacks may look like lag without end.
        if not _has_turns(one):
            return None
        values = [_every_cost(one, MotorResponse(lag=lag, delay=delay)) for lag in LAGS_TRIED]
        best = int(np.argmin(values))
        if values[-1] - values[best] < CLEAR_GAIN:
            return None
    return MotorResponse(lag=max(LAGS_TRIED[best], 0.005), delay=delay)


def _has_turns(dataset: Dataset) -> bool:
    return any(bool(f.prepared.data.angular_acceleration.any()) for f in dataset.flights)


def _coarse_delay(dataset: TimedDataset) -> MotorResponse | None:
    kind = " commanded" if dataset.motors.speed == "commanded" else ""
    low, high, trials = DELAYS_TRIED[f"{dataset.source}{kind}"]

    def at(delay: float) -> MotorResponse:
        return replace(dataset.declared, delay=float(delay))

    grid = np.linspace(low, high, trials)
    values = pilot_band_costs(dataset, [at(delay) for delay in grid])
    best = int(np.argmin(values))
    if best in (0, trials - 1):
        # The air turns a fast vehicle slowly, too: what no pilot's band shows, quick turns may.
        quick = np.array([_every_cost(dataset, at(delay)) for delay in grid])
        shown = int(np.argmin(quick))
        if min(quick[0], quick[-1]) - quick[shown] > CLEAR_GAIN:
            return at(grid[shown])
        # Speeds stamped late or early by more than usual: further out on that side.
        stride = float(grid[1] - grid[0]) * (1.0 if best else -1.0)
        edge = float(grid[best])
        grid = edge + stride * np.arange(round(FURTHEST / abs(stride)))
        values = pilot_band_costs(dataset, [at(delay) for delay in grid])
        best = int(np.argmin(values))
        if best == len(grid) - 1:
            return None
        if values[0] - values[best] < LEAST_GAIN:
            # About there, where the end is clearly worse: nothing it is not, and the fit goes on.
            return at(edge) if values[-1] - values[best] > LEAST_GAIN else None
    return at(grid[best])


def pilot_band_costs(dataset: TimedDataset, trials: Sequence[MotorResponse]) -> list[float]:
    """Compute minus the log-likelihood of the turns in the pilot's band at each timing."""
    bands = [dataset.bands(response, top=PILOT_BAND[1]) for response in trials]
    total = np.zeros(len(trials))
    for configured, own in zip(dataset.configurations, zip(*bands, strict=True), strict=True):
        mass = configured.mass
        turned = [turned_flights(f, dataset.model, mass=mass) for f in own]
        # Each axis of the flights that move it at any of the timings: at a wrong one a quick turn
        # no longer follows the rotors.
        counted = slow_bands(own[0]) & or_every(np.logical_or.reduce(turned))
        total -= [angular_log_likelihood(f, dataset.model, mass=mass, counted=counted) for f in own]
    return total.tolist()


def _every_cost(dataset: TimedDataset, response: MotorResponse) -> float:
    """Compute the cost of a timing in every band."""
    return -sum(
        angular_log_likelihood(
            f, dataset.model, mass=configured.mass, counted=np.ones((len(f.band), 3), dtype=bool)
        )
        for f, configured in zip(dataset.bands(response), dataset.configurations, strict=True)
    )


def gust_bias(dataset: TimedDataset, turns: int = 3) -> float:
    """Compute the bias of a delay by the autopilot's response to gusts, where no pilot flies [s].

    Nothing where a turn is flown above the pilot's band; else by the ratio of explained to residual
    power in it, of the turn that has most of it. `turns`: so many of roll, pitch and yaw count.
    """
    bands = dataset.timed_bands
    masses = [configured.mass for configured in dataset.configurations]
    for factors, mass in zip(bands, masses, strict=True):
        flown = excited_turns(factors, dataset.model, mass=mass) & ~slow_bands(factors)
        if flown[:, :turns].any():
            return 0.0
    ratios = [
        turn_ratios(factors.select(slow_bands(factors)[:, 0]), dataset.model, mass=mass)
        for factors, mass in zip(bands, masses, strict=True)
    ]
    most = max(float(own[:turns].max()) for own in ratios)
    return GUST_BIAS / max(most, SMALLEST_RATIO)
