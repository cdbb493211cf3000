"""One measured speed, or one command, that stands for two rotors."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError

if TYPE_CHECKING:
    from jaxtyping import Float


def refuse_twin_rotors(motor: Float[np.ndarray, "n N"], *, measured: bool) -> None:
    """Raise an error if one measured speed, or else one command, stands for two rotors.

    Where each rotor has its twin, the pairs may be coaxial rotors of a simulator without noise.
    """
    rotors = range(motor.shape[1])
    twins = [
        (i, k)
        for i, k in combinations(rotors, 2)
        if np.ptp(motor[:, i]) > 0.0 and np.array_equal(motor[:, i], motor[:, k])
    ]
    if not twins or {i for pair in twins for i in pair} == set(rotors):
        return
    i, k = twins[0]
    if measured:
        raise FlightError(
            f"rotors {i + 1} and {k + 1} have the same measured speed in every sample, as one "
            "column or ESC that stands for both: give each rotor its own column, or correct the "
            "ESC telemetry"
        )
    raise FlightError(
        f"rotors {i + 1} and {k + 1} have the same command in every sample, as one column that "
        "stands for both: give each rotor its own column"
    )
