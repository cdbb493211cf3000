"""What changes from flight to flight of one configuration: where the battery sits.

A centre of mass that is half a millimetre elsewhere turns thrust into a torque that looks like a
gust, and a joint fit of flights that share one knows less of all the rest. From five flights on
each has a centre of mass of its own about that of the configuration.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.estimation.estimate import Estimate
from rotorfit.estimation.factors import Factors
from rotorfit.estimation.parameter_map import ParameterMap

ENOUGH_FLIGHTS: Final = 5
"""Of one configuration, from which their scatter tells its own size."""
TRIM: Final = "trim_"
MOVED: Final = ("msx", "msy")
"""First moments that a flight has for itself: the height of the CoM hardly makes a torque."""
TRIM_SHARE: Final = 0.01
"""Of the arm: deviation of a flight's centre of mass about that of all, before the flights."""
LEAST_SHARE: Final = 5e-4
"""Of the arm, which is not measured better: flights that scatter less are taken to do so much."""


def flights_of(factors: Factors) -> list[Bool[np.ndarray, " b"]]:
    """Return which blocks are of each flight; of fewer than five all together."""
    numbers = np.unique(factors.recording)
    if len(numbers) < ENOUGH_FLIGHTS:
        return [np.ones(len(factors), dtype=bool)]
    return [factors.recording == number for number in numbers]


def with_trims(
    mapped: ParameterMap, theta_names: Sequence[str], owners: Sequence[int]
) -> ParameterMap:
    """Return the map to theta of every flight, with a trim for each that is not alone.

    Parameters
    ----------
    mapped
        To theta of every configuration.
    theta_names
        Parameters of the model.
    owners
        Whose flight each is, in order; a configuration that is there once has no trims.
    """
    if len(set(owners)) == len(owners):
        return mapped
    own = list(owners)
    split = [k for k, c in enumerate(own) if own.count(c) > 1]
    columns = np.zeros((len(own), len(theta_names), len(split) * len(MOVED)))
    for i, k in enumerate(split):
        for j, moment in enumerate(MOVED):
            columns[k, theta_names.index(moment), len(MOVED) * i + j] = 1.0
    return ParameterMap(
        names=(*mapped.names, *(f"{TRIM}{moment}@{k}" for k in split for moment in MOVED)),
        constant=mapped.constant[own],
        matrix=np.concatenate([mapped.matrix[own], columns], axis=2),
        products=tuple(
            replace(term, configuration=k)
            for k, c in enumerate(own)
            for term in mapped.products
            if term.configuration == c
        ),
    )


def trim_prior(mapped: ParameterMap, scatter: Sequence[float]) -> dict[str, float]:
    """Return the deviations of the trims, `scatter` being that of each flight [kg m]."""
    names = [name for name in mapped.names if name.startswith(TRIM)]
    return {name: scatter[int(name.partition("@")[2])] for name in names}


def trim_shares(
    estimate: Estimate, owners: Sequence[int], moments: Sequence[float]
) -> dict[int, float]:
    """Return how far the flights of each configuration scatter, as a share of the arm.

    A prior wider than that would leave the centre of mass of all flights more open than they do.
    One step of expectation maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B
    39, 1977), from what the trims differ by and what is open of that.

    Parameters
    ----------
    estimate
        With a trim for each flight that is not alone.
    owners
        Whose flight each is, in order.
    moments
        Mass times arm of each flight [kg m].
    """
    shares: dict[int, float] = {}
    for c in set(owners):
        own = [k for k, owner in enumerate(owners) if owner == c]
        if len(own) > 1:
            square = np.mean([_scatter(estimate, [f"{TRIM}{m}@{k}" for k in own]) for m in MOVED])
            shares[c] = max(float(np.sqrt(square)) / moments[own[0]], LEAST_SHARE)
    return shares


def _scatter(estimate: Estimate, trims: Sequence[str]) -> float:
    """Return the expected variance of trims about their mean."""
    at = [estimate.names.index(name) for name in trims]
    open_still = estimate.covariance[np.ix_(at, at)]
    about = float(np.trace(open_still) - open_still.mean() * len(at))
    return float(estimate.values[at].var(ddof=1)) + about / (len(at) - 1.0)


def configuration_theta(
    mapped: ParameterMap, phi: Float[np.ndarray, " f"], flights: Sequence[int]
) -> Float[np.ndarray, "c p"]:
    """Return theta of every configuration: of its flights without their trims.

    `flights`: how many of each configuration stand in the map by themselves.
    """
    trimmed = [name.startswith(TRIM) for name in mapped.names]
    first = np.cumsum([0, *flights[:-1]])
    return mapped.theta(np.where(trimmed, 0.0, phi))[first]
