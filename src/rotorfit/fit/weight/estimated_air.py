"""The force of the air by the numbers of a fit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.model.air_force import air_force

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.signals import SignalLayout
    from rotorfit.model.terms.term import Term
    from rotorfit.model.vehicle import Vehicle


def estimated_air_force(
    data: FlightData, numbers: Numbers, configuration: str, shape: tuple[Vehicle, SignalLayout]
) -> Float[np.ndarray, "n 3"]:
    """Compute the air force along the body axes by the estimate [N]; zeros without velocity."""

    def value(term: Term, name: str) -> float:
        full = f"{name}@{configuration}" if term.owner == "configuration" else name
        return float(numbers.values[numbers.index(full)]) if full in numbers.names else 0.0

    if data.velocity is None:
        return np.zeros((len(data.time), 3))
    known = replace(data, velocity=np.nan_to_num(data.velocity))
    return air_force(known, *shape, value)
