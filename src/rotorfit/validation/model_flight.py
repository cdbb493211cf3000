"""Manoeuvres that a model flew in a simulator, and how well."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

Manoeuvre = Literal["hover", "roll", "pitch", "yaw rate"]
MANOEUVRES: Final[tuple[Manoeuvre, ...]] = ("hover", "roll", "pitch", "yaw rate")
STEPS: Final[tuple[Manoeuvre, ...]] = MANOEUVRES[1:]
BEFORE: Final = 0.25
"""Level flight before a step [s]."""
STEP: Final = {"roll": 0.25, "pitch": 0.25, "yaw rate": 0.5}
"""Sizes of the steps [rad, rad, rad/s]."""
LOST: Final = 1.2
"""Tilt beyond which a vehicle counts as lost [rad]."""
WITHIN: Final = 0.1
"""Of the step, about what was asked: then it is settled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFlight:
    """One manoeuvre.

    Attributes
    ----------
    manoeuvre
        Which.
    time
        [s]
    asked, flown
        Height above the start [m], angle [rad] or yaw rate [rad/s].
    tilt
        Angle of the body's z axis to the vertical [rad].
    """

    manoeuvre: Manoeuvre
    time: Float[np.ndarray, " n"]
    asked: Float[np.ndarray, " n"]
    flown: Float[np.ndarray, " n"]
    tilt: Float[np.ndarray, " n"]


def is_lost(flight: ModelFlight) -> bool:
    """Return whether the vehicle turned over, or flew no number any more."""
    return not np.isfinite(flight.flown).all() or float(flight.tilt.max()) > LOST


def departure(flight: ModelFlight) -> float:
    """Return how far the height got from what was asked of it in hover [m]."""
    return float(np.abs(flight.flown - flight.asked).max())


def overshoot(flight: ModelFlight) -> float:
    """Return how far a step went beyond what was asked, as a share of it."""
    return max(float(flight.flown.max()) / float(flight.asked[-1]) - 1.0, 0.0)


def settling_time(flight: ModelFlight) -> float | None:
    """Return the time from a step until it stays within a tenth of what was asked [s].

    None where it does not within the time flown.
    """
    away = np.abs(flight.flown - flight.asked) > WITHIN * abs(float(flight.asked[-1]))
    last = int(np.flatnonzero(away)[-1]) if away.any() else 0
    if last + 1 >= len(away):
        return None
    return float(flight.time[last + 1]) - BEFORE
