r"""The noise level of every row within a phase of a flight, by the errors of its fit.

A vehicle may fall through its own wake and be out of it half a second later: its errors are
:math:`\sigma(t)` times a stationary process. A fit that takes them for equally noisy lets the worst
moment of a phase decide. Divided by :math:`\sigma(t)`, all signals of a row alike, the equations
stay exact and the errors become stationary (weighted least squares).

The level is that of whitened errors: a slow gust, whose size in a fraction of a second is chance,
makes none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded_problem import solved
from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight, with_prepared
from rotorfit.fit.fit import Fit, numbers_of, refit
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.joint.joint_problem import NOISY, RESPONSE_ERRORS, theta_of
from rotorfit.fit.reduction.frequency_bands import EDGES, banded_data
from rotorfit.fit.reduction.reduce import split_segment
from rotorfit.flight.airborne import MOTION_CUTOFF
from rotorfit.flight.filters import correlate
from rotorfit.flight.signals import running_mean
from rotorfit.model.signals import signal_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.flight_data import FlightData, Segment
    from rotorfit.flight.prepare import PreparedFlight

WINDOW: Final = 0.12
"""Deviation of the bell over which a level is averaged [s]: it holds some sixty degrees of freedom
of four errors up to 20 Hz, so that chance makes a level of a tenth."""
LEAST: Final = 0.1
"""Least level, as a share of the largest level of a stretch."""
LEAST_SPREAD: Final = 0.2
"""Deviation of the logarithm of a stretch's levels, twice that of chance, under which all are left
alone: weights would gain nothing."""
LOWEST: Final = EDGES[1]
"""Lowest frequency of the errors that count [Hz]; the highest is that of the motion."""
FLAT: Final = 10
"""Lines over which a spectrum is averaged to whiten it."""


def fit_by_noise(fit: Fit, wanted: Sequence[str] | None) -> Fit:
    """Fit the flights once more where their noise changes within a phase, rows weighted by it.

    `wanted`: terms of the model, as for `fit_flights`. What does not settle so stays as it was.
    """
    unsteady = with_noise_levels(fit)
    if unsteady is None:
        return fit
    try:
        return fit_flights(unsteady, wanted, begin=fit.estimate.estimate.by_name)
    except UnsettledError:
        return fit


def allow_for_noise_levels(fit: Fit) -> Fit:
    """Append the shift of the numbers with the rows' weights, beyond the shift by chance."""
    even = _with_even_noise(fit)
    if even is None:
        return fit
    try:
        other = refit(fit, even, begin=fit.estimate.estimate.by_name).numbers
    except UnsettledError:
        return fit
    own = numbers_of(fit.dataset, fit.estimate, list(fit.configurations))
    half = np.zeros(len(own.names))
    known = np.isfinite(own.half_width) & np.isfinite(other.half_width)
    lost = other.half_width[known] ** 2 - own.half_width[known] ** 2
    moved = np.abs(own.values - other.values)[known]
    # Both weightings are right where the errors are as the fit takes them: their estimates then
    # differ by no more than the difference of their variances allows (Hausman, Econometrica 46(6),
    # 1978). What the model lacks moves one from the other by more.
    half[known] = np.maximum(moved - np.sqrt(np.maximum(lost, 0.0)), 0.0)
    return fit.with_terms(
        IntervalTerm(
            name="changing noise",
            half_width=half,
            source="fit with all moments of the flight weighted alike",
        )
    )


def _with_even_noise(fit: Fit) -> TimedDataset | None:
    """Return the flights of a fit with rows of even noise; None if they have no others."""
    if all(f.prepared.data.noise_level is None for f in fit.dataset.flights):
        return None

    def evened(prepared: PreparedFlight) -> PreparedFlight:
        return replace(prepared, data=replace(prepared.data, noise_level=None))

    return with_prepared(fit.dataset, evened).reduced()


