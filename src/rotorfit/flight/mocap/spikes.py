"""Single poses that a camera misplaced, found against the cubic of their neighbours.

Differentiated twice, a jump of 0.07 rad at 100 Hz is an angular acceleration of 1400 rad/s^2. A
frame is held against the cubic through its two neighbours on either side, which follows any flight
to a small share of the noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.signals import (
    SCALE_WIDTH,
    SPIKE_THRESHOLD,
    local_medians,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

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
    """Replace single frames that jump, and mark them; columns of `values` jump as one."""
    clean, mended = values, np.zeros(len(values), dtype=bool)
    if len(values) < SCALE_WIDTH:
        return clean, mended
    steps = np.diff(time)
    near = steps < REGULAR * float(np.median(steps))
    inner = np.zeros(len(time), dtype=bool)
    inner[REACH:-REACH] = near[:-3] & near[1:-2] & near[2:-1] & near[3:]
    for _ in range(MOST_PASSES):
        off, limit = _off_and_limit(clean, inner)
        wide = np.pad(off, REACH)
        highest = np.lib.stride_tricks.sliding_window_view(wide, 2 * REACH + 1).max(axis=1)
        peaks = np.flatnonzero((off > limit) & (off >= highest))
        returned = [int(i) for i in peaks if _jumped_alone(clean, int(i), limit)]
        if not returned:
            break
        clean = clean.copy() if clean is values else clean
        for i in returned:
            clean[i] = CUBIC @ clean[i - REACH : i + REACH + 1]
        mended[returned] = True
    return clean, mended


def _off_and_limit(
    values: Float[np.ndarray, "n k"], inner: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Compute each frame's distance from the cubic, and the limit of a spike."""
    cubic = _cubic_of_neighbours(values)
    off = np.where(inner, np.linalg.norm(values - cubic, axis=1), 0.0)
    # Quiet stretches between lively ones: as for the gyro, never much below the column's own.
    floor = 0.4 * float(np.percentile(off, 95)) + np.finfo(float).tiny
    limit = np.full(len(off), SPIKE_THRESHOLD * 1.4826 * floor)
    # The median of the frames around matters about frames that are far alone.
    near_far = np.convolve(off > limit, np.ones(4 * REACH + 1), "same") > 0.0
    rows = np.flatnonzero(near_far)
    usual = local_medians(off, SCALE_WIDTH, rows)
    limit[rows] = SPIKE_THRESHOLD * 1.4826 * np.maximum(usual, floor)
    return off, limit


def _cubic_of_neighbours(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Compute the middle of the cubic through the neighbours of every frame."""
    wide = np.pad(values, ((REACH, REACH), (0, 0)), mode="edge")
    near = [wide[k : k + len(values)] for k in range(2 * REACH + 1)]
    return np.add.reduce([weight * part for weight, part in zip(CUBIC, near, strict=True)])


def _jumped_alone(values: Float[np.ndarray, "n k"], i: int, limit: Float[np.ndarray, " n"]) -> bool:
    """Test whether all is smooth about frame `i` once it is replaced: it jumped alone."""
    first, stop = max(i - 2 * REACH, 0), min(i + 2 * REACH + 1, len(values))
    trial = values[first:stop].copy()
    trial[i - first] = CUBIC @ values[i - REACH : i + REACH + 1]
    cubic = _cubic_of_neighbours(trial)
    off = np.linalg.norm(trial - cubic, axis=1)
    return bool((off < limit[first:stop])[REACH:-REACH].all())
