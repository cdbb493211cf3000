"""Did a rotor change? In flight, from one half of it to the other, or against all the others."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import ConfigurationData, LoadedFlight
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.vehicle import Vehicle

LEAST_CHANGE: Final = 0.035
"""Of a rotor's share of all squared speeds, between the halves of a flight: sound logs have up to
0.013, one of fast outdoor flight 0.025."""
LEAST_UNLIKE: Final = 0.1
"""Of a rotor's thrust coefficient from the mean one: sound logs have up to 0.06."""
SHORTEST: Final = 5.0
"""Flight [s] of which halves are compared."""


def changed_in_flight(configurations: Sequence[ConfigurationData]) -> str | None:
    """Return that a rotor turns otherwise late in a flight than early, in words."""
    for configured in configurations:
        for flight in configured.flights:
            words = _changed(flight)
            if words is not None:
                return words
    return None


def _changed(flight: LoadedFlight) -> str | None:
    data = flight.prepared.data
    rows = data.used_rows
    if len(rows) < SHORTEST * data.sample_rate:
        return None
    first, second = (_shares(data.rotor_speed[half] ** 2) for half in np.array_split(rows, 2))
    change = second - first
    worst = int(np.argmax(np.abs(change)))
    if abs(change[worst]) < LEAST_CHANGE:
        return None
    return (
        f"{Path(flight.entry.file).name}: rotor {worst + 1} has {100 * first[worst]:.0f} % of all "
        f"squared rotor speeds in the first half of the flight and {100 * second[worst]:.0f} % in "
        "the second: its propeller broke or slipped, the battery shifted, or its speed is wrong in "
        "one of them; identify each part by itself (start and end)"
    )


def _shares(squares: Float[np.ndarray, "n N"]) -> Float[np.ndarray, " N"]:
    mean = squares.mean(axis=0)
    return mean / max(float(mean.sum()), np.finfo(float).tiny)


def unlike_rotor(numbers: Numbers, vehicle: Vehicle) -> str | None:
    """Return that one rotor's thrust coefficient is far from the others', in words.

    Parameters
    ----------
    numbers
        With the coefficients of the rotors.
    vehicle
        Whose rotors may have groups, of which each is expected to differ.
    """
    names = [f"kt_{i}" for i in range(1, len(vehicle.rotors) + 1)]
    if any(r.group is not None for r in vehicle.rotors) or not set(names) <= set(numbers.names):
        return None
    own = np.array([numbers.number(name)[0] for name in names])
    apart = own / np.median(own) - 1.0
    worst = int(np.argmax(np.abs(apart)))
    if abs(apart[worst]) < LEAST_UNLIKE:
        return None
    return (
        f"rotor {worst + 1} makes {100 * abs(apart[worst]):.0f} % "
        f"{'more' if apart[worst] > 0 else 'less'} thrust than the others at the same speed: its "
        "speed has another scale (poles), or its propeller is damaged or of another type; until "
        "this is fixed do not trust kt and the centre of mass"
    )
