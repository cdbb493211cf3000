"""How much of a sensor's signal its end cut off."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.preprocessing.signals import true_runs

LEAST_LIMIT: Final = {"gyro": 4.0, "accel": 35.0}
"""Sensors end at 250 deg/s and 4 g at the least: values that stay the same below are no limit."""
LIMIT_RUN: Final = 3
STEEP: Final = 5.0
"""A step of so many times the smallest one is no rounded peak's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CutOff:
    """The share of a flight that a sensor's end cut off, and the largest reading, in its unit."""

    share: float
    largest: float


def cut_off(values: Float[np.ndarray, "n 3"], sensor: Literal["gyro", "accel"]) -> CutOff:
    """Return what a sensor's end cut off of its readings in flight."""
    return CutOff(
        share=share_at_limit(values, LEAST_LIMIT[sensor]),
        largest=max(float(values.max(initial=0.0)), -float(values.min(initial=0.0))),
    )


def share_at_limit(values: Float[np.ndarray, "n k"], least: float, *, repeats: int = 1) -> float:
    """Return the share of samples that a sensor's end cut off, see `at_limit`."""
    stuck = at_limit(values, least, repeats=repeats)
    return float(stuck.mean()) if len(stuck) else 0.0


def at_limit(
    values: Float[np.ndarray, "n k"], least: float, *, repeats: int = 1
) -> Bool[np.ndarray, " n"]:
    """Return which samples a sensor's end cut off.

    Such stand at one extreme three times in a row or more, and come to it or leave it steeply. A
    rounded peak stands still for a while, too, but a step of the resolution above its neighbours.

    Parameters
    ----------
    values
        Of a channel.
    least
        Sizes below are no sensor's end.
    repeats
        How often the recorder writes each sample.
    """
    stuck = np.zeros(len(values), dtype=bool)
    for column in values.T:
        steps = np.abs(np.diff(column))
        if not (steps > 0.0).any():
            continue
        steep = STEEP * float(steps[steps > 0.0].min())
        for extreme in (column.max(), column.min()):
            if abs(extreme) < least:
                continue
            for a, b in true_runs(np.abs(column - extreme) <= 1e-4 * abs(extreme)):
                beside = steps[[k for k in (a - 1, b - 1) if 0 <= k < len(steps)]]
                stuck[a:b] |= b - a >= LIMIT_RUN * repeats and bool((beside > steep).any())
    return stuck
