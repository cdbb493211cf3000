"""The force of the air on a vehicle at known values of its parameters."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from rotorfit.flight.flight_data import FlightData
from rotorfit.model.signals import SignalLayout
from rotorfit.model.terms.registry import terms_in
from rotorfit.model.terms.term import FX, MX, Term
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
    every = slice(0, len(data.time))
    columns: dict[str, Float[np.ndarray, " n"]] = {}
    for signals in layout.added:
        names = signals.names(vehicle)
        if signals.of_body is not None:
            made = signals.of_body(data, every)
        elif signals.of_rotors is not None:
            made = signals.of_rotors(data, every, vehicle)
        else:
            continue
        columns |= dict(zip(names, made.T, strict=True))
    force = np.zeros((len(data.time), 3))
    for term in terms_in(layout):
        if term.entries is None or not (term.needs == "velocity" or term.with_velocity):
            continue
        for name, entries in term.entries(vehicle, layout).items():
            rows = entries[FX:MX] * value(term, name)
            for z in np.flatnonzero(rows.any(axis=0)):
                if layout.names[z] in columns:
                    force -= columns[layout.names[z]][:, None] * rows[:, z]
    return force
