"""Whether the rotors of an airframe are as far apart as rotors can be."""

from collections.abc import Sequence
from typing import Final

import numpy as np

SHORTEST_ARM: Final = 0.01
LONGEST_ARM: Final = 5.0
"""Of a multirotor, from the smallest toy to the largest that carries people [m]."""


def refuse_impossible_arms(positions: Sequence[Sequence[float]]) -> None:
    """Raise where rotors are so near or so far that their unit must be wrong.

    Parameters
    ----------
    positions
        Of the rotors, x, y (and z) from the body origin [m].

    Raises
    ------
    ValueError
        With the distance that was met; the experiment's messages name the place in the file.
    """
    places = np.array([position[:2] for position in positions], dtype=float)
    with np.errstate(over="ignore"):
        arm = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())
        farthest = float(np.linalg.norm(places, axis=1).max())
    if arm >= SHORTEST_ARM and max(arm, farthest) <= LONGEST_ARM:
        return
    met = arm if arm < SHORTEST_ARM else max(arm, farthest)
    raise ValueError(
        f"the rotors are {met:.4g} m from the centre, expected {SHORTEST_ARM:g} to "
        f"{LONGEST_ARM:g} m: positions and arm are in metres (25 cm is 0.25)"
    )
