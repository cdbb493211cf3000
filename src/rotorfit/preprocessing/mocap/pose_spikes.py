"""Single frames of motion capture that jump and return: put back on the line of their neighbours.

As spikes of a gyro are (`signals.hampel`), and before anything is filtered: differentiated twice, a
jump of 0.07 rad at 100 Hz is an angular acceleration of 1400 rad/s^2, over which no fit sees the
flight. A frame is held against the cubic through its two neighbours on either side, which follows
any flight to a small share of the noise. What jumps for longer than a frame is not touched here.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from rotorfit.preprocessing.signals import SCALE_WIDTH, SPIKE_THRESHOLD

REACH: Final = 2
"""Neighbours on either side that are looked at."""
CUBIC: Final = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
"""The middle of a cubic through four equidistant neighbours."""
REGULAR: Final = 1.5
"""Longest step to a neighbour, in periods."""
MOST_PASSES: Final = 3
"""A jump hides a smaller one beside it."""


def without_spikes(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Return the values with single frames that jump replaced, and which those are.

    Parameters
    ----------
    time
        Of the frames [s].
    values
        What jumps as one: the coordinates of a place, or the elements of a quaternion whose sign
        is continuous.
    """
    clean, mended = values, np.zeros(len(values), dtype=bool)
    if len(values) < SCALE_WIDTH:
        return clean, mended
    inner = _has_neighbours(time)
    for _ in range(MOST_PASSES):
        off, limit = _off_and_limit(clean, inner)
        peaks = np.flatnonzero((off > limit) & (off >= ndimage.maximum_filter1d(off, 5)))
        returned = [int(i) for i in peaks if _returns(clean, int(i), limit)]
        if not returned:
            break
        clean = clean.copy() if clean is values else clean
        for i in returned:
            clean[i] = CUBIC @ clean[i - REACH : i + REACH + 1]
        mended[returned] = True
    return clean, mended


def _has_neighbours(time: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return which frames have all neighbours that the cubic needs, none of them lost between."""
    steps = np.diff(time)
    near = steps < REGULAR * float(np.median(steps))
    inner = np.zeros(len(time), dtype=bool)
    inner[REACH:-REACH] = near[:-3] & near[1:-2] & near[2:-1] & near[3:]
    return inner


def _off_and_limit(
    values: Float[np.ndarray, "n k"], inner: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return how far each frame lies off the cubic, and from where on that is a spike."""
    cubic = ndimage.correlate1d(values, CUBIC, axis=0, mode="nearest")
    off = np.where(inner, np.linalg.norm(values - cubic, axis=1), 0.0)
    usual = ndimage.median_filter(off, SCALE_WIDTH, mode="nearest")
    # Quiet stretches between lively ones: as for the gyro, never much below the column's own.
    floor = 0.4 * float(np.percentile(off, 95)) + np.finfo(float).tiny
    return off, SPIKE_THRESHOLD * 1.4826 * np.maximum(usual, floor)


def _returns(values: Float[np.ndarray, "n k"], i: int, limit: Float[np.ndarray, " n"]) -> bool:
    """Return whether all is smooth about frame `i` once it is replaced: it jumped alone."""
    first, stop = max(i - 2 * REACH, 0), min(i + 2 * REACH + 1, len(values))
    trial = values[first:stop].copy()
    trial[i - first] = CUBIC @ values[i - REACH : i + REACH + 1]
    cubic = ndimage.correlate1d(trial, CUBIC, axis=0, mode="nearest")
    off = np.linalg.norm(trial - cubic, axis=1)
    return bool((off < limit[first:stop])[REACH:-REACH].all())
