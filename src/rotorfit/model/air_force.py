"""The wrench of the air on a vehicle that moves at a known velocity."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.model.signals import SignalLayout, signal_matrix
from rotorfit.model.terms.registry import terms_in

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.terms.term import Term
    from rotorfit.model.vehicle import Vehicle


def air_force(
    data: FlightData,
    vehicle: Vehicle,
    layout: SignalLayout,
    value: Callable[[Term, str], float],
) -> Float[np.ndarray, "n 3"]:
    """Compute the force of the terms that depend on the velocity, of every sample, body axes [N].

    `data`: with a velocity in every row. `layout`: of the model. `value`: from a term and one of
    its parameters to the parameter's value, zero where the model does not have it.
    """
    force = np.zeros((len(data.time), 3))
    for term, name, wrench in air_wrenches(data, vehicle, layout):
        force += value(term, name) * wrench[:, :3]
    return force


def air_wrenches(
    data: FlightData, vehicle: Vehicle, layout: SignalLayout
) -> Iterator[tuple[Term, str, Float[np.ndarray, "n 6"]]]:
    """Yield terms that depend on the velocity, their parameters, and the wrench of a unit of each.

    Force, then torque about the origin, body axes, of every sample. `data`: with a velocity in
    every row. `layout`: of the model.
    """
    of_instants = replace(data, differentiation="exact")
    Z = signal_matrix(of_instants, vehicle, 0, len(data.time), added=layout.added)
    for term in terms_in(layout):
        if term.entries is None or not (term.needs == "velocity" or term.with_velocity):
            continue
        for name, entries in term.entries(vehicle, layout).items():
            moved = np.flatnonzero(entries.any(axis=0))
            yield term, name, -Z[:, moved] @ entries[:, moved].T
