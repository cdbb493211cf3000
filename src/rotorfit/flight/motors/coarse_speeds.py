"""Find measured rotor speeds in steps so coarse that the motion between them is lost.

Rounding to a step q adds an error of q^2 / 12 that is independent of a normal signal as long as q
is at most two of its standard deviations (Widrow and Kollar, Quantization Noise, 2008, chapter 5).
Beyond that the error follows the signal: a rotor that changes seems to stand still, or to jump.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.flight_log import grid_step

if TYPE_CHECKING:
    from jaxtyping import Float

COARSEST: Final = 1.0 / 3.0
"""Variance of a rounded speed over its squared step, below which rounding hides the motion: of a
deviation of half a step it is 1/4 + 1/12."""
MOST_SAMPLES: Final = 20_000
"""Samples of a column that are looked at."""
FEWEST_LEVELS: Final = 2
"""Levels of all rotors together that show a step."""
ROUNDING: Final = 1e-12
"""Share of the largest speed by which two readings of one level differ by their unit."""
LARGEST: Final = 1e6
"""No rotor turns at this speed [rad/s]: a sample beyond it is damaged."""
RPM: Final = 60.0 / (2.0 * np.pi)


def speed_step(speed: Float[np.ndarray, "n N"]) -> float:
    """Return the step in which measured speeds come [rad/s]; 0 if they lie on no grid."""
    some = speed[:: max(len(speed) // MOST_SAMPLES, 1)]
    turning = some[np.isfinite(some) & (some > 0.0) & (some < LARGEST)]
    return grid_step(turning, fewest=FEWEST_LEVELS, rounding=ROUNDING) or 0.0


def coarse_speeds_sentence(flown: Float[np.ndarray, "n N"], step: float) -> str | None:
    """Explain that speeds in flight move by less than their step shows; None if they move enough.

    `flown`: speeds of turning motors. `step`: of their telemetry [rad/s], 0 if it has none.
    """
    if step <= 0.0 or len(flown) == 0:
        return None
    variance = float(np.median(np.nanvar(flown, axis=0)))
    if variance >= COARSEST * step**2:
        return None
    return (
        f"the measured rotor speeds come in steps of {step:.3g} rad/s ({step * RPM:.3g} rpm), and "
        "move by about one step in flight: what the rotors do between the steps is lost; log the "
        'speeds in finer steps, or take the commands (speed = "commanded" under [motors])'
    )
