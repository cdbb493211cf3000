"""Measures of a loop: margins, bandwidth and step response, each with its interval."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float

    from rotorfit.tools.control_loop.controllers import RateController
    from rotorfit.tools.control_loop.margins import Margins

SIDES: Final = (0.025, 0.975)
SETTLED: Final = 4.0
"""Time by which the response to a step has come to rest [s]."""
STEP_TIMES: Final = np.linspace(0.0, 0.6, 121)
"""Times at which the step response is shown [s]."""
HALF_POWER: Final = 0.5**0.5
"""Size of a closed loop at its bandwidth."""


@frozen_dataclass
class Measure:
    """A number of the loop with its 95 % interval; NaN if the loop has none.

    Attributes
    ----------
    value
        Of the nominal vehicle.
    low, high
        Ends of the interval.
    """

    value: float
    low: float
    high: float


@frozen_dataclass
class LoopMeasures:
    """Distances of a loop from oscillating, each the smallest over all crossings.

    Attributes
    ----------
    crossover
        Frequency at which the gain falls to 1 for the last time [Hz].
    phase
        Phase margin, of more or less phase [deg]; negative for an unstable loop.
    gain
        Factor above 1 by which a higher gain makes the loop oscillate; below 1 for an unstable
        loop: where a lower gain may calm it.
    lower_gain
        Factor below 1 by which a lower gain makes the loop oscillate; above 1 for an unstable loop.
    delay
        Time by which the loop may be later until it oscillates [s]; negative for an unstable loop.
    sensitivity
        Peak of ``1 / |1 + L|``: by how much disturbances are amplified at worst.
    bandwidth
        Frequency from which the closed loop's gain is below 1 / sqrt(2) [Hz].
    stable
        Share of the vehicles that the flights leave open in which the closed loop is stable.
    """

    crossover: Measure
    phase: Measure
    gain: Measure
    lower_gain: Measure
    delay: Measure
    sensitivity: Measure
    bandwidth: Measure
    stable: float


@frozen_dataclass
class StepResponse:
    """Rate over the rate asked for, that steps to 1 at time 0 [s], with its 95 % band.

    Without noise, at no motor's limit; NaN if the nominal loop oscillates.
    """

    time: Float[np.ndarray, " t"]
    value: Float[np.ndarray, " t"]
    low: Float[np.ndarray, " t"]
    high: Float[np.ndarray, " t"]


def closed_loop(
    controller: RateController,
    loops: Complex[np.ndarray, "*D f"],
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "*D f"]:
    """Compute the rate over the rate asked for, from open rate loops."""
    asked = controller.from_set_point(frequency) / controller.from_rate(frequency)
    return loops / (1.0 + loops) * asked


def step_harmonics(period: float) -> Float[np.ndarray, " f"]:
    """Choose the frequencies of a square wave that rests `SETTLED` on either side [Hz]."""
    first = 0.5 / SETTLED
    return first * np.arange(1.0, 0.45 / period / first, 2.0)


def step_response(
    harmonics: Float[np.ndarray, " f"],
    closed: Complex[np.ndarray, "D f"],
    time: Float[np.ndarray, " t"],
) -> Float[np.ndarray, "D t"]:
    """Compute the step response, as the response to one edge of a slow square wave from 0 to 1."""
    waves = np.exp(2j * np.pi * np.outer(harmonics, time))
    parts = 2.0 / np.pi * closed * harmonics[0] / harmonics
    # Both sides at rest: the response to the edge begins at none.
    return np.imag(parts @ waves) - np.imag(parts.sum(axis=1, keepdims=True))


def step_of(
    harmonics: Float[np.ndarray, " f"],
    closed: Complex[np.ndarray, "D f"],
    stable: Bool[np.ndarray, " D"],
) -> StepResponse:
    """Compute the nominal step response, which comes first, and the band of the stable ones."""
    if not stable[0]:
        nothing = np.full_like(STEP_TIMES, np.nan)
        return StepResponse(time=STEP_TIMES, value=nothing, low=nothing, high=nothing)
    responses = step_response(harmonics, closed, STEP_TIMES)
    low, high = np.quantile(responses[stable], SIDES, axis=0)
    return StepResponse(time=STEP_TIMES, value=responses[0], low=low, high=high)


def bandwidth(
    frequency: Float[np.ndarray, " f"], closed: Complex[np.ndarray, "D f"]
) -> Float[np.ndarray, " D"]:
    """Find where the gain of closed loops first falls below `HALF_POWER` [Hz]."""
    low: Bool[np.ndarray, "D f"] = np.abs(closed) < HALF_POWER
    first = np.argmax(low, axis=1)
    found = np.full(len(closed), np.nan)
    for i in np.flatnonzero(first):
        k = first[i]
        sizes: Float[np.ndarray, " 2"] = np.log(np.abs(closed[i, k - 1 : k + 1]))
        share = (sizes[0] - np.log(HALF_POWER)) / (sizes[0] - sizes[1])
        found[i] = frequency[k - 1] * (frequency[k] / frequency[k - 1]) ** share
    return found


def measures_of(found: Margins, bandwidths: Float[np.ndarray, " D"]) -> LoopMeasures:
    """Collect the margins and bandwidths [Hz] of vehicles, the nominal one first."""
    return LoopMeasures(
        crossover=_measure_of(found.crossover),
        phase=_measure_of(found.phase),
        gain=_measure_of(found.gain),
        lower_gain=_measure_of(found.lower_gain),
        delay=_measure_of(found.delay),
        sensitivity=_measure_of(found.sensitivity),
        bandwidth=_measure_of(bandwidths),
        stable=float(found.stable.mean()),
    )


def _measure_of(values: Float[np.ndarray, " D"]) -> Measure:
    """Return the nominal number, which comes first, and the interval of all."""
    known = values[np.isfinite(values)]
    if not np.isfinite(values[0]):
        return Measure(value=np.nan, low=np.nan, high=np.nan)
    low, high = np.quantile(known, SIDES)
    return Measure(value=float(values[0]), low=float(low), high=float(high))


def peak_below(found: Margins) -> float:
    """Return the peak of the sensitivity that 97.5 % of the vehicles stay below."""
    peaks = np.where(found.stable, found.sensitivity, np.inf)
    return float(np.sort(peaks)[int(np.ceil(SIDES[1] * len(peaks))) - 1])
