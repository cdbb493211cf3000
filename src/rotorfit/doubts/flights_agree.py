"""Do the flights of a configuration tell of one vehicle? Each against what the others say.

Leaving a flight out moves each number by what that flight says otherwise. Flights of one vehicle
differ by chance, by weather and by how they were flown; another propeller, load or vehicle makes
more.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.estimation.partial import left_out
from rotorfit.fit.flights import Configured
from rotorfit.fit.joint_equations import JointConfiguration
from rotorfit.fit.number_intervals import Numbers

LOOKED_AT: Final = ("kt", "kd", "Ixx", "Iyy", "Izz")
LEAST_SHARE: Final = 0.1
"""Of a number, by which a flight must move it."""
SURE: Final = 4.0
"""Deviations of chance by which it must."""


def odd_flight(
    configurations: Sequence[Configured],
    joint: Sequence[JointConfiguration],
    fit: BandedEstimate,
    numbers: Numbers,
) -> str | None:
    """Return that a flight contradicts the others of its configuration, in words.

    Parameters
    ----------
    configurations, joint
        What was flown, and as it was fitted.
    fit, numbers
        The fit of all flights, and its numbers with their intervals.
    """
    found = list(_disagreements(configurations, joint, fit, numbers))
    if not found:
        return None
    size, flight, configuration, name, without = max(found)
    value = numbers.number(f"{name}@{configuration}" if name[0] == "I" else name)[0]
    return (
        f"{configuration}: without {flight} {name} would be {without:.3g} instead of {value:.3g}, "
        f"{size:.1f} times what chance explains: its vehicle, load, propellers or battery were not "
        "those of the other flights; identify it by itself, or as a configuration of its own"
    )


def _disagreements(
    configurations: Sequence[Configured],
    joint: Sequence[JointConfiguration],
    fit: BandedEstimate,
    numbers: Numbers,
) -> Iterator[tuple[float, str, str, str, float]]:
    """Yield size, flight, configuration, number and its value without the flight."""
    blocks = np.concatenate([c.factors.recording for c in joint])
    owner = np.concatenate([np.full(len(c.factors), i) for i, c in enumerate(joint)])
    names = fit.estimate.names
    for i, (configured, c) in enumerate(zip(configurations, joint, strict=True)):
        if len(configured.flights) < 2:
            continue
        for k, flight in enumerate(configured.flights):
            shift = left_out(fit, (owner == i) & (blocks == k))
            for name in LOOKED_AT:
                full = f"{name}@{c.name}" if name[0] == "I" else name
                if full not in names or full not in numbers.names:
                    continue
                at = names.index(full)
                value, half = numbers.number(full)
                moved, std = float(shift.values[at]), float(shift.std[at])
                if abs(moved) > max(LEAST_SHARE * abs(value), half, SURE * std):
                    file = Path(flight.entry.file).name
                    yield abs(moved) / std, file, c.name, name, value + moved
