"""Find hovers that the search for flight leaves out, because one load cannot explain both."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.airborne import (
    DRIFT,
    GRAVITY,
    LOOK_CUTOFF,
    Motion,
    block_means,
    following_share,
    take_drift_out,
)
from rotorfit.flight.signals import running_mean, true_runs, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

SHORTEST: Final = 5.0
"""Hover that counts [s]: no spooling up or down takes as long."""
LEAST_THRUST: Final = 0.2
"""Thrust over that of the part that is used, under which motors idle."""
UNTURNED: Final = 0.02
"""Deviation of the turn rate [rad/s] under which a vehicle stands on the ground."""
OFF: Final = 0.1
"""Share of g by which the specific force of a hover may be off, on average and from it."""
CONTRADICTION: Final = 0.2
"""Least difference of thrust: a battery makes less in one flight."""
CLEAR: Final = 3.0
LEAST_FOLLOWING: Final = 0.05
"""Deviations, and share, with which acceleration follows the rotors: none does on the ground, and
of slow commands it follows little."""
SMOOTHED: Final = 1.0
"""[s] over which thrust is averaged."""


@frozen_dataclass
class OtherHover:
    """A hover that is not used.

    - `start`, `end`: since the first sample [s].
    - `thrust`: by the motor data, over that of the part that is used.
    """

    start: float
    end: float
    thrust: float

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return self.end - self.start


def other_hovers(
    motion: Motion, flights: list[tuple[int, int]], time: Float[np.ndarray, " n"]
) -> tuple[OtherHover, ...]:
    """Find stretches outside the flights in which the vehicle hovers on another thrust.

    `time`: of the samples [s].
    """
    used = np.zeros(len(motion.rotor_speed), dtype=bool)
    for a, b in flights:
        used[a:b] = True
    thrust, rate = motion.thrust, motion.sample_rate
    level = float(thrust[used].mean()) if used.any() else 0.0
    found: list[OtherHover] = []
    for start, stop in motion.stretches:
        window = min(whole_samples(SMOOTHED * rate), stop - start)
        own = running_mean(thrust[start:stop], max(window, 1))
        flying = (own > LEAST_THRUST * level) & ~used[start:stop]
        for a, b in true_runs(flying):
            rows = slice(start + a, start + b)
            if b - a >= SHORTEST * rate and _is_hover(motion, rows):
                ratio = float(np.median(thrust[rows])) / level
                if abs(ratio - 1.0) < CONTRADICTION:
                    continue
                begin, end = (float(time[i] - time[0]) for i in (start + a, start + b - 1))
                found.append(OtherHover(start=begin, end=end, thrust=ratio))
    return tuple(found)


def _is_hover(motion: Motion, rows: slice) -> bool:
    """Return whether the vehicle turns, and rises when its rotors push: it flies."""
    z = motion.specific_force[rows, 2]
    turning = float(motion.angular_velocity[rows].std(axis=0).max())
    block = max(whole_samples(motion.sample_rate / LOOK_CUTOFF), 1)
    felt = block_means(z[:, None], block)[:, 0]
    push = block_means(motion.thrust[rows, None], block)[:, 0]
    steady = abs(float(z.mean()) / GRAVITY - 1.0) < OFF and float(felt.std()) < OFF * GRAVITY
    if not steady or turning < UNTURNED:
        return False
    slow = round(DRIFT * LOOK_CUTOFF)
    swing = take_drift_out(push, slow) * (GRAVITY / float(push.mean()))
    follows, std = following_share(take_drift_out(felt, slow), swing)
    return follows > max(CLEAR * std, LEAST_FOLLOWING)