def with_noise_levels(fit: Fit) -> TimedDataset | None:
    """Weight the rows of a fit's flights by their noise; None if the noise is steady."""
    theta = theta_of(fit.estimate.problem.map, fit.estimate.estimate.values, fit.configurations)
    each = solved(fit.dataset.model.tensor, theta, fit.estimate.problem.noisy)[0]
    configurations = tuple(
        _set_levels(fit, configured, G)
        for configured, G in zip(fit.dataset.configurations, each, strict=True)
    )
    if not any(_is_unsteady(f) for c in configurations for f in c.flights):
        return None
    return replace(fit.dataset, configurations=configurations).reduced()


def _is_unsteady(flight: LoadedFlight) -> bool:
    """Return whether the noise of a flight changes within any of its phases."""
    level = flight.prepared.data.noise_level
    assert level is not None
    phases = flight.prepared.phases
    return any(float(np.log(level[p.start : p.stop]).std()) > LEAST_SPREAD for p in phases)


def _set_levels(
    fit: Fit, configured: ConfigurationData, G: Float[np.ndarray, "k z"]
) -> ConfigurationData:
    """Return a configuration with the levels of its flights; `G` makes errors of signals."""
    flights: list[LoadedFlight] = []
    for flight in configured.flights:
        data = replace(flight.prepared.data, noise_level=_flight_levels(fit, flight, G))
        flights.append(replace(flight, prepared=replace(flight.prepared, data=data)))
    return replace(configured, flights=flights)


def _flight_levels(
    fit: Fit, flight: LoadedFlight, G: Float[np.ndarray, "k z"]
) -> Float[np.ndarray, " n"]:
    """Compute the level of every row of a flight, its mean logarithm zero in every stretch."""
    data, plan = banded_data(flight.prepared, fit.dataset.timing)
    levels = np.ones(len(data.time))
    places = [NOISY.index(name) for name in RESPONSE_ERRORS]
    for stretch in _split_stretches(data, plan.longest):
        Z = signal_matrix(
            data,
            fit.dataset.vehicle,
            stretch.start,
            stretch.stop,
            added=fit.dataset.model.layout.added,
        )
        errors = (Z @ G.T)[:, places]
        levels[stretch.start : stretch.stop] = noise_levels(errors, data.sample_rate)
    return levels


def _split_stretches(data: FlightData, longest: float) -> Iterator[Segment]:
    for phase in data.segments:
        yield from split_segment(phase, longest * data.sample_rate)


def noise_levels(errors: Float[np.ndarray, "n k"], sample_rate: float) -> Float[np.ndarray, " n"]:
    """Compute the size of a stretch's errors, row by row, over its geometric mean.

    One where the stretch is too short to show it, or without errors.
    """
    white = _whiten_errors(errors, sample_rate)
    if white is None:
        return np.ones(len(errors))
    power = _smooth_by_gaussian((white**2).mean(axis=1), WINDOW * sample_rate)
    level = np.sqrt(np.maximum(power, LEAST**2 * power.max()))
    found: Float[np.ndarray, " n"] = level / np.exp(np.log(level).mean())
    return found


def _smooth_by_gaussian(values: Float[np.ndarray, " n"], width: float) -> Float[np.ndarray, " n"]:
    """Average under a Gaussian of this deviation [samples], as if the ends went on."""
    reach = int(4.0 * width + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    wide = np.pad(values, reach, mode="edge")
    return correlate(wide, weights / weights.sum())[2 * reach : 2 * reach + len(values)]


def _whiten_errors(
    errors: Float[np.ndarray, "n k"], sample_rate: float
) -> Float[np.ndarray, "n k"] | None:
    """Whiten the errors of the motion: flat spectra, equal sizes; None of too few lines."""
    frequency = np.fft.rfftfreq(len(errors), 1.0 / sample_rate)
    motion = np.flatnonzero(
        (frequency >= LOWEST) & (frequency < min(MOTION_CUTOFF, 0.4 * sample_rate))
    )
    if len(motion) < FLAT:
        return None
    lines = np.fft.rfft(errors, axis=0)
    # By its own neighbours, so that bands with much motion do not make the level.
    power = running_mean(np.abs(lines[motion]) ** 2, FLAT)
    if not (power > 0.0).all():
        return None
    white = np.zeros_like(lines)
    white[motion] = lines[motion] / np.sqrt(power)
    return np.fft.irfft(white, len(errors), axis=0)
