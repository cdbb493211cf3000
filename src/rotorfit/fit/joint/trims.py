"""Trims of each flight of one configuration: where the battery sits, and the air.

A centre of mass that is half a millimetre elsewhere turns thrust into a torque that looks like a
gust, and a joint fit of flights that share one knows less of all the rest. Air that is 3 degrees
warmer costs a hundredth of k_t and k_d. So each of several flights has a centre of mass and a
density of the air of its own, about those of the configuration; the inertia about the centre of
mass they share.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.parameter_map import ParameterMap, Product
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import INERTIA, PARAMETERS, inertia_about

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.estimation.estimate import Estimate

ENOUGH_FLIGHTS: Final = 5
"""Flights of one configuration, from which their scatter is informative."""
TRIM: Final = "trim_"
MOVED: Final = tuple(n for n, info in PARAMETERS.items() if info.between_flights == "moves")
"""First moments that a flight has for itself: the height of the CoM hardly makes a torque."""
AIR: Final = tuple(n for n, info in PARAMETERS.items() if info.between_flights == "air")
"""Coefficients in proportion to the density of the air."""
OWN: Final = (*MOVED, "air")
"""What a flight has for itself."""
LEAST_MOVED: Final = 5e-4
"""Of the arm, which is not measured better: flights that scatter less are taken to do so much."""


@frozen_dataclass
class Scatter:
    """Scatter of the flights of a configuration: deviations about their common values.

    - `moved`: of the centre of mass, as a share of the arm.
    - `air`: of the density of the air, as a share of it.
    """

    moved: float = 0.01
    air: float = 0.01


UNSEEN: Final = Scatter()
"""Before the flights."""


def with_trims(
    mapped: ParameterMap,
    theta_names: Sequence[str],
    owners: Sequence[int],
    masses: Sequence[float],
    *,
    of_many: bool = False,
) -> ParameterMap:
    """Return the map to theta of every flight, with trims for each that is not alone.

    `mapped`: to theta of every configuration. `theta_names`: parameters of the model. `owners`:
    whose flight each is, in order; a configuration that is there once has no trims. `masses`: of
    each flight [kg]. `of_many`: whether flights that are alone here are of many elsewhere, and have
    trims, too.
    """
    own = list(owners)
    split = [k for k, c in enumerate(own) if of_many or own.count(c) > 1]
    if not split:
        return mapped
    shared, place = len(mapped.names), list(theta_names).index
    constant, before = mapped.constant[own], mapped.matrix[own]
    columns = np.zeros((len(own), len(theta_names), len(split) * len(OWN)))
    products = [
        replace(term, configuration=k)
        for k, c in enumerate(own)
        for term in mapped.products
        if term.configuration == c
    ]
    for i, k in enumerate(split):
        first = len(OWN) * i
        for j, moment in enumerate(MOVED):
            columns[k, place(moment), first + j] = 1.0
        for j, entry, of, factor in _scaled_trims(theta_names, masses[k]):
            columns[k, entry, first + j] += factor * constant[k, of]
            products += [
                Product(
                    configuration=k,
                    entry=entry,
                    first=shared + first + j,
                    second=int(f),
                    factor=factor * float(before[k, of, f]),
                )
                for f in np.flatnonzero(before[k, of])
            ]
    return ParameterMap(
        names=(*mapped.names, *(f"{TRIM}{own}@{k}" for k in split for own in OWN)),
        constant=constant,
        matrix=np.concatenate([before, columns], axis=2),
        products=tuple(products),
    )


def _scaled_trims(theta_names: Sequence[str], mass: float) -> list[tuple[int, int, int, float]]:
    """Return (trim, entry, other entry, factor): what a trim adds to an entry, times the other."""
    place = list(theta_names).index
    air = [(OWN.index("air"), place(name), place(name), 1.0) for name in AIR]
    steiner: list[tuple[int, int, int, float]] = []
    for j, moved in enumerate(np.eye(3)[: len(MOVED)]):
        for name, other in zip(("msx", "msy", "msz"), np.eye(3), strict=True):
            # A body that is moved as it is has more inertia about the origin (Steiner), by the
            # product of the trim and where it was; the trim's own square, some ten micrometres
            # squared, is left out.
            both = _unit_steiner(moved + other) - _unit_steiner(moved) - _unit_steiner(other)
            steiner += [
                (j, place(element), place(name), float(factor) / mass)
                for element, factor in zip(INERTIA, both, strict=True)
                if factor
            ]
    return [*air, *steiner]


def _unit_steiner(com: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 6"]:
    return inertia_about(np.zeros(6), 1.0, com)


def trim_prior(
    mapped: ParameterMap, scatter: Sequence[Scatter], moments: Sequence[float]
) -> dict[str, float]:
    """Return the deviations of the trims before the flights.

    `mapped`: with the trims. `scatter`: of the flights of the configuration that each flight is of.
    `moments`: mass times arm of each flight [kg m].
    """

    def std(name: str) -> float:
        own, _, k = name.removeprefix(TRIM).partition("@")
        at = scatter[int(k)]
        return at.air if own == "air" else at.moved * moments[int(k)]

    return {name: std(name) for name in mapped.names if name.startswith(TRIM)}


def scatters(
    estimate: Estimate, owners: Sequence[int], moments: Sequence[float]
) -> dict[int, Scatter]:
    """Estimate the scatter of the flights of each configuration.

    `estimate`: with trims for each flight that is not alone. `owners`: whose flight each is, in
    order. `moments`: mass times arm of each flight [kg m].
    """
    found: dict[int, Scatter] = {}
    for c in set(owners):
        own = [k for k, owner in enumerate(owners) if owner == c]
        # A prior wider than the scatter would leave what all flights share more open than they do.
        # One step of expectation maximisation (Dempster, Laird and Rubin, J. Royal Statistical
        # Society B 39, 1977), from what the trims differ by and what is open of that.
        if len(own) > 1:
            variance = float(np.mean([_trim_variance(estimate, moment, own) for moment in MOVED]))
            moved = float(np.sqrt(variance)) / moments[own[0]]
            # Two flights of one day show nothing of other days: one degree of freedom from before.
            squares = UNSEEN.air**2 + (len(own) - 1) * _trim_variance(estimate, "air", own)
            found[c] = Scatter(
                moved=max(moved, LEAST_MOVED), air=float(np.sqrt(squares / len(own)))
            )
    return found


def _trim_variance(estimate: Estimate, own: str, flights: Sequence[int]) -> float:
    """Return the expected variance of a trim of several flights about their mean."""
    at = [estimate.names.index(f"{TRIM}{own}@{k}") for k in flights]
    open_still = estimate.covariance[np.ix_(at, at)]
    about = float(np.trace(open_still) - open_still.mean() * len(at))
    return float(estimate.values[at].var(ddof=1)) + about / (len(at) - 1.0)


def are_trims(mapped: ParameterMap) -> Bool[np.ndarray, " f"]:
    """Mark the free parameters that are trims of single flights."""
    return np.array([name.startswith(TRIM) for name in mapped.names], dtype=bool)
