"""Motor channels that stand still in flight while those of the other rotors move.

What hovers is held by rotors that never stop changing: a telemetry wire that is off, or a
controller that repeats its last answer, shows as values that stay exactly the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.preprocessing.signals import true_runs, whole_samples

LONGEST_STILL: Final = 1.0
"""A motor channel that stays the same for so long while the others move is stuck [s]."""
SAME: Final = 1e-9
"""Change of a sample to the next, over the largest value, that filters leave of nothing."""
MOVING: Final = 0.3
"""Share of their usual deviation from which the other rotors count as moving."""
STEPS: Final = 3.0
"""Steps of a coarse channel by which the others must deviate: less is rounded away."""
FLAT: Final = 0.01
"""Deviation over that of the others, below which a channel is noise about a constant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StillRotor:
    """A rotor whose motor channel stands still.

    Attributes
    ----------
    rotor
        From 1, in the log's order.
    value
        At which it stands, in the longest stretch.
    share
        Of the flight.
    rows
        Start and stop (exclusive) of the longest stretch.
    """

    rotor: int
    value: float
    share: float
    rows: tuple[int, int]


def still_rotors(
    values: Float[np.ndarray, "n N"],
    stretches: Sequence[tuple[int, int]],
    sample_rate: float,
    *,
    measured: bool,
    step: float = 0.0,
) -> tuple[StillRotor, ...]:
    """Return the rotors that stand still while the others move.

    Parameters
    ----------
    values
        Motor channel on a uniform clock.
    stretches
        Start and stop (exclusive) of the flight in it.
    sample_rate
        Of the clock [Hz].
    measured
        Whether it is measured speed. Commands stay at their ends for as long as the pilot wants.
    step
        Smallest step of the channel, 0 where unknown.
    """
    if values.shape[1] < 3 or not stretches:
        return ()
    flown = np.concatenate([values[a:b] for a, b in stretches])
    usual = flown.std(axis=0)
    longest = whole_samples(LONGEST_STILL * sample_rate)
    found: list[StillRotor] = []
    for i in range(values.shape[1]):
        others = np.delete(usual, i)
        least = max(MOVING * float(np.median(others)), STEPS * step)
        if usual[i] < FLAT * float(np.median(others)) and usual[i] > 0.0:
            runs = list(stretches)
        else:
            runs = _runs(values, stretches, i, longest=longest, least=least)
        if not measured:
            runs = _inside(runs, values, flown, i)
        if runs:
            a, b = max(runs, key=lambda run: run[1] - run[0])
            share = sum(stop - start for start, stop in runs) / len(flown)
            middle = float(np.median(values[a:b, i]))
            found.append(StillRotor(rotor=i + 1, value=middle, share=share, rows=(a, b)))
    return tuple(found)


def _runs(
    values: Float[np.ndarray, "n N"],
    stretches: Sequence[tuple[int, int]],
    i: int,
    *,
    longest: int,
    least: float,
) -> list[tuple[int, int]]:
    """Return where one column stays the same for long while the others deviate by `least`."""
    column = values[:, i]
    same: Bool[np.ndarray, " n"] = np.zeros(len(column), dtype=bool)
    for a, b in stretches:
        same[a : b - 1] = np.abs(np.diff(column[a:b])) <= SAME * float(np.abs(column[a:b]).max())
    return [
        (a, b + 1)
        for a, b in true_runs(same)
        if b - a >= longest
        and float(np.median(np.delete(values[a:b], i, axis=1).std(axis=0))) > max(least, 0.0)
    ]


def _inside(
    runs: list[tuple[int, int]],
    values: Float[np.ndarray, "n N"],
    flown: Float[np.ndarray, "m N"],
    i: int,
) -> list[tuple[int, int]]:
    """Return the stretches in which a command is not at the end that others reach, too."""
    low, high = np.delete(flown, i, axis=1).min(), np.delete(flown, i, axis=1).max()
    if float(np.ptp(flown[:, i])) == 0.0 and flown[0, i] <= low:
        return runs  # it never leaves the lower end: another output drives this motor
    return [(a, b) for a, b in runs if low < float(np.median(values[a:b, i])) < high]
