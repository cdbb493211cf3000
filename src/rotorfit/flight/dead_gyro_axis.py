"""Find seconds in which one axis of the gyro repeats its value while the rotors turn the vehicle.

A coarse gyro in calm flight repeats its values, too. So the other seconds of the flight show how
the rotors turn the vehicle about that axis, by a regression of its angular acceleration on them;
an axis is dead where it stands still and they push about it as usual.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.signals import repeated_rows, true_runs, whole_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.flight.clocks import UniformChannels

    Runs = list[tuple[int, int]]

ALONE: Final = 1.0
"""Duration from which an axis that stands still is looked at [s]."""
BLOCK: Final = 0.1
"""Block of samples whose means are compared [s]: about the lag of a motor."""
FEWEST: Final = 25
"""Blocks outside, from which the regression is believed."""
EXPLAINED: Final = 0.2
"""Least share of the axis' acceleration that the rotors explain outside: in calm flight, noise and
gusts are most of it."""
AS_USUAL: Final = 0.5
"""Least push of the rotors about the axis meanwhile, over the median of the other seconds."""
OF_ALL: Final = 0.05
"""The same over that of all of them: an aerobatic one has most of it."""
STEPS: Final = 5.0
"""Least turn by that push within a block, over the step of the axis: a coarse one reads the same
of less."""


def dead_axis_runs(uniform: UniformChannels, flights: Sequence[tuple[int, int]], axis: int) -> Runs:
    """Find the rows (start, stop) in which an axis of the gyro (0 to 2) is dead in flight."""
    rate, gyro = uniform.sample_rate, uniform.values["gyro"][:, axis]
    same = true_runs(repeated_rows(gyro[:, None], flights))
    still = [(a, b + 1) for a, b in same if b - a >= ALONE * rate]
    if not still:
        return []
    lives = np.zeros(len(gyro), dtype=bool)
    for a, b in flights:
        lives[a:b] = True
    for a, b in still:
        lives[a:b] = False
    push = _push_about(uniform, gyro, lives)
    steps: Float[np.ndarray, " m"] = np.abs(np.diff(gyro[lives]))
    if push is None or not steps.any():
        return []
    second = whole_samples(rate)
    seconds = [push[a : a + second].std() for a in range(0, len(push), second) if lives[a]]
    least = max(
        AS_USUAL * float(np.median(seconds)),
        OF_ALL * float(push[lives].std()),
        STEPS * float(steps[steps > 0.0].min()) / BLOCK,
    )
    return [(a, b) for a, b in still if push[a:b].std() > least]


def _push_about(
    uniform: UniformChannels, gyro: Float[np.ndarray, " n"], lives: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, " n"] | None:
    """Predict the angular acceleration by the rotors [rad/s^2]; None if they do not explain it."""
    block = max(whole_samples(BLOCK * uniform.sample_rate), 1)
    count = len(gyro) // block
    rows = slice(0, count * block)
    turns = gyro[rows].reshape(count, block).mean(axis=1)
    motors = uniform.values["motor"][rows].reshape(count, block, -1).mean(axis=1)
    whole = lives[rows].reshape(count, block).min(axis=1)
    # Commands come before the push of their rotors, by up to a block.
    columns = np.column_stack([np.ones(count), motors, np.roll(motors, 1, axis=0)])
    inner = np.flatnonzero(whole[2:] & whole[1:-1] & whole[:-2]) + 1
    if len(inner) < FEWEST + columns.shape[1]:
        return None
    gained = (turns[inner + 1] - turns[inner - 1]) / (2.0 * block / uniform.sample_rate)
    slopes = np.asarray(np.linalg.lstsq(columns[inner], gained)[0], dtype=float)
    explained = np.asarray(columns[inner] @ slopes, dtype=float)
    if explained.var() < EXPLAINED * gained.var():
        return None
    push: Float[np.ndarray, " r"] = np.repeat(columns @ slopes, block)
    return np.concatenate([push, np.full(len(gyro) - len(push), push[-1])])
